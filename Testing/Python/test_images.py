"""Breaks when a filter's first picture changes; each image has a numeric twin on the same pipeline."""
import unittest

from paraview import simple

import rimflow_testing
from rimflow_testing import compare_image, render_view


class TestImages(unittest.TestCase):
    def test_synthetic_tracks(self):
        tracks = simple.SyntheticTracks(Density=2e7)
        time = tracks.TimestepValues[5]
        tracks.UpdatePipeline(time)
        # the twin: as many tracers as the density says, none faster than the sphere
        low, high = tracks.Bounds[0::2], tracks.Bounds[1::2]
        volume = (high[0] - low[0]) * (high[1] - low[1]) * (high[2] - low[2])
        self.assertLess(abs(tracks.GetDataInformation().GetNumberOfPoints() / (2e7 * volume) - 1), 0.1)
        self.assertLess(tracks.PointData["Velocity"].GetRange(-1)[1], 0.36)
        view = render_view()
        view.ViewTime = time
        shown = simple.Show(tracks, view)
        shown.PointSize = 4
        simple.ColorBy(shown, ("POINTS", "Velocity", "Magnitude"))
        shown.LookupTable.RescaleTransferFunction(0, 0.35)
        simple.ResetCamera(view)
        compare_image(self, view, "synthetic_tracks")

    def test_vortices(self):
        # A ring: solid rotation that fades with the distance from a circle; Q at its core is known.
        box = simple.Wavelet(WholeExtent=[-15, 15, -15, 15, -10, 10])
        flow = simple.Calculator(Input=box, ResultArrayName="Velocity",
                                 Function="exp(-((sqrt(coordsX^2+coordsY^2)-8)^2+coordsZ^2)/8)*"
                                          "(coordsZ*(coordsX*iHat+coordsY*jHat)/max(sqrt(coordsX^2+coordsY^2),1)-(sqrt(coordsX^2+coordsY^2)-8)*kHat)")
        q = simple.QCriterion(Input=flow, Order=4)
        q.UpdatePipeline()
        # at the core the rotation is 1 rad/s: Q = 1, less what the grid smooths away
        self.assertAlmostEqual(q.PointData["QCriterion"].GetRange()[1], 1.0, delta=0.08)
        contour = simple.Contour(Input=q, ContourBy=["POINTS", "QCriterion"], Isosurfaces=[0.3])
        contour.UpdatePipeline()
        # R = 8; the surface of a thin torus of minor radius r has the area 4 pi^2 R r
        area = simple.IntegrateVariables(Input=contour)
        area.UpdatePipeline()
        self.assertAlmostEqual(area.CellData["Area"].GetRange()[0] / (4 * 3.1416**2 * 8), 1.5, delta=0.4)
        view = render_view()
        simple.ColorBy(simple.Show(contour, view), None)
        view.CameraPosition, view.CameraFocalPoint, view.CameraViewUp = [20, -50, 40], [0, 0, 0], [0, 0, 1]
        view.CameraParallelProjection, view.CameraParallelScale = 1, 12
        compare_image(self, view, "vortices")


if __name__ == "__main__":
    rimflow_testing.main()
