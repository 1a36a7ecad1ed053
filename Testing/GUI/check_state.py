"""Breaks when the clicks of locate_sphere.xml do not lead to a located sphere, a reconstructed flow, its pressure and the force, or a saved state does not
bring them back."""
import math
import os
import unittest

from paraview import simple

import rimflow_testing


class TestState(unittest.TestCase):
    def test_the_clicked_pipeline(self):
        simple.LoadState(os.environ["RIMFLOW_GUI_STATE"])
        by_class = {proxy.SMProxy.GetXMLName(): proxy for proxy in simple.GetSources().values()}
        self.assertEqual(sorted(by_class), ["InvisibleSphereLocator", "Omni3DPressure", "QCriterion", "STBTrackReader", "SurfaceForce", "VICSharpResample"])
        time = by_class["STBTrackReader"].TimestepValues[8]
        by_class["QCriterion"].UpdatePipeline(time)
        self.assertIsNotNone(by_class["QCriterion"].PointData["QCriterion"])
        force = by_class["SurfaceForce"]
        force.UpdatePipeline(time)
        self.assertIsNotNone(by_class["Omni3DPressure"].PointData["Pressure"])
        self.assertEqual(force.PointData["Pressure"].Name, "Pressure")
        self.assertGreater(simple.servermanager.Fetch(force, idx=1).GetColumnByName("drag_N").GetValue(0), 0)
        locator = by_class["InvisibleSphereLocator"]
        self.assertEqual(locator.Diameter, 0.00953)
        locator.UpdatePipeline(time)
        found = simple.servermanager.Fetch(locator, idx=1).GetPointData().GetArray("Centre").GetTuple3(0)
        step = 0.25 * (time - 43.1395)  # Examples/demo/README.md
        truth = [c + step * e for c, e in zip((1.7e-3, 0, -0.9e-3), (-0.0734415, 0.9876883, 0.1381234))]
        self.assertLess(math.dist(found, truth), 0.03 * 0.00953)


if __name__ == "__main__":
    rimflow_testing.main()
