"""The smoothed path of the sphere, and the path as a file: pvpython path_as_file.py TRACKS DIAMETER_IN_METRES PICTURE.png PATH.dat

Finds the sphere in all snapshots, writes the path as a text file that other programs read, reads that back with the Sphere Trajectory Reader,
and draws single snapshots, smoothed path and file as deviations from a straight line. Needs no display.
    PV_PLUGIN_PATH=build/lib/rimflow/plugins pvpython Examples/pvpython/path_as_file.py Examples/demo/sphere.dat.gz 0.00953 path.png path.dat
"""
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from paraview import simple
from vtkmodules.util.numpy_support import vtk_to_numpy

name, diameter, picture, target = sys.argv[1], float(sys.argv[2]), sys.argv[3], sys.argv[4]

tracks = simple.STBTrackReader(FileNames=[name])
locator = simple.InvisibleSphereLocator(Particles=tracks, Diameter=diameter, ProcessAllTimes=1)
last = tracks.TimestepValues[-1]
locator.UpdatePipeline(last)
simple.SaveData(target, proxy=simple.OutputPort(locator, 2))
file = simple.SphereTrajectoryReader(FileName=target)
file.UpdatePipeline(last)


def path(source, port, *arrays):
    points = simple.servermanager.Fetch(source, idx=port).GetPointData()
    return [vtk_to_numpy(points.GetArray(array)) for array in arrays]


time, single, centre, sigma = path(locator, 2, "Time", "RawCentre", "Centre", "Sigma")
file_time, file_centre = path(file, 2, "Time", "Centre")
scatter = np.sqrt(np.mean((single - centre)**2))
print(f"{len(time)} snapshots; single ones are {1e6 * scatter:.1f} um per axis from the smoothed path, whose standard deviation is {1e6 * sigma.mean():.1f} um")
print(f"the path that was read back from {target} differs by {1e9 * np.abs(file_centre - centre).max():.3f} nm at most")

figure, axes = plt.subplots(3, 1, figsize=(9, 8), sharex=True, layout="constrained")
for a, ax in enumerate(axes):
    line = np.polyfit(time - time.mean(), centre[:, a], 1)
    beside = lambda t, x: 1e6 * (x - np.polyval(line, t - time.mean()))
    ax.plot(time, beside(time, single[:, a]), "+", color="0.35", label="single snapshots")
    ax.plot(time, beside(time, centre[:, a]), color="#33609e", label="smoothed")
    ax.fill_between(time, beside(time, centre[:, a] - sigma[:, a]), beside(time, centre[:, a] + sigma[:, a]), color="#33609e", alpha=0.2, lw=0)
    ax.plot(file_time, beside(file_time, file_centre[:, a]), ".", color="#c1433c", label="read back from the file")
    ax.set_ylabel(f"{'xyz'[a]} less a straight line [um]")
    ax.grid(alpha=0.3)
axes[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1), ncols=3, frameon=False)
axes[-1].set_xlabel("time [s]")
axes[-1].ticklabel_format(axis="x", useOffset=False)
figure.savefig(picture, dpi=100)
