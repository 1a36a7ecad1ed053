"""Particles as the filters take them, from arrays."""
import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkDataObject, vtkPolyData
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline


def particle_data(x, **arrays):
    """One vertex per particle at x [n, 3] in m; `arrays`: its point arrays by name, stored as floats."""
    data, points = vtkPolyData(), vtkPoints()
    points.SetDataTypeToDouble()
    points.SetData(numpy_to_vtk(np.ascontiguousarray(x), deep=True))
    data.SetPoints(points)
    ids = np.stack([np.ones(len(x), np.int64), np.arange(len(x))], 1).ravel()
    cells = vtkCellArray()
    cells.ImportLegacyFormat(numpy_to_vtk(ids, deep=True, array_type=12))
    data.SetVerts(cells)
    for name, values in arrays.items():
        array = numpy_to_vtk(np.ascontiguousarray(values, np.float32), deep=True)
        array.SetName(name)
        data.GetPointData().AddArray(array)
    return data


class Series(VTKPythonAlgorithmBase):
    """A source of snapshots: snapshot(i) gives the vtkPolyData at times[i]."""

    def __init__(self, times, snapshot):
        super().__init__(nInputPorts=0, nOutputPorts=1, outputType="vtkPolyData")
        self.times, self.snapshot = [float(t) for t in times], snapshot

    def RequestInformation(self, request, inputs, outputs):
        info = outputs.GetInformationObject(0)
        info.Set(vtkStreamingDemandDrivenPipeline.TIME_STEPS(), self.times, len(self.times))
        info.Set(vtkStreamingDemandDrivenPipeline.TIME_RANGE(), [self.times[0], self.times[-1]], 2)
        return 1

    def RequestData(self, request, inputs, outputs):
        info = outputs.GetInformationObject(0)
        asked = info.Get(vtkStreamingDemandDrivenPipeline.UPDATE_TIME_STEP()) if info.Has(vtkStreamingDemandDrivenPipeline.UPDATE_TIME_STEP()) else self.times[0]
        i = int(np.argmin(np.abs(np.array(self.times) - asked)))
        data = self.GetOutputData(outputs, 0)
        data.ShallowCopy(self.snapshot(i))
        data.GetInformation().Set(vtkDataObject.DATA_TIME_STEP(), self.times[i])
        return 1
