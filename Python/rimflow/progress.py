"""A progress bar with the time left; where there is no terminal, a line for every tenth."""
import sys
import time


class ProgressBar:
    def __init__(self, label, total, stream=sys.stderr):
        self.label, self.total, self.stream = label, max(total, 1), stream
        self.start, self.terminal, self.tenths = time.monotonic(), stream.isatty(), -1

    def show(self, done):
        left = (time.monotonic() - self.start) / done * (self.total - done) if done else None
        remaining = "" if left is None else f", {_duration(left)} left" if done < self.total else f", took {_duration(time.monotonic() - self.start)}"
        if self.terminal:
            filled = 30 * done // self.total
            bar = "#" * filled + "." * (30 - filled)
            self.stream.write(f"\r{self.label:<12} [{bar}] {done}/{self.total}{remaining}   " + ("\n" if done >= self.total else ""))
        elif 10 * done // self.total > self.tenths:
            self.tenths = 10 * done // self.total
            self.stream.write(f"{self.label}: {done}/{self.total}{remaining}\n")
        self.stream.flush()


def _duration(seconds):
    if seconds < 90:
        return f"{seconds:.0f} s" if seconds >= 10 else f"{seconds:.1f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"
