"""From tracks to the force on the sphere on many processes: each rank takes its part of the snapshots, the first one writes the table.

    export PYTHONPATH=build/lib/python3.11/site-packages
    mpirun -np 4 pvbatch --sym Examples/pvbatch/forces_in_parallel.py Examples/demo/sphere.dat.gz 0.00953 1820 2.3825e-5 forces.csv

After the tracks and the sphere's diameter (m): density (kg/m3) and kinematic viscosity (m2/s) of the fluid, the table to write, and
optionally STEP, to take every STEPth snapshot only. Start from here when you want to do something of your own with each snapshot;
`./rimflow process --ranks 4` shares the path among the ranks, too.
"""
import csv
import sys

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDoubleArray
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkParallelCore import vtkMultiProcessController

from rimflow.vtkRIMFlowFilters import vtkInvisibleSphereLocator, vtkOmni3DPressure, vtkSurfaceForce, vtkVICSharpResample
from rimflow.vtkRIMFlowReaders import vtkSTBTrackReader

tracks, diameter, density, viscosity, target = sys.argv[1], *map(float, sys.argv[2:5]), sys.argv[5]
step = int(sys.argv[6]) if len(sys.argv) > 6 else 1
MARGIN = 30  # snapshots before and after a rank's own, for the path: its ends are less certain

# The classes themselves, not ParaView's proxies: these would wait for the other ranks at every step.
reader, locator, flow, pressure, force = vtkSTBTrackReader(), vtkInvisibleSphereLocator(), vtkVICSharpResample(), vtkOmni3DPressure(), vtkSurfaceForce()
reader.AddFileName(tracks)
locator.SetInputConnection(reader.GetOutputPort())
locator.SetDiameter(diameter)
flow.SetInputConnection(0, reader.GetOutputPort())
flow.SetInputConnection(1, locator.GetOutputPort(0))
pressure.SetInputConnection(flow.GetOutputPort())
force.SetInputConnection(0, pressure.GetOutputPort())
force.SetInputConnection(1, locator.GetOutputPort(0))
for part in (pressure, force):
    part.SetDensity(density)
for part in (flow, pressure, force):
    part.SetViscosity(viscosity)

controller = vtkMultiProcessController.GetGlobalController()
rank, ranks = controller.GetLocalProcessId(), controller.GetNumberOfProcesses()
reader.UpdateInformation()
times = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
mine = range(len(times))[step // 2::step]
if len(mine) < ranks:
    sys.exit(f"{ranks} ranks are too many for {len(mine)} snapshots")
mine = mine[rank * len(mine) // ranks:(rank + 1) * len(mine) // ranks]

for time in times[max(0, mine[0] - MARGIN):mine[-1] + 1 + MARGIN]:
    locator.UpdateTimeStep(time)
names, rows = [], []
for time in (times[k] for k in mine):  # the path is known now, so that each snapshot has the sphere's velocity
    force.UpdateTimeStep(time)
    table = force.GetOutputDataObject(1)
    if table.GetNumberOfRows():  # else an error, which VTK has told
        columns = [table.GetColumn(c) for c in range(table.GetNumberOfColumns()) if table.GetColumn(c).IsNumeric()]
        names = [column.GetName() for column in columns]
        rows.append([column.GetTuple1(0) for column in columns])

sent, all_rows = numpy_to_vtk(np.ravel(np.array(rows, float)), deep=True), vtkDoubleArray()
controller.GatherV(sent, all_rows, 0)
if rank == 0 and names:
    with open(target, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(vtk_to_numpy(all_rows).reshape(-1, len(names)))
    print(f"{ranks} ranks: the forces in {all_rows.GetNumberOfValues() // len(names)} snapshots are in {target}")
