"""What the pvpython tests share: the plugin loaded, and errors turned into failures."""
import os
import sys
import unittest

from paraview import simple

simple.LoadPlugin(os.environ["RIMFLOW_PLUGIN"], remote=False, ns=simple.__dict__)


def main():
    """Runs the calling script's tests; the exit status tells (pvpython's own is always 0 for a script that returns)."""
    result = unittest.main(module="__main__", argv=sys.argv[:1], exit=False, verbosity=2).result
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0 if result.wasSuccessful() and result.testsRun else 1)
