"""Opens the tracks as `./rimflow gui` does, then traces what is clicked; the macro stop_trace ends it."""
import os
import runpy

from paraview import smtrace

runpy.run_path(os.path.join(os.environ["RIMFLOW_SOURCE"], "Python", "gui", "open_tracks.py"))
smtrace.start_trace()
