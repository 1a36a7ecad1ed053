"""Breaks when a person needs more than ten clicks from the tracks to the plot of the drag, or when the plot, a saved state or the trace of these
clicks does not hold the drag of the demo (its tracks come from a flow with Cd = 1.094)."""
import os
import pathlib
import runpy
import unittest
import xml.etree.ElementTree

import paraview
from paraview import simple

import rimflow_testing

FOLDER = pathlib.Path(os.environ["RIMFLOW_GUI_DIR"])


def clicks(event):
    """Clicks that a person makes for an event of the player: a menu of the bar, its submenu and the entry; a field, before typing; a button."""
    path = event.get("object").split("/")
    return path[1:].count("menubar") and len(path) - path.index("menubar") or 1


def table_over_time(forces):
    return simple.servermanager.Fetch(forces, idx=0).GetBlock(0)


class TestClicksToForces(unittest.TestCase):
    def setUp(self):
        simple.ResetSession()
        simple.LoadPlugin(os.environ["RIMFLOW_PLUGIN"], remote=False, ns=simple.__dict__)

    def check(self, forces):
        self.assertEqual(forces.SMProxy.GetXMLName(), "TracksToForces")
        self.assertEqual(list(forces.Columns), ["Cd", "Cd_cv"])
        self.assertEqual((forces.Diameter, forces.Density, forces.Viscosity), (0.00953, 1820, 2.3825e-5))
        forces.UpdatePipeline(43.138)
        plot = table_over_time(forces)
        times = [plot.GetColumnByName("Time").GetValue(row) for row in range(plot.GetNumberOfRows())]
        self.assertEqual(times, [43.136, 43.138, 43.14])
        for row in range(3):
            self.assertAlmostEqual(plot.GetColumnByName("Cd_cv").GetValue(row), 1.094, delta=0.06)
            self.assertAlmostEqual(plot.GetColumnByName("Cd").GetValue(row), 1.094, delta=0.15)  # only every third track
        now = simple.servermanager.Fetch(forces, idx=3)
        self.assertEqual(now.GetColumnByName("Cd").GetValue(0), plot.GetColumnByName("Cd").GetValue(1))

    def check_views(self):
        self.assertEqual(sorted(view.GetXMLName() for view in simple.GetViews()), ["QuartileChartView", "RenderView"])
        chart = [view for view in simple.GetViews() if view.GetXMLName() == "QuartileChartView"][0]
        shown = chart.Representations[0]
        self.assertEqual(list(shown.SeriesVisibility), ["Cd (id=0)", "Cd_cv (id=0)"])

    def test_at_most_ten_clicks(self):
        events = xml.etree.ElementTree.parse(FOLDER / "tracks_to_forces.xml").getroot().findall("pqevent")
        last = [e.get("object").endswith("/Accept") for e in events].index(True)
        self.assertLessEqual(sum(clicks(e) for e in events[:last + 1]), 10)
        self.assertEqual([clicks(e) for e in events[:last + 1]], [3, 1, 1, 1, 1])

    def test_the_saved_state(self):
        simple.LoadState(str(FOLDER / "forces_by_clicks.pvsm"))
        self.check(simple.FindSource("TracksToForces1"))
        self.check_views()

    def test_the_trace(self):
        layout = simple.CreateLayout("Layout #1")  # as the window has one
        layout.AssignView(0, simple.GetActiveViewOrCreate("RenderView"))
        runpy.run_path(os.path.join(os.environ["RIMFLOW_SOURCE"], "Python", "gui", "open_tracks.py"))
        trace = (FOLDER / "forces_by_clicks_trace.py").read_text()
        exec(compile(trace, "trace", "exec"), {"paraview": paraview})
        self.check(simple.FindSource("TracksToForces1"))


if __name__ == "__main__":
    rimflow_testing.main()
