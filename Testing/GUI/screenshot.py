"""screenshot.py BUILD: makes Documentation/images/gui.png again: the clicks of tracks_to_forces.xml.in on the whole demo, in a window under Xvfb.

A few minutes. Look at the picture before you commit it. Needs Xvfb and matplotlib."""
import os
import pathlib
import struct
import subprocess
import sys
import tempfile
import time

import matplotlib.image
import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
SOURCE = HERE.parents[1]


def read_xwd(path):
    """The screen as rows of RGB; the format is X's window dump, which Xvfb keeps in a file."""
    data = path.read_bytes()
    header = struct.unpack(">25I", data[:100])
    start, width, height, line, colours = header[0], header[4], header[5], header[12], header[19]
    pixels = np.frombuffer(data, np.uint8, offset=start + 12 * colours, count=line * height).reshape(height, line)
    return pixels[:, :4 * width].reshape(height, width, 4)[:, :, 2::-1]


def main():
    build = pathlib.Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        events = (HERE / "tracks_to_forces.xml.in").read_text().replace("@rimflow_gui_dir@", str(folder))
        (folder / "events.xml").write_text("".join(line for line in events.splitlines(True) if "stop_trace" not in line))
        display = f":{200 + os.getpid() % 5000}"
        server = subprocess.Popen(["Xvfb", display, "-screen", "0", "1500x950x24", "-noreset", "-fbdir", str(folder)])
        time.sleep(2)
        paraview = subprocess.Popen(
            ["paraview", "--dr", f"--test-directory={folder}", f"--script={SOURCE / 'Python/gui/open_tracks.py'}", f"--test-script={folder / 'events.xml'}"],
            env={**os.environ, "DISPLAY": display, "HOME": str(folder), "PV_PLUGIN_PATH": str(build / "lib/rimflow/plugins"),
                 "RIMFLOW_FILES": str(SOURCE / "Examples/demo/sphere.dat.gz"), "OMP_WAIT_POLICY": "passive"})
        while paraview.poll() is None and not (folder / "forces_by_clicks.pvsm").exists():
            time.sleep(1)
        time.sleep(5)
        picture = read_xwd(folder / "Xvfb_screen0")
        paraview.terminate()
        paraview.wait()
        server.terminate()
        server.wait()
    rows, columns = (np.flatnonzero(picture.any(axis=(a, 2))) for a in (1, 0))
    matplotlib.image.imsave(SOURCE / "Documentation/images/gui.png", np.ascontiguousarray(picture[:rows[-1] + 1, :columns[-1] + 1]))


if __name__ == "__main__":
    main()
