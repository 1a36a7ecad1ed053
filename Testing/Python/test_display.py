"""Breaks when a virtual display takes a number that another X server uses, be it one whose lock file cannot be seen from here."""
import os
import shutil
import socket
import subprocess
import sys
import unittest

LAUNCHER = os.path.join(os.environ["RIMFLOW_SOURCE"], "rimflow")


def display(first):
    """The display that a program started at `first` sees."""
    environment = {**os.environ, "RIMFLOW_FIRST_DISPLAY": str(first), "DISPLAY": ":77777"}
    result = subprocess.run([LAUNCHER, "with-display", "printenv", "DISPLAY"], env=environment, capture_output=True, text=True, timeout=30)
    return int(result.stdout.strip().lstrip(":"))


class TestDisplay(unittest.TestCase):
    first = 10000 + os.getpid() % 5000 * 10  # a display that has just ended may keep its number for a moment: each test has its own

    def test_a_free_number_is_taken_whatever_display_there_is(self):
        self.assertEqual(display(self.first), self.first)

    def test_a_server_of_another_container_on_the_same_network(self):
        server = socket.socket(socket.AF_UNIX)
        self.addCleanup(server.close)
        server.bind(f"\0/tmp/.X11-unix/X{self.first + 3}")
        self.assertEqual(display(self.first + 3), self.first + 4)

    def test_a_server_with_a_lock_file(self):
        lock = f"/tmp/.X{self.first + 6}-lock"
        with open(lock, "x", encoding="utf-8") as f:
            f.write(f"{os.getpid():10d}\n")
        self.addCleanup(os.remove, lock)
        self.assertEqual(display(self.first + 6), self.first + 7)


if __name__ == "__main__":
    if not shutil.which("xvfb-run"):
        sys.exit(77)
    unittest.main(verbosity=2)
