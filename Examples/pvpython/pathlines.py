"""The tracks of a whole recording as lines, coloured by their speed: pvpython pathlines.py SHORTEST PICTURE.png TRACKS...

Any track format; tracks with fewer than SHORTEST snapshots are left out. Prints what is known of the tracks and their noise. Rendering needs a
display; without one:
    ./rimflow with-display env PV_PLUGIN_PATH=build/lib/rimflow/plugins pvpython Examples/pvpython/pathlines.py 12 pathlines.png Examples/demo/sphere.dat.gz
"""
import sys

from paraview import simple

shortest, picture, names = int(sys.argv[1]), sys.argv[2], sys.argv[3:]
# Files with frame numbers need FramePeriod=..., those without velocities get estimated ones.
tracks = simple.STBTrackReader(FileNames=names, OutputMode="Pathlines", TrailLength=0, MinimumTrackLength=shortest, TrackStatistics=1)
tracks.UpdatePipeline(tracks.TimestepValues[0])

field, points = tracks.FieldData, tracks.PointData
noise = {name: field[name].GetRange()[0] for name in ("PositionNoise", "VelocityNoise", "AccelerationNoise") if name in field.keys()}
longest = points["TrackLength"].GetRange()[1]
print(f"{tracks.GetDataInformation().GetNumberOfCells()} lines in {len(tracks.TimestepValues)} snapshots, the longest with {longest:.0f} points")
print("noise: " + ", ".join(f"{name} {value:.3g}" for name, value in noise.items()))

view = simple.CreateView("RenderView")
view.ViewSize = [1000, 1000]
view.UseColorPaletteForBackground, view.Background = 0, [1, 1, 1]
lines = simple.Show(tracks, view)
lines.LineWidth = 1.5
simple.ColorBy(lines, ("POINTS", "Velocity", "Magnitude"))
colours = simple.GetColorTransferFunction("Velocity")
colours.ApplyPreset("Viridis (matplotlib)", True)
bar = simple.GetScalarBar(colours, view)
bar.Title, bar.ComponentTitle, bar.TitleColor, bar.LabelColor = "speed [m/s]", "", [0, 0, 0], [0, 0, 0]
lines.SetScalarBarVisibility(view, True)
simple.ResetCamera(view)
camera = simple.GetActiveCamera()
camera.Azimuth(20)
camera.Elevation(10)
camera.Dolly(1.3)
simple.Render(view)
simple.SaveScreenshot(picture, view)
