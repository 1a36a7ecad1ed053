"""From tracks to the force on the sphere: pvpython forces.py TRACKS DIAMETER_IN_METRES DENSITY VISCOSITY PICTURE.png [STEP]

Prints drag, lift and their coefficients for every STEPth snapshot (default 5): from pressure and friction on the surface, with standard
deviations, and beside them from the momentum around the sphere. Draws the sphere coloured by the pressure on it, with its wake. Density
in kg/m3, kinematic viscosity in m2/s. Rendering needs a display; without one:
    ./rimflow with-display env PV_PLUGIN_PATH=build/lib/rimflow/plugins pvpython Examples/pvpython/forces.py Examples/demo/sphere.dat.gz 0.00953 1820 2.3825e-5 forces.png
"""
import sys

from paraview import simple

name, diameter, density, viscosity, picture = sys.argv[1], *map(float, sys.argv[2:5]), sys.argv[5]
step = int(sys.argv[6]) if len(sys.argv) > 6 else 5
fluid = {"Density": density, "Viscosity": viscosity}

tracks = simple.STBTrackReader(FileNames=[name])
locator = simple.InvisibleSphereLocator(Particles=tracks, Diameter=diameter, ProcessAllTimes=1)
sphere = simple.OutputPort(locator, 0)
flow = simple.VICSharpResample(Particles=tracks, Body=sphere, Viscosity=viscosity)
pressure = simple.Omni3DPressure(Input=flow, **fluid)
force = simple.SurfaceForce(Input=pressure, Body=sphere, **fluid)
surface = simple.OutputPort(force, 0)

print("    time [s]    drag [mN]   lift [mN]     Cd          Cl     Cd from momentum   surface seen")
for time in list(tracks.TimestepValues)[step // 2::step]:
    force.UpdatePipeline(time)
    row = simple.servermanager.Fetch(force, idx=1)
    if row.GetNumberOfRows() == 0:
        continue  # an error, which ParaView has told
    value = {row.GetColumnName(c): row.GetValue(0, c) for c in range(row.GetNumberOfColumns())}
    drag, lift, cd, cl, momentum, seen = (value[c].ToDouble() for c in ("drag_N", "lift_N", "Cd", "Cl", "Cd_cv", "coverage"))
    sigma = value["sigma_drag_N"].ToDouble()
    print(f"{time:12.6f} {1e3 * drag:8.3f} +- {1e3 * sigma:.3f} {1e3 * lift:7.3f} {cd:9.3f} +- {cd * sigma / drag:.3f} {cl:7.3f} {momentum:12.3f}"
          f" {seen:18.0%}  {value['note'].ToString()}")

# The picture shows the last of these snapshots.
view = simple.CreateView("RenderView")
view.ViewSize = [1400, 1050]
view.UseColorPaletteForBackground, view.Background = 0, [1, 1, 1]
view.OrientationAxesVisibility = 0
view.ViewTime = time

shown = simple.Show(surface, view)
simple.ColorBy(shown, ("POINTS", "Pressure"))
shown.RescaleTransferFunctionToDataRange(False)
bar = simple.GetScalarBar(simple.GetColorTransferFunction("Pressure"), view)
bar.Title, bar.ComponentTitle, bar.TitleColor, bar.LabelColor = "pressure on the sphere [Pa]", "", [0, 0, 0], [0, 0, 0]
shown.SetScalarBarVisibility(view, True)

# the wake: the speed of the fluid in a plane through the sphere
body = simple.servermanager.Fetch(sphere).GetFieldData()
centre, velocity = (body.GetArray(name).GetTuple3(0) for name in ("Centre", "Velocity"))
speed = sum(v * v for v in velocity) ** 0.5
section = simple.Slice(Input=pressure, SliceType="Plane")
section.SliceType.Origin, section.SliceType.Normal = centre, [0, 0, 1]
plane = simple.Show(section, view)
simple.ColorBy(plane, ("POINTS", "Velocity", "Magnitude"))
colours = simple.GetColorTransferFunction("Velocity")
colours.ColorSpace, colours.RGBPoints = "Lab", [0, 0.97, 0.97, 0.97, speed, 0.1, 0.3, 0.4]
plane.Ambient, plane.Diffuse = 1, 0
speeds = simple.GetScalarBar(colours, view)
speeds.Title, speeds.ComponentTitle, speeds.TitleColor, speeds.LabelColor = "speed of the fluid [m/s]", "", [0, 0, 0], [0, 0, 0]
speeds.WindowLocation = "Lower Left Corner"
plane.SetScalarBarVisibility(view, True)

view.CameraFocalPoint = [c - 0.7 * diameter * v / speed for c, v in zip(centre, velocity)]
view.CameraPosition = [f + 8 * diameter * a for f, a in zip(view.CameraFocalPoint, (0.3, 0.45, 0.85))]
view.CameraViewUp = [0, 1, 0]
simple.Render(view)
simple.SaveScreenshot(picture, view)
