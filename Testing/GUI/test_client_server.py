"""Breaks when the plugin does not work in client-server mode: tracks read and forces computed in pvserver must be those of the built-in server.

    pvpython test_client_server.py TRACKS

Starts ParaView's pvserver, loads the plugin on both sides and runs Tracks To Forces on each, with a coarse grid."""
import os
import pathlib
import socket
import subprocess
import sys
import time
import unittest

from paraview import simple

import rimflow_testing

PLUGIN = os.environ["RIMFLOW_PLUGIN"]
TRACKS = sys.argv[1]


def free_port():
    with socket.socket() as s:
        s.bind(("localhost", 0))
        return s.getsockname()[1]


def listens(port):
    """Whether somebody listens at the port: from /proc, because the first who connects is taken for the client."""
    tables = [pathlib.Path(name) for name in ("/proc/net/tcp", "/proc/net/tcp6")]
    rows = [row.split() for table in tables if table.exists() for row in table.read_text().splitlines()[1:]]
    return any(row[1].endswith(f":{port:04X}") and row[3] == "0A" for row in rows)


def forces(tracks):
    """Cd and Cd_cv of all snapshots, and the drag at the second."""
    chain = simple.TracksToForces(Input=tracks, Diameter=0.00953, Viscosity=2.3825e-5, Spacing=0.002)
    chain.UpdatePipeline(tracks.TimestepValues[1])
    plot = simple.servermanager.Fetch(chain, idx=0).GetBlock(0)
    table = simple.servermanager.Fetch(chain, idx=3)
    rows = [[plot.GetColumnByName(name).GetValue(r) for name in ("Time", "Cd", "Cd_cv")] for r in range(plot.GetNumberOfRows())]
    return rows, table.GetColumnByName("drag_N").GetValue(0)


class TestClientServer(unittest.TestCase):
    def start(self):
        """A pvserver that is ready: its port."""
        port = free_port()
        environment = {name: value for name, value in os.environ.items() if name != "PV_PLUGIN_PATH"}
        server = subprocess.Popen(["pvserver", f"--server-port={port}"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
        self.addCleanup(server.wait, 30)
        self.addCleanup(server.terminate)
        end = time.monotonic() + 60
        while not listens(port) and server.poll() is None and time.monotonic() < end:
            time.sleep(0.1)
        return port

    def test_the_same_forces_on_a_server(self):
        here = forces(simple.STBTrackReader(FileNames=[TRACKS]))
        port = self.start()
        simple.Connect("localhost", port)
        self.assertTrue(simple.servermanager.ActiveConnection.IsRemote())
        simple.LoadPlugin(PLUGIN, remote=True, ns=simple.__dict__)
        simple.LoadPlugin(PLUGIN, remote=False, ns=simple.__dict__)
        tracks = simple.STBTrackReader(FileNames=[TRACKS])
        tracks.UpdatePipeline()
        self.assertIsNone(tracks.SMProxy.GetClientSideObject())  # the data are in the other process
        there = forces(tracks)
        self.assertEqual(len(here[0]), 3)
        self.assertEqual(here, there)
        for _, cd, cd_cv in there[0]:
            self.assertAlmostEqual(cd_cv, 1.094, delta=0.1)
            self.assertAlmostEqual(cd, 1.094, delta=0.35)  # a coarse grid


if __name__ == "__main__":
    rimflow_testing.main()
