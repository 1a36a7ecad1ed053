"""The whole pipeline on the demo's tracks as a state for ParaView's window: sphere coloured by the pressure on it, its wake, the table of forces.

    ./rimflow gui, then File > Load State, this file; or, with the plugin loaded by itself, paraview --state=Examples/gui/tracks_to_forces.py

For tracks of your own change the five values below, or everything afterwards in the window.
"""
import pathlib

from paraview import simple


def demo_tracks():
    """Examples/demo/sphere.dat.gz above the plugin's file or the current folder: ParaView does not tell a state where it lies."""
    plugins = simple.servermanager.vtkSMProxyManager.GetProxyManager().GetPluginManager().GetLocalInformation()
    names = [plugins.GetPluginFileName(p) for p in range(plugins.GetNumberOfPlugins()) if plugins.GetPluginName(p) == "RIMFlow"]
    for place in [pathlib.Path(name) for name in names if name] + [pathlib.Path.cwd() / "here"]:
        for folder in place.resolve().parents:
            if (folder / "Examples" / "demo" / "sphere.dat.gz").exists():
                return str(folder / "Examples" / "demo" / "sphere.dat.gz")
    raise FileNotFoundError("Examples/demo/sphere.dat.gz is not found: load the plugin of a RIMFlow source tree, or set TRACKS in this state")


TRACKS = demo_tracks()
DIAMETER = 0.00953  # m
DENSITY = 1820  # of the fluid, kg/m3
VISCOSITY = 2.3825e-5  # kinematic, m2/s
BODY_DENSITY = 1190  # kg/m3

simple._DisableFirstRenderCameraReset()
tracks = simple.STBTrackReader(registrationName="Tracks", FileNames=[TRACKS])
locator = simple.InvisibleSphereLocator(registrationName="Sphere", Particles=tracks, Diameter=DIAMETER, ProcessAllTimes=1)
sphere = simple.OutputPort(locator, 0)
flow = simple.VICSharpResample(registrationName="Flow", Particles=tracks, Body=sphere, Viscosity=VISCOSITY)
vortices = simple.QCriterion(registrationName="Vortices", Input=flow, ComputeVorticity=1)
pressure = simple.Omni3DPressure(registrationName="Pressure", Input=vortices, Density=DENSITY, Viscosity=VISCOSITY)
force = simple.SurfaceForce(registrationName="Force", Input=pressure, Body=sphere, Density=DENSITY, Viscosity=VISCOSITY, BodyDensity=BODY_DENSITY)

scene = simple.GetAnimationScene()
scene.UpdateAnimationUsingDataTimeSteps()
time = tracks.TimestepValues[len(tracks.TimestepValues) // 2]
scene.AnimationTime = time

layout = simple.CreateLayout("Tracks to forces")
view = simple.CreateView("RenderView")
view.ViewTime = time
layout.AssignView(0, view)

surface = simple.Show(simple.OutputPort(force, 0), view)
simple.ColorBy(surface, ("POINTS", "Pressure"))
surface.RescaleTransferFunctionToDataRange(False)
surface.SetScalarBarVisibility(view, True)

body = simple.servermanager.Fetch(sphere).GetFieldData()
centre, velocity = (body.GetArray(name).GetTuple3(0) for name in ("Centre", "Velocity"))
speed = sum(v * v for v in velocity) ** 0.5
wake = simple.Slice(registrationName="Wake", Input=pressure, SliceType="Plane")
wake.SliceType.Origin, wake.SliceType.Normal = centre, [0, 0, 1]
plane = simple.Show(wake, view)
simple.ColorBy(plane, ("POINTS", "Velocity", "Magnitude"))
plane.RescaleTransferFunctionToDataRange(False)
plane.SetScalarBarVisibility(view, True)
path = simple.Show(simple.OutputPort(locator, 2), view)
path.ColorArrayName, path.LineWidth = ["POINTS", ""], 3

view.CameraFocalPoint = centre
view.CameraPosition = [c + 8 * DIAMETER * a for c, a in zip(centre, (0.3, 0.45, 0.85))]
view.CameraViewUp = [0, 1, 0]

table = simple.CreateView("SpreadSheetView")
layout.SplitVertical(0, 0.8)
layout.AssignView(2, table)
simple.Show(simple.OutputPort(force, 1), table)
simple.SetActiveView(view)
simple.SetActiveSource(force)
simple.Render(view)
