"""The invisible sphere on many processes: each rank takes its part of the snapshots, the first one smooths and saves the path.

    export PYTHONPATH=build/lib/python3.11/site-packages
    mpirun -np 4 pvbatch --sym Examples/pvbatch/locate_in_parallel.py Examples/demo/sphere.dat.gz 0.00953 trajectory.vtp

`./rimflow process --ranks 4` does the same and more. Start from here when you want to do something else with each snapshot.
"""
import sys

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDoubleArray, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkPolyData
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter
from vtkmodules.vtkParallelCore import vtkMultiProcessController

from rimflow.vtkRIMFlowFilters import vtkInvisibleSphereLocator, vtkTrajectorySmoother
from rimflow.vtkRIMFlowReaders import vtkSTBTrackReader

COLUMNS = {"Time": 1, "Status": 1, "Centre": 3, "Covariance": 6}
tracks, diameter, target = sys.argv[1], float(sys.argv[2]), sys.argv[3]

# The classes themselves, not ParaView's proxies: these would wait for the other ranks at every step.
reader, locator = vtkSTBTrackReader(), vtkInvisibleSphereLocator()
reader.AddFileName(tracks)
locator.SetInputConnection(reader.GetOutputPort())
locator.SetDiameter(diameter)

controller = vtkMultiProcessController.GetGlobalController()
rank, ranks = controller.GetLocalProcessId(), controller.GetNumberOfProcesses()
reader.UpdateInformation()
times = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
first, end = rank * len(times) // ranks, (rank + 1) * len(times) // ranks

rows = []
for time in times[first:end]:  # neighbours stay together, because each find says where to look in the next
    locator.UpdateTimeStep(time)
    centre = locator.GetOutputDataObject(1).GetPointData()
    if centre.GetNumberOfTuples():
        rows.append(np.concatenate([vtk_to_numpy(centre.GetArray(name)).ravel() for name in COLUMNS]))
    else:
        rows.append([time, 2, *[np.nan] * 9])

mine, all_rows = numpy_to_vtk(np.ravel(np.array(rows, float)), deep=True), vtkDoubleArray()
controller.GatherV(mine, all_rows, 0)
if rank == 0:
    table = vtk_to_numpy(all_rows).reshape(-1, sum(COLUMNS.values()))
    data, points, column = vtkPolyData(), vtkPoints(), 0
    for name, width in COLUMNS.items():
        array = numpy_to_vtk(np.ascontiguousarray(table[:, column:column + width]), deep=True)
        array.SetName(name)
        data.GetPointData().AddArray(array)
        column += width
    points.SetData(numpy_to_vtk(np.nan_to_num(table[:, 2:5]), deep=True))
    data.SetPoints(points)

    smoother, writer = vtkTrajectorySmoother(), vtkXMLPolyDataWriter()
    smoother.SetInputData(data)
    smoother.SetLargestPredictionSigma(0.5 * diameter)
    writer.SetInputConnection(smoother.GetOutputPort())
    writer.SetDataModeToBinary()
    writer.SetFileName(target)
    writer.Write()
    print(f"{ranks} ranks: found in {np.sum(table[:, 1] == 0)} of {len(table)} snapshots; the path is in {target}")
