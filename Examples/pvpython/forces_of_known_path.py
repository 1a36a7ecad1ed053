"""The trajectory comes from another program, and only the forces are wanted: pvpython forces_of_known_path.py TRACKS TRAJECTORY DENSITY VISCOSITY [STEP]

TRAJECTORY is a text file with the sphere's diameter and places (Documentation/file-formats.md, "Sphere trajectory"):
    VARIABLES = "Time" "x" "y" "z"
    DIAMETER=9.53[mm]
    43.132  1.837  -1.852  -1.159
Its times (s) are those of the tracks: FramePeriod, TimeShift of the reader below where they are not. Prints drag, lift and their
coefficients for every STEPth snapshot of the tracks (default 5). Density in kg/m3, kinematic viscosity in m2/s. A try, with the path that
`./rimflow process` writes:
    ./rimflow process Examples/demo/sphere.dat.gz --out path --diameter 9.53mm --no-forces
    PV_PLUGIN_PATH=build/lib/rimflow/plugins pvpython Examples/pvpython/forces_of_known_path.py Examples/demo/sphere.dat.gz path/trajectory.dat 1820 2.3825e-5
"""
import sys

from paraview import simple

fluid = {"Density": float(sys.argv[3]), "Viscosity": float(sys.argv[4])}
step = int(sys.argv[5]) if len(sys.argv) > 5 else 5

tracks = simple.STBTrackReader(FileNames=[sys.argv[1]])
path = simple.SphereTrajectoryReader(FileName=sys.argv[2])
sphere = simple.OutputPort(path, 0)
flow = simple.VICSharpResample(Particles=tracks, Body=sphere, Viscosity=fluid["Viscosity"])
pressure = simple.Omni3DPressure(Input=flow, Body=sphere, **fluid)
force = simple.SurfaceForce(Input=pressure, Body=sphere, **fluid)

print("    time [s]    drag [mN]   lift [mN]     Cd          Cl     Cd from momentum")
for time in list(tracks.TimestepValues)[step // 2::step]:
    force.UpdatePipeline(time)
    row = simple.servermanager.Fetch(force, idx=1)
    if row.GetNumberOfRows() == 0:
        continue  # an error, which ParaView has told
    value = {row.GetColumnName(c): row.GetValue(0, c) for c in range(row.GetNumberOfColumns())}
    drag, lift, cd, cl, momentum = (value[c].ToDouble() for c in ("drag_N", "lift_N", "Cd", "Cl", "Cd_cv"))
    sigma = value["sigma_drag_N"].ToDouble()
    print(f"{time:12.6f} {1e3 * drag:8.3f} +- {1e3 * sigma:.3f} {1e3 * lift:7.3f} {cd:9.3f} +- {cd * sigma / drag:.3f} {cl:7.3f} {momentum:12.3f}"
          f"   {value['note'].ToString()}")
