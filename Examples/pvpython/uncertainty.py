"""The sphere, its path and the uncertainty of its centre as ellipsoids: pvpython uncertainty.py TRACKS DIAMETER_IN_METRES PICTURE.png

The ellipsoids are those of one standard deviation, drawn larger as the title says, and the sphere is the last one. Rendering needs a display; without one:
    ./rimflow with-display env PV_PLUGIN_PATH=build/lib/rimflow/plugins pvpython Examples/pvpython/uncertainty.py Examples/demo/sphere.dat.gz 0.00953 uncertainty.png
"""
import sys

from paraview import simple

name, diameter, picture = sys.argv[1], float(sys.argv[2]), sys.argv[3]
tracks = simple.STBTrackReader(FileNames=[name])
locator = simple.InvisibleSphereLocator(Particles=tracks, Diameter=diameter, ProcessAllTimes=1)
last = tracks.TimestepValues[-1]
locator.UpdatePipeline(last)
trajectory = simple.OutputPort(locator, 2)

view = simple.CreateView("RenderView")
view.ViewSize = [1400, 1050]
view.UseColorPaletteForBackground, view.Background = 0, [1, 1, 1]
view.ViewTime = last

sphere = simple.Show(simple.OutputPort(locator, 0), view)
sphere.ColorArrayName, sphere.Opacity, sphere.DiffuseColor = ["POINTS", ""], 0.25, [0.6, 0.65, 0.7]

# The standard deviation is some tens of micrometres: enlarge it to about a tenth of the diameter.
data = simple.servermanager.Fetch(trajectory, idx=2).GetPointData()
sigma = max(max(data.GetArray("Sigma").GetTuple3(i)) for i in range(data.GetNumberOfTuples()))
factor = round(0.05 * diameter / sigma, -1) or 1
glyphs = simple.TensorGlyph(Input=trajectory, GlyphType="Sphere", Tensors=["POINTS", "SigmaTensor"], ScaleFactor=2 * factor)
glyphs.ExtractEigenvalues, glyphs.ThreeGlyphs, glyphs.ColorGlyphs, glyphs.LimitScalingByEigenvalues = 1, 0, 0, 0
ellipsoids = simple.Show(glyphs, view)
ellipsoids.ColorArrayName, ellipsoids.DiffuseColor = ["POINTS", ""], [0.86, 0.45, 0.2]

tube = simple.Tube(Input=trajectory, Radius=0.006 * diameter)
tube.Scalars, tube.Vectors = ["POINTS", ""], ["POINTS", ""]
line = simple.Show(tube, view)
line.ColorArrayName, line.DiffuseColor = ["POINTS", ""], [0.1, 0.1, 0.1]

wall = simple.Show(simple.OutputPort(locator, 3), view)
wall.SetRepresentationType("Points")
wall.PointSize = 6
simple.ColorBy(wall, ("POINTS", "Distance"))
colours = simple.GetColorTransferFunction("Distance")
colours.ApplyPreset("Viridis (matplotlib)", True)
colours.RescaleTransferFunction(0, 0.1 * diameter)
bar = simple.GetScalarBar(colours, view)
bar.Title, bar.ComponentTitle, bar.TitleColor, bar.LabelColor = "distance of tracers from the wall [m]", "", [0, 0, 0], [0, 0, 0]
wall.SetScalarBarVisibility(view, True)

title = simple.Text(Text=f"Path of the centre and its standard deviation (ellipsoids, {factor:.0f} times as large)")
label = simple.Show(title, view)
label.Color, label.FontSize, label.WindowLocation = [0.15, 0.15, 0.15], 22, "Upper Center"
simple.ResetCamera(view)
camera = simple.GetActiveCamera()
camera.Azimuth(30)
camera.Elevation(15)
camera.Dolly(1.4)
simple.Render(view)
simple.SaveScreenshot(picture, view)
