"""Breaks when stepping through time, undo and redo, or saving and opening a state in the window changes the pipeline, the time or the first colours."""
import os
import unittest

from paraview import simple

import rimflow_testing

FOLDER = os.environ["RIMFLOW_GUI_DIR"]


class TestReloaded(unittest.TestCase):
    def test_a_state_that_was_saved_opened_and_saved_again(self):
        for name, time in (("scrubbed", 43.136), ("reloaded", 43.138)):
            simple.ResetSession()
            simple.LoadPlugin(os.environ["RIMFLOW_PLUGIN"], remote=False, ns=simple.__dict__)
            simple.LoadState(os.path.join(FOLDER, name + ".pvsm"))
            sources = {proxy.SMProxy.GetXMLName(): proxy for proxy in simple.GetSources().values()}
            self.assertEqual(sorted(sources), ["InvisibleSphereLocator", "STBTrackReader"])
            self.assertEqual(sources["InvisibleSphereLocator"].Diameter, 0.00953)
            view = simple.GetViews()[0]
            self.assertAlmostEqual(view.ViewTime, time, places=9)
            self.assertEqual(list(simple.GetDisplayProperties(sources["STBTrackReader"], view).ColorArrayName)[:2], ["POINTS", "Velocity"])
            sources["InvisibleSphereLocator"].UpdatePipeline(time)
            centre = simple.servermanager.Fetch(sources["InvisibleSphereLocator"], idx=1)
            self.assertEqual(centre.GetPointData().GetArray("Status").GetValue(0), 0)

    def test_tracks_are_coloured_by_speed_at_once(self):
        tracks = simple.SyntheticTracks(Density=2e7, NumberOfSnapshots=1)
        self.assertEqual(list(simple.Show(tracks).ColorArrayName), ["POINTS", "Velocity"])


if __name__ == "__main__":
    rimflow_testing.main()
