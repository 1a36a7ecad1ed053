"""The flow around the sphere on a grid: pvpython flow_fields.py TRACKS DIAMETER_IN_METRES DENSITY VISCOSITY PICTURE.png [TIME]

Prints how far the reconstruction can be believed, and draws speed, Q-criterion and pressure in the plane through the sphere's centre (at
TIME, else in the middle of the recording). Density in kg/m3, kinematic viscosity in m2/s. Rendering needs a display; without one:
    ./rimflow with-display env PV_PLUGIN_PATH=build/lib/rimflow/plugins pvpython Examples/pvpython/flow_fields.py Examples/demo/sphere.dat.gz 0.00953 1820 2.3825e-5 flow-fields.png
"""
import sys

from paraview import simple

name, diameter, density, viscosity, picture = sys.argv[1], *map(float, sys.argv[2:5]), sys.argv[5]

tracks = simple.STBTrackReader(FileNames=[name])
times = list(tracks.TimestepValues)
time = float(sys.argv[6]) if len(sys.argv) > 6 else times[len(times) // 2]
locator = simple.InvisibleSphereLocator(Particles=tracks, Diameter=diameter, ProcessAllTimes=1)
sphere = simple.OutputPort(locator, 0)
flow = simple.VICSharpResample(Particles=tracks, Body=sphere, Viscosity=viscosity)
vortices = simple.QCriterion(Input=flow, Order=4)
pressure = simple.Omni3DPressure(Input=vortices, Density=density, Viscosity=viscosity)
pressure.UpdatePipeline(time)

quality = simple.servermanager.Fetch(flow).GetFieldData()
for array, meaning in (("MisfitVelocity", "misfit of the velocities, noise levels"), ("MisfitAcceleration", "misfit of the accelerations, noise levels"),
                       ("VelocityNoise", "noise of the velocities, m/s"), ("Outliers", "ghosts left out"), ("ParticlesUsed", "particles used")):
    print(f"{meaning}: {quality.GetArray(array).GetTuple1(0):.4g}")
curl = simple.servermanager.Fetch(pressure).GetFieldData().GetArray("CurlResidual").GetTuple1(0)
print(f"pressure gradient that no pressure explains: {100 * curl:.0f} %")

body = simple.servermanager.Fetch(sphere).GetFieldData()
centre, velocity = (body.GetArray(array).GetTuple3(0) for array in ("Centre", "Velocity"))
speed = sum(v * v for v in velocity) ** 0.5
section = simple.Slice(Input=pressure, SliceType="Plane")
section.SliceType.Origin, section.SliceType.Normal = centre, [0, 0, 1]

gradient, dynamic = speed / diameter, 0.5 * density * speed**2
panels = (("Velocity", "Magnitude", "speed of the fluid [m/s]", "Viridis (matplotlib)", 0, speed),
          ("QCriterion", None, "Q-criterion [1/s2]", "Cool to Warm", -2 * gradient**2, 2 * gradient**2),
          ("Pressure", None, "pressure [Pa]", "Cool to Warm", -0.7 * dynamic, 0.7 * dynamic))
simple._DisableFirstRenderCameraReset()
layout = simple.CreateLayout("Flow")
left = layout.SplitHorizontal(0, 1 / 3)
middle = layout.SplitHorizontal(left + 1, 1 / 2)
for place, (array, component, title, preset, low, high) in zip((left, middle, middle + 1), panels):
    view = simple.CreateView("RenderView")
    view.UseColorPaletteForBackground, view.Background, view.OrientationAxesVisibility, view.ViewTime = 0, [1, 1, 1], 0, time
    simple.AssignViewToLayout(view, layout, place)
    shown = simple.Show(section, view)
    simple.ColorBy(shown, ("POINTS", array, component) if component else ("POINTS", array))
    colours = simple.GetColorTransferFunction(array)
    colours.ApplyPreset(preset, True)
    colours.RescaleTransferFunction(low, high)
    shown.Ambient, shown.Diffuse = 1, 0  # the colours of the scale, without light and shade
    bar = simple.GetScalarBar(colours, view)
    bar.Title, bar.ComponentTitle, bar.TitleColor, bar.LabelColor = title, "", [0, 0, 0], [0, 0, 0]
    bar.Orientation, bar.WindowLocation, bar.ScalarBarLength = "Horizontal", "Lower Center", 0.6
    bar.TitleFontSize, bar.LabelFontSize = 24, 20
    shown.SetScalarBarVisibility(view, True)
    ball = simple.Show(sphere, view)
    ball.ColorArrayName, ball.DiffuseColor = ["POINTS", ""], [0.85, 0.85, 0.82]
    view.CameraParallelProjection, view.CameraParallelScale = 1, 2.3 * diameter
    view.CameraFocalPoint = [c - 0.9 * diameter * v / speed for c, v in zip(centre, velocity)]
    view.CameraPosition = [view.CameraFocalPoint[0], view.CameraFocalPoint[1], view.CameraFocalPoint[2] + 10 * diameter]
    view.CameraViewUp = [0, 1, 0]
layout.SetSize(1800, 900)
simple.SaveScreenshot(picture, layout, ImageResolution=[1800, 900])
