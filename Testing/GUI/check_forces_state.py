"""Breaks when Examples/gui/tracks_to_forces.py does not load as a state in ParaView's window, or does not end in the known drag."""
import os
import unittest

from paraview import simple

import rimflow_testing


class TestForcesState(unittest.TestCase):
    def test_the_loaded_pipeline(self):
        simple.LoadState(os.environ["RIMFLOW_GUI_STATE"])
        by_class = {proxy.SMProxy.GetXMLName(): proxy for proxy in simple.GetSources().values()}
        expected = {"InvisibleSphereLocator", "Omni3DPressure", "QCriterion", "STBTrackReader", "SurfaceForce", "VICSharpResample"}
        self.assertLessEqual(expected, set(by_class))
        force = by_class["SurfaceForce"]
        force.UpdatePipeline(by_class["STBTrackReader"].TimestepValues[8])
        row = simple.servermanager.Fetch(force, idx=1)
        self.assertAlmostEqual(row.GetColumnByName("Cd").GetValue(0), 1.09, delta=0.12)  # Examples/demo/README.md: Re = 100
        self.assertEqual(sorted(v.GetXMLName() for v in simple.GetViews()), ["RenderView", "SpreadSheetView"])


if __name__ == "__main__":
    rimflow_testing.main()
