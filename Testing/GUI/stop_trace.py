# A macro for the test of the trace: ends it and writes it to a file.
import os

from paraview import smtrace

with open(os.environ["RIMFLOW_TRACE"], "w") as out:
    out.write(smtrace.stop_trace())
