"""The locator as a user of the VTK classes calls it, and what it found as plain numbers."""
from dataclasses import dataclass

import numpy as np
from rimflow.vtkRIMFlowFilters import vtkInvisibleSphereLocator, vtkQCriterion, vtkVICSharpResample
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import VTK_STRING
from vtkmodules.vtkCommonDataModel import vtkDataObject

VOID, PUBLISHED = "void likelihood", "published cost"


@dataclass
class Estimate:
    value: np.ndarray       # of the centre, m, or of the velocity, m/s
    covariance: np.ndarray  # 3 x 3


def full(packed):
    """xx yy zz xy yz xz -> 3 x 3."""
    xx, yy, zz, xy, yz, xz = packed
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def array(data, name):
    return vtk_to_numpy(data.GetPointData().GetArray(name)).astype(float)


class Chain:
    """Particles -> locator; for the published cost with the flow that it needs: particles -> VIC# -> Q-criterion -> locator."""

    def __init__(self, method, diameter, viscosity, guess=None):
        self.locator, self.messages, self.flow = vtkInvisibleSphereLocator(), [], None
        self.locator.SetDiameter(diameter)
        if guess is not None:
            self.locator.UseInitialGuessOn()
            self.locator.SetInitialGuess(guess)
        if method == PUBLISHED:
            self.locator.SetMethodToPublishedCost()
            self.flow, vortices = vtkVICSharpResample(), vtkQCriterion()
            self.flow.SetViscosity(viscosity)
            vortices.SetInputConnection(self.flow.GetOutputPort())
            self.locator.SetInputConnection(1, vortices.GetOutputPort())
            self._watch(self.flow, vortices)
        self._watch(self.locator)

    def _watch(self, *algorithms):
        def heard(_, __, text):
            self.messages.append(text.strip())

        heard.CallDataType = VTK_STRING
        for a in algorithms:
            a.AddObserver("ErrorEvent", heard)
            a.GetExecutive().AddObserver("ErrorEvent", heard)

    def connect(self, source):
        for f in (self.locator, self.flow):
            if f:
                f.SetInputConnection(0, source.GetOutputPort())

    def set_particles(self, data):
        for f in (self.locator, self.flow):
            if f:
                f.SetInputData(0, data)

    def update(self, time=None):
        self.locator.Update() if time is None else self.locator.UpdateTimeStep(time)
        if self.messages:
            raise RuntimeError("; ".join(dict.fromkeys(self.messages)))

    def scale_spacing(self, factor):
        """The flow's grid spacing in units of the filter's own choice."""
        if self.flow and factor != 1:
            self.flow.UpdateInformation()
            self.flow.SetSpacing(factor * self.flow.GetOutputInformation(0).Get(vtkDataObject.SPACING())[0])

    def spacing(self):
        return self.flow.GetOutput().GetSpacing()[0] if self.flow else 0.0

    def centres(self):
        """What the snapshot on show says by itself: one Estimate per sphere found."""
        return [e for _, e in estimates(self.locator.GetOutputDataObject(1), "Centre", "Covariance")]

    def trajectory(self):
        """(time, centre), (time, velocity) of the smoothed trajectory."""
        data = self.locator.GetOutputDataObject(2)
        return estimates(data, "Centre", "Covariance"), estimates(data, "Velocity", "VelocityCovariance")


def estimates(data, name, covariance):
    """(time, Estimate) per point."""
    if not data.GetNumberOfPoints():
        return []
    return [(t, Estimate(v, full(c))) for t, v, c in zip(array(data, "Time"), array(data, name), array(data, covariance))]
