"""`rimflow convert`: track files in, a .pvd series in binary out, one .vtp per snapshot. Runs under pvbatch.

OUT.pvd lists the snapshots that are in the folder OUT. It grows while the conversion runs and names only files that are whole, so what
an interruption leaves can be opened, and --resume goes on from there.
"""
import glob
import os
import signal
import sys
import time

from rimflow import files, options as command_line, pipeline
from rimflow.options import UsageError
from rimflow.progress import ProgressBar
from rimflow.vtkRIMFlowReaders import vtkSTBTrackReader

LENGTH_UNITS = {None: vtkSTBTrackReader.AUTO, "m": vtkSTBTrackReader.METRE, "mm": vtkSTBTrackReader.MILLIMETRE,
                "cm": vtkSTBTrackReader.CENTIMETRE, "um": vtkSTBTrackReader.MICROMETRE}
SECONDS_BETWEEN_LISTS = 2.0


def main(arguments):
    """Runs the command; returns the exit status."""
    for stop in (signal.SIGINT, signal.SIGTERM):  # ParaView's own handler would print a stack trace and die
        signal.signal(stop, signal.default_int_handler)
    try:
        return pipeline.answered("convert", lambda: Conversion(command_line.parse_convert(arguments)).execute())
    except KeyboardInterrupt:
        print("\nrimflow convert: interrupted; the same command with --resume goes on", file=sys.stderr)
        return 130


class Conversion:
    def __init__(self, options):
        self.options, self.errors = options, pipeline.Errors()
        self.folder = os.path.splitext(options.out)[0]
        self.reader = pipeline.track_reader(options.tracks, options.frame_period)
        self.reader.SetLengthUnit(LENGTH_UNITS[options.length_unit])
        self.reader.SetStride(options.stride)
        self.reader.SetMinimumTrackLength(options.min_length)
        self.errors.watch(self.reader)

    def execute(self):
        self.times = self.opened()
        self.selected = sorted(range(len(self.times))[self.options.steps])
        if not self.selected:
            raise UsageError(f"--steps selects none of the {len(self.times)} snapshots in {self.options.tracks[0]}")
        self.prepare()
        done, problems = [], []
        try:
            self.convert(done, problems)
        finally:
            self.write_list(done)
        size = sum(os.path.getsize(self.path(k)) for k in done)
        print(f"{len(done)} of {len(self.selected)} snapshots, {size / 1e6:.1f} MB: {self.options.out}")
        if problems:
            raise pipeline.PipelineError(f"{len(problems)} of {len(self.selected)} snapshots could not be read and are left out: " + "".join(
                f"\n  snapshot {k}: {text}" for k, text in problems))

    def opened(self):
        """The times of the snapshots. Files whose rows stand track by track are read as a whole here."""
        bar = ProgressBar("open", 100)
        heard = self.reader.AddObserver("ProgressEvent", lambda reader, _: bar.show(min(int(100 * reader.GetProgress()), 99)))
        times = pipeline.times(self.reader, self.errors, self.options.tracks[0])
        self.reader.RemoveObserver(heard)
        bar.show(100)
        return times

    def path(self, k):
        return os.path.join(self.folder, f"{k:06d}.vtp")

    def write_list(self, snapshots):
        name = os.path.basename(self.folder)
        files.write_pvd(self.options.out, [(self.times[k], f"{name}/{k:06d}.vtp") for k in snapshots])

    def prepare(self):
        """A fresh folder, or the one of the interrupted run when it was made from the same files with the same settings."""
        settings, earlier = command_line.convert_settings(self.options), os.path.join(self.folder, "settings.json")
        ours = os.path.exists(earlier)
        if os.path.exists(self.folder) and not ours and os.listdir(self.folder):
            raise UsageError(f"{self.folder} is needed for the snapshots, but holds something else; name another file than {self.options.out}")
        os.makedirs(self.folder, exist_ok=True)
        if ours and self.options.resume:
            command_line.check_same_settings(self.folder, settings, "a conversion")
        elif ours:
            self.write_list([])
        for name in glob.glob(os.path.join(glob.escape(self.folder), "[0-9]*.vtp")):
            if not self.options.resume or name.endswith(".part.vtp"):
                os.remove(name)
        files.write_json(earlier, settings)

    def convert(self, done, problems):
        """Appends to `done` the snapshots that are in the folder, and to `problems` those that are not, with the reason."""
        bar, listed = ProgressBar("convert", len(self.selected)), time.monotonic()
        for i, k in enumerate(self.selected):
            bar.show(i)
            try:
                if not (self.options.resume and os.path.exists(self.path(k))):
                    pipeline.write_polydata(self.path(k), self.snapshot(k), compressed=False)
                done.append(k)
            except pipeline.PipelineError as error:
                problems.append((k, str(error)))
            if time.monotonic() - listed > SECONDS_BETWEEN_LISTS:
                self.write_list(done)
                listed = time.monotonic()
        bar.show(len(self.selected))

    def snapshot(self, k):
        """The reader's output as it is; its time stands in the list, not once more among its field data."""
        self.reader.UpdateTimeStep(self.times[k])
        self.errors.check()
        data = pipeline.kept(self.reader.GetOutput())
        data.GetInformation().Remove(data.DATA_TIME_STEP())
        return data


if __name__ == "__main__":
    pipeline.run(main)
