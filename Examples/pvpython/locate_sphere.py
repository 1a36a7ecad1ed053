"""The invisible sphere in a few lines: pvpython locate_sphere.py TRACKS DIAMETER_IN_METRES

Prints the centre and its standard deviation per snapshot, and saves the trajectory. Run it with the plugin on ParaView's path:
    PV_PLUGIN_PATH=build/lib/rimflow/plugins pvpython Examples/pvpython/locate_sphere.py Examples/demo/sphere.dat.gz 0.00953
"""
import sys

from paraview import simple

tracks = simple.STBTrackReader(FileNames=[sys.argv[1]])
locator = simple.InvisibleSphereLocator(Particles=tracks, Diameter=float(sys.argv[2]))

for time in tracks.TimestepValues:
    centre = simple.OutputPort(locator, 1)
    locator.UpdatePipeline(time)
    row = simple.servermanager.Fetch(centre, idx=1).GetPointData()
    if row.GetNumberOfTuples() == 0:
        print(f"{time:.6f} s: lost")
        continue
    x, y, z = (1e3 * v for v in row.GetArray("Centre").GetTuple3(0))
    sigma = max(row.GetArray("Sigma").GetTuple3(0))
    print(f"{time:.6f} s: ({x:.4f}, {y:.4f}, {z:.4f}) mm, standard deviation {1e6 * sigma:.1f} um")

simple.SaveData("trajectory.vtp", proxy=simple.OutputPort(locator, 2))
