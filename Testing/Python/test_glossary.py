"""Breaks when a reader or filter gives an array that Documentation/glossary.md does not name, or a force without a place in filters.md."""
import os
import unittest

import rimflow_testing
from paraview import simple


def page(name):
    with open(os.path.join(rimflow_testing.SOURCE, "Documentation", name), encoding="utf-8") as f:
        return f.read()


def names(attributes):
    return {attributes.GetAbstractArray(i).GetName() for i in range(attributes.GetNumberOfArrays())}


class TestGlossary(unittest.TestCase):
    def test_every_array_is_there(self):
        tracks = simple.SyntheticTracks(Density=1e8, NumberOfSnapshots=4, AddTruth=1)
        files = simple.STBTrackReader(FileNames=[os.path.join(rimflow_testing.SOURCE, "Examples", "demo", "sphere.dat.gz")], TrackStatistics=1)
        locator = simple.InvisibleSphereLocator(Particles=tracks, Diameter=0.01111, ProcessAllTimes=1)
        sphere = simple.OutputPort(locator, 0)
        flow = simple.VICSharpResample(Particles=tracks, Body=sphere, Spacing=0.003)
        vortices = simple.QCriterion(Input=flow, ComputeLambda2=1, ComputeDivergence=1)
        pressure = simple.Omni3DPressure(Input=vortices)
        force = simple.SurfaceForce(Input=pressure, Body=sphere)
        smoother = simple.TrajectorySmoother(Input=simple.OutputPort(locator, 2))
        found, glossary, forces = set(), page("glossary.md"), page("filters.md")
        for proxy, ports in ((tracks, 1), (files, 1), (locator, 4), (pressure, 1), (force, 1), (smoother, 1)):
            proxy.UpdatePipeline(proxy.TimestepValues[1] if proxy is files else 0.001)
            for port in range(ports):
                data = simple.servermanager.Fetch(proxy, idx=port)
                found |= names(data.GetPointData()) | (names(data.GetFieldData()) if proxy is not force else set())
        self.assertGreater(len(found), 60)
        self.assertFalse({name for name in found if f"`{name}`" not in glossary})
        columns = names(simple.servermanager.Fetch(force, idx=1).GetRowData())
        known = lambda c: f"`{c}`" in forces or c.startswith("sigma_") or f"`{c.replace('_y', '_x').replace('_z', '_x')}`" in forces
        self.assertFalse({c for c in columns if not known(c)})


if __name__ == "__main__":
    rimflow_testing.main()
