"""Tracks whose answer is known, to try the locator without data: pvpython known_answer.py PICTURE.png [DIAMETER_IN_METRES]

Makes tracks in the flow around a sphere with the noise, drop-out and ghosts of a real tracker, finds the sphere, prints how far each centre is
from the true one beside the stated standard deviation, and draws the tracks with the sphere. Rendering needs a display; without one:
    ./rimflow with-display env PV_PLUGIN_PATH=build/lib/rimflow/plugins pvpython Examples/pvpython/known_answer.py known-answer.png
"""
import math
import sys

from paraview import simple

picture = sys.argv[1]
diameter = float(sys.argv[2]) if len(sys.argv) > 2 else 0.01111

tracks = simple.SyntheticTracks(Diameter=diameter, Density=4e8, NumberOfSnapshots=12, PositionNoise=5e-6, VelocityNoise=3.5e-3, DropOut=0.1, GhostFraction=0.005)
locator = simple.InvisibleSphereLocator(Particles=tracks, Diameter=diameter, ProcessAllTimes=1)

for time in tracks.TimestepValues:
    locator.UpdatePipeline(time)
    truth = simple.servermanager.Fetch(tracks).GetFieldData().GetArray("TrueCentre").GetTuple3(0)
    row = simple.servermanager.Fetch(locator, idx=1).GetPointData()
    if row.GetNumberOfTuples() == 0:
        print(f"{time:.4f} s: lost")
        continue
    distance = math.dist(row.GetArray("Centre").GetTuple3(0), truth)
    stated = math.hypot(*row.GetArray("Sigma").GetTuple3(0))
    print(f"{time:.4f} s: {1e6 * distance:.1f} um from the truth ({100 * distance / diameter:.2f} % of d), stated {1e6 * stated:.1f} um")

view = simple.CreateView("RenderView")
view.ViewSize = [1000, 1000]
view.UseColorPaletteForBackground, view.Background, view.OrientationAxesVisibility = 0, [1, 1, 1], 0
view.ViewTime = tracks.TimestepValues[-1]
slab = simple.Threshold(Input=simple.Calculator(Input=tracks, ResultArrayName="depth", Function="abs(coordsZ)"),
                        Scalars=["POINTS", "depth"], ThresholdMethod="Below Lower Threshold", LowerThreshold=0.15 * diameter)
shown = simple.Show(slab, view)
shown.PointSize = 5
simple.ColorBy(shown, ("POINTS", "Velocity", "Magnitude"))
colours = simple.GetColorTransferFunction("Velocity")
colours.ApplyPreset("Viridis (matplotlib)", True)
colours.RescaleTransferFunction(0, 0.35)
bar = simple.GetScalarBar(colours, view)
bar.Title, bar.ComponentTitle, bar.TitleColor, bar.LabelColor = "speed [m/s]", "", [0, 0, 0], [0, 0, 0]
shown.SetScalarBarVisibility(view, True)
ball = simple.Show(simple.OutputPort(locator, 0), view)
ball.ColorArrayName, ball.DiffuseColor, ball.Opacity = ["POINTS", ""], [0.9, 0.6, 0.2], 0.7
line = simple.Show(simple.OutputPort(locator, 2), view)
line.ColorArrayName, line.DiffuseColor, line.AmbientColor, line.LineWidth = ["POINTS", ""], [0, 0, 0], [0, 0, 0], 4
simple.ResetCamera(view)
view.CameraParallelProjection = 1
simple.GetActiveCamera().Zoom(1.5)
simple.SaveScreenshot(picture, view)
