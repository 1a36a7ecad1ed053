"""Breaks when the QCriterion proxy, its properties or its default array cannot be used from pvpython."""
import unittest

from paraview import simple

import rimflow_testing


class TestQCriterion(unittest.TestCase):
    def rotation(self):
        wavelet = simple.Wavelet()
        return simple.Calculator(Input=wavelet, ResultArrayName="Velocity", Function="coordsY*iHat-coordsX*jHat")

    def test_defaults_find_the_velocity_before_the_input_was_updated(self):
        q = simple.QCriterion(Input=self.rotation())
        q.UpdatePipeline()
        low, high = q.PointData["QCriterion"].GetRange()
        self.assertAlmostEqual(low, 1.0, 5)
        self.assertAlmostEqual(high, 1.0, 5)

    def test_extra_outputs(self):
        q = simple.QCriterion(Input=self.rotation(), Order=4, ComputeVorticity=1, ComputeLambda2=1, ComputeDivergence=1)
        q.UpdatePipeline()
        self.assertAlmostEqual(q.PointData["Vorticity"].GetRange(2)[0], -2.0, 4)
        self.assertAlmostEqual(q.PointData["Lambda2"].GetRange()[1], -1.0, 4)
        self.assertAlmostEqual(q.PointData["Divergence"].GetRange()[1], 0.0, 4)

    def test_wrapped_class(self):
        from rimflow.vtkRIMFlowFilters import vtkQCriterion

        self.assertEqual(vtkQCriterion().GetOrder(), 2)


if __name__ == "__main__":
    rimflow_testing.main()
