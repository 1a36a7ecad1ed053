"""What the pvpython tests share: the plugin loaded, image comparison, and an exit status that tells."""
import ctypes
import os
import sys
import unittest

from paraview import simple

simple.LoadPlugin(os.environ["RIMFLOW_PLUGIN"], remote=False, ns=simple.__dict__)
SOURCE = os.environ["RIMFLOW_SOURCE"]
BUILD = os.environ["RIMFLOW_BUILD"]


def compare_image(test, view, name, threshold=10.0):
    """Fails `test` when the view differs from Testing/Baselines/`name`.png by more than vtkImageDifference's threshold.

    The comparison is blunt (a field scaled by 1.1 may pass): give every image test a numeric twin.
    RIMFLOW_UPDATE_BASELINES=1 writes the baseline instead; look at it before you commit it.
    """
    from vtkmodules.vtkImagingCore import vtkImageDifference
    from vtkmodules.vtkIOImage import vtkPNGReader, vtkPNGWriter

    baseline = os.path.join(SOURCE, "Testing", "Baselines", name + ".png")
    folder = os.path.join(BUILD, "Testing", "Images")
    os.makedirs(folder, exist_ok=True)
    produced = os.path.join(folder, name + ".png")
    simple.SaveScreenshot(produced, view, ImageResolution=[600, 450])
    if os.environ.get("RIMFLOW_UPDATE_BASELINES"):
        simple.SaveScreenshot(baseline, view, ImageResolution=[600, 450])
    test.assertTrue(os.path.exists(baseline), f"there is no {baseline}; the image is {produced}")
    images = []
    for path in (produced, baseline):
        images.append(vtkPNGReader())
        images[-1].SetFileName(path)
        images[-1].Update()
    test.assertEqual(*[i.GetOutput().GetDimensions() for i in images])
    difference = vtkImageDifference()
    difference.SetInputConnection(images[0].GetOutputPort())
    difference.SetImageConnection(images[1].GetOutputPort())
    difference.Update()
    if difference.GetThresholdedError() > threshold:
        writer = vtkPNGWriter()
        writer.SetInputConnection(difference.GetOutputPort())
        writer.SetFileName(os.path.join(folder, name + ".difference.png"))
        writer.Write()
        test.fail(f"{produced} differs from {baseline} by {difference.GetThresholdedError():.1f} (allowed {threshold})")


def render_view():
    """A small white view without decorations that depend on fonts."""
    view = simple.CreateView("RenderView")
    view.ViewSize = [600, 450]
    view.OrientationAxesVisibility = 0
    view.UseColorPaletteForBackground = 0
    view.Background = [1, 1, 1]
    simple.SetActiveView(view)
    return view


def main():
    """Runs the calling script's tests; the exit status tells (pvpython's own is always 0 for a script that returns)."""
    result = unittest.main(module="__main__", argv=sys.argv[:1], exit=False, verbosity=2).result
    sys.stdout.flush()
    sys.stderr.flush()
    ctypes.CDLL(None).fflush(None)  # what pvpython's stdout holds back
    os._exit(0 if result.wasSuccessful() and result.testsRun else 1)
