"""Breaks when the pipeline from tracks to the force on the sphere, as a user clicks it together, does not end in the known drag, when its
table cannot be plotted over time, or when a filter made from an updated input takes the wrong arrays."""
import math
import os
import unittest

from paraview import simple
from vtkmodules.util.numpy_support import vtk_to_numpy

import rimflow_testing

# Examples/demo/README.md: Re = 100, where Cd = 1.09
DIAMETER, FLUID, CD = 0.00953, {"Density": 1820, "Viscosity": 2.3825e-5}, 1.09


class Pipeline:
    def __init__(self, spacing):
        self.tracks = simple.STBTrackReader(FileNames=[os.path.join(rimflow_testing.SOURCE, "Examples", "demo", "sphere.dat.gz")])
        self.locator = simple.InvisibleSphereLocator(Particles=self.tracks, Diameter=DIAMETER, ProcessAllTimes=1)
        sphere = simple.OutputPort(self.locator, 0)
        self.flow = simple.VICSharpResample(Particles=self.tracks, Body=sphere, Viscosity=FLUID["Viscosity"], Spacing=spacing)
        self.vortices = simple.QCriterion(Input=self.flow)
        self.pressure = simple.Omni3DPressure(Input=self.vortices, **FLUID)
        self.force = simple.SurfaceForce(Input=self.pressure, Body=sphere, **FLUID)

    def row(self, time):
        self.force.UpdatePipeline(time)
        table = simple.servermanager.Fetch(self.force, idx=1)
        return {table.GetColumnName(c): table.GetValue(0, c).ToDouble() for c in range(table.GetNumberOfColumns())}


class TestForces(unittest.TestCase):
    def test_from_tracks_to_the_force_at_several_times(self):
        pipeline = Pipeline(0.0008)
        times = list(pipeline.tracks.TimestepValues)
        for time in (times[9], times[4]):
            row = pipeline.row(time)
            self.assertAlmostEqual(row["Time"], time)
            self.assertAlmostEqual(row["Cd"], CD, delta=0.15)
            self.assertAlmostEqual(row["Cd_cv"], CD, delta=0.1)
            self.assertLess(row["Cl"], 0.1)
            self.assertEqual(row["coverage"], 1)
            for name in ("Pressure", "PressureGradient", "PressureError", "QCriterion", "Mask"):
                self.assertIsNotNone(pipeline.pressure.PointData[name], name)
            surface = simple.servermanager.Fetch(pipeline.force, idx=0)
            pressure = vtk_to_numpy(surface.GetPointData().GetArray("Pressure"))
            normals = vtk_to_numpy(surface.GetPointData().GetArray("Normals"))
            velocity = vtk_to_numpy(surface.GetFieldData().GetArray("Velocity"))[0]
            # highest in front, where it is about the stagnation pressure, and lower behind
            ahead = normals @ velocity / math.hypot(*velocity)
            stagnation = FLUID["Density"] / 2 * (velocity @ velocity)
            front, back = pressure[ahead > 0.95].mean(), pressure[ahead < -0.95].mean()
            self.assertAlmostEqual((front - back) / stagnation, 1.2, delta=0.3)
            self.assertGreater(ahead[pressure.argmax()], 0.9)

    def test_plot_data_over_time(self):
        pipeline = Pipeline(0.002)
        plot = simple.PlotDataOverTime(Input=simple.OutputPort(pipeline.force, 1), FieldAssociation="Rows", OnlyReportSelectionStatistics=0)
        plot.UpdatePipeline()
        table = simple.servermanager.Fetch(plot).GetBlock(0)
        self.assertEqual(table.GetNumberOfRows(), 16)
        drag = vtk_to_numpy(table.GetColumnByName("drag_N"))
        time = vtk_to_numpy(table.GetColumnByName("Time"))
        self.assertTrue((drag > 0.5 * CD * 1820 / 2 * 0.25**2 * math.pi / 4 * DIAMETER**2).all())
        for found, expected in zip(time, pipeline.tracks.TimestepValues):
            self.assertAlmostEqual(found, expected)

    def test_arrays_go_by_name_when_the_input_is_known_already(self):
        # ParaView offers the active vectors, the velocity, for every array: then acceleration would be velocity
        tracks = simple.SyntheticTracks(Density=3e7, NumberOfSnapshots=3)
        tracks.UpdatePipeline(tracks.TimestepValues[1])
        flow = simple.VICSharpResample(Particles=tracks, MaximumIterations=5)
        flow.UpdatePipeline(tracks.TimestepValues[1])
        self.assertEqual(list(flow.AccelerationArray), ["POINTS", "(by name)"])
        measured = vtk_to_numpy(simple.servermanager.Fetch(tracks).GetPointData().GetArray("Acceleration"))
        found = vtk_to_numpy(simple.servermanager.Fetch(flow).GetPointData().GetArray("MaterialAcceleration"))
        self.assertGreater((found**2).mean(), 0.01 * (measured**2).mean())
        pressure = simple.Omni3DPressure(Input=flow)
        pressure.UpdatePipeline(tracks.TimestepValues[1])
        image = simple.servermanager.Fetch(pressure).GetPointData()
        gradient, acceleration = (vtk_to_numpy(image.GetArray(name)) for name in ("PressureGradient", "MaterialAcceleration"))
        difference = gradient + 1820 * acceleration  # but for the viscous part
        self.assertLess((difference**2).mean(), 0.05 * (gradient**2).mean())
        vortices = simple.QCriterion(Input=pressure)  # its scalars are the active ones now
        vortices.UpdatePipeline(tracks.TimestepValues[1])
        force = simple.SurfaceForce(Input=vortices, Body=tracks)
        for name in ("VelocityArray", "AccelerationArray", "PressureArray", "PressureGradientArray"):
            self.assertEqual(list(getattr(force, name)), ["POINTS", "(by name)"])


if __name__ == "__main__":
    rimflow_testing.main()
