"""The command lines of `rimflow process`, `rimflow sensitivity` and `rimflow convert`, checked before anything is computed."""
import argparse
import json
import math
import os
import re

STUDIES = ("step", "weights", "shells", "search", "guess", "model", "noise", "drop", "calibration")
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}


class UsageError(Exception):
    """What the user gave cannot be used; the text says what was found, what was expected and what to do."""


def length(text):
    """'11.11mm' -> 0.01111 (metres). A plain number is in metres."""
    match = re.fullmatch(r"\s*([0-9.eE+-]+)\s*([a-z]*)\s*", text)
    try:
        value = float(match.group(1)) * UNITS[match.group(2) or "m"]
    except (AttributeError, KeyError, ValueError):
        raise argparse.ArgumentTypeError(f"'{text}' is no length: write it like 11.11mm or 0.01111m") from None
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"'{text}' must be greater than zero")
    if not match.group(2) and value >= 1:
        raise argparse.ArgumentTypeError(f"'{text}' has no unit and would be {value:g} metres: write {value:g}mm if it is in millimetres")
    return value


def positive(text):
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is no number") from None
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"'{text}' must be greater than zero")
    return value


def body_density(text):
    """A density in kg/m3, or 'none' where it is not known."""
    return None if text.strip().lower() == "none" else positive(text)


def direction(text):
    """'0,1,0' -> (0, 1, 0), any length but zero."""
    try:
        values = tuple(float(v) for v in text.split(","))
    except ValueError:
        values = ()
    if len(values) != 3 or not all(map(math.isfinite, values)) or not any(values):
        raise argparse.ArgumentTypeError(f"'{text}' is no direction: write three numbers like 0,1,0")
    return values


def steps(text):
    """'a:b:s' -> slice, as Python writes one; 'a' alone is that one snapshot."""
    parts = text.split(":")
    try:
        numbers = [int(p) if p.strip() else None for p in parts]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) <= 3 or numbers == [None] or (len(numbers) == 3 and numbers[2] == 0):
        raise argparse.ArgumentTypeError(f"'{text}' is no slice of snapshots: write a:b:s like 0:100:2 (b is not included)")
    if len(numbers) == 1:
        return slice(numbers[0], numbers[0] + 1 or None)
    return slice(*numbers)


def whole(least, most=2**31 - 1):
    """Reads a whole number between the two."""
    def read(text):
        if not re.fullmatch(r"\d+", text) or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"'{text}' must be a whole number from {least} on" + (f" to {most}" if most < 2**31 - 1 else ""))
        return int(text)
    return read


def _parser(command, description):
    """What both commands ask for: the tracks, the sphere, the fluid, and where the results go."""
    p = argparse.ArgumentParser(
        prog=f"rimflow {command}", formatter_class=argparse.ArgumentDefaultsHelpFormatter, description=description,
        epilog="Lengths take a unit (11.11mm, 0.01111m); everything else is SI. Times are the file's own.")
    p.add_argument("tracks", nargs="+", metavar="TRACKS", help="track files: one with all snapshots, or one per snapshot; or the .pvd that `rimflow convert` made of them")
    p.add_argument("--out", required=True, metavar="DIR", help="folder for the results; made if it is not there")
    p.add_argument("--diameter", required=True, type=length, help="of the sphere, with its unit")
    p.add_argument("--viscosity", type=positive, default=1.1e-6, help="kinematic, of the fluid, m2/s")
    p.add_argument("--spacing", type=length, default=None, help="of the grid for the fields; default: from the particle density")
    p.add_argument("--up", type=direction, default=None,
                   help="against gravity; default: 0,1,0, but for the published method the direction of the sphere's motion")
    _add_which(p)
    return p


def _add_which(p):
    p.add_argument("--steps", type=steps, default=slice(None), metavar="a:b:s", help="slice of snapshot indices (default: all)")
    p.add_argument("--frame-period", type=positive, default=None, help="seconds between snapshots, where the files give no time")


def sensitivity_parser():
    p = _parser("sensitivity", "How far the found centre of the sphere moves when the method's parameters and the data are changed a little, "
                "beside the limits of Jose et al. (2025), and which weights of the published cost function converge steadily.")
    p.add_argument("--method", choices=("likelihood", "published", "both"), default="both", help="what is studied")
    p.add_argument("--snapshots", type=whole(3), default=10, metavar="N", help="as many of the selected snapshots, evenly spread")
    p.add_argument("--studies", default="all", metavar="A,B", help="only these studies: " + ", ".join(STUDIES))
    return p


def parser():
    p = _parser("process", "From the tracks of a Shake-The-Box export to the trajectory of the invisible sphere, the flow around it and the forces on it.")
    p.add_argument("--density", type=positive, default=1820.0, help="of the fluid, kg/m3")
    p.add_argument("--body-density", type=body_density, default=1190.0,
                   help="of the sphere, kg/m3, for the force that its motion demands; none: not known, or the motion is forced")
    p.add_argument("--method", choices=("likelihood", "published"), default="likelihood",
                   help="how the sphere is found: the void likelihood, or the cost function as published (slower: it needs the flow field)")
    p.add_argument("--fields", choices=("none", "vti"), default="none",
                   help="vti: write Velocity, MaterialAcceleration, Vorticity, QCriterion, Pressure and Mask per snapshot")
    p.add_argument("--no-forces", action="store_true",
                   help="no forces, and without --fields no flow either, which takes nearly all of the time")
    p.add_argument("--ranks", type=int, default=1, help="processes (MPI) that share the snapshots")
    p.add_argument("--resume", action="store_true", help="go on with an interrupted run in the same folder")
    p.add_argument("--images", action="store_true", help="also draw the sphere with its tracks and vortices (PNG)")
    p.add_argument("--movie", action="store_true", help="also a movie of the sphere, its wake and the drag: a frame per snapshot (PNG) and movie.avi")
    return p


def convert_parser():
    p = argparse.ArgumentParser(
        prog="rimflow convert", usage="rimflow convert IN... OUT.pvd [options]",
        description="From track files in any format to a series in binary, OUT.pvd, with one .vtp per snapshot in the folder OUT: "
        "the same numbers, opened at once and at any snapshot by ParaView, with or without the plugin.")
    p.add_argument("files", nargs="+", metavar="FILE", help="the track files, and last the .pvd to write")
    _add_which(p)
    p.add_argument("--length-unit", choices=UNITS, default=None, help="of the positions (default: the files' own; mm where they have none)")
    p.add_argument("--stride", type=whole(1), default=1, metavar="N", help="only every N-th track")
    p.add_argument("--min-length", type=whole(1, 65535), default=1, metavar="N", help="only tracks that appear in N or more snapshots")
    p.add_argument("--resume", action="store_true", help="go on with an interrupted conversion")
    return p


def parse(arguments):
    """Options from the command line; raises UsageError with a message for the user."""
    options = _checked(parser().parse_args(arguments))
    if options.ranks < 1:
        raise UsageError(f"--ranks is {options.ranks}; it must be 1 or more")
    return options


def parse_sensitivity(arguments):
    """The same for `rimflow sensitivity`."""
    options = _checked(sensitivity_parser().parse_args(arguments))
    names = [name.strip() for name in options.studies.split(",")]
    options.studies = list(STUDIES) if names == ["all"] else names
    unknown = sorted(set(options.studies) - set(STUDIES))
    if unknown:
        raise UsageError(f"--studies names {', '.join(unknown)}; there are {', '.join(STUDIES)}")
    return options


def parse_convert(arguments):
    """The same for `rimflow convert`: `tracks` and `out`."""
    options = convert_parser().parse_intermixed_args(arguments)
    *options.tracks, options.out = options.files
    if not is_series(options.out):
        raise UsageError(f"the last file is {options.out}; it must be the name of the result, which ends in .pvd")
    if not options.tracks:
        raise UsageError(f"there are no track files before {options.out}")
    _check_tracks(options)
    if is_series(options.tracks[0]):
        raise UsageError(f"{options.tracks[0]} is a series already; give track files")
    options.out = os.path.abspath(options.out)
    if not os.path.isdir(os.path.dirname(options.out)):
        raise UsageError(f"there is no folder {os.path.dirname(options.out)}")
    return options


def is_series(name):
    """Whether it names a series of ParaView's."""
    return name.lower().endswith(".pvd")


def _check_tracks(options):
    missing = [f for f in options.tracks if not os.path.isfile(f)]
    if missing:
        raise UsageError(f"{len(missing)} of {len(options.tracks)} track files cannot be found, the first is {missing[0]}")
    series = [f for f in options.tracks if is_series(f)]
    if series and len(options.tracks) > 1:
        raise UsageError(f"{series[0]} is a series and must be the only file; there are {len(options.tracks)}")
    options.tracks = [os.path.abspath(f) for f in options.tracks]


def _checked(options):
    _check_tracks(options)
    if os.path.exists(options.out) and not os.path.isdir(options.out):
        raise UsageError(f"--out is {options.out}, which is a file; name a folder")
    options.out = os.path.abspath(options.out)
    return options


def settings(options):
    """What decides the results, as it stands in run.json; a resumed run must have the same."""
    from rimflow import __version__

    return {
        "rimflow": __version__, "tracks": options.tracks, "tracks_bytes": sum(map(os.path.getsize, options.tracks)), "diameter_m": options.diameter, "density_kg_m3": options.density,
        "viscosity_m2_s": options.viscosity, "body_density_kg_m3": options.body_density, "spacing_m": options.spacing,
        "up": list(options.up) if options.up else None, "steps": [options.steps.start, options.steps.stop, options.steps.step],
        "method": options.method, "fields": options.fields, "forces": not options.no_forces, "frame_period_s": options.frame_period,
        "gravity_m_s2": gravity(options),
    }


def check_same_settings(folder, settings, what):
    """Before resuming: raises UsageError when what is in the folder was made with other settings than these (its settings.json)."""
    with open(os.path.join(folder, "settings.json"), encoding="utf-8") as f:
        before = json.load(f)
    changed = sorted(k for k in settings if settings[k] != before.get(k))
    if changed:
        raise UsageError(f"{folder} holds {what} with other settings ({', '.join(changed)}); "
                         "use the same settings with --resume, or leave --resume out to start anew")


def gravity(options):
    """9.81 m/s2 against the upward direction, as a vector in m/s2."""
    up = options.up or (0.0, 1.0, 0.0)
    return [0.0 - 9.81 * u / math.hypot(*up) for u in up]


def convert_settings(options):
    """What decides the result of a conversion; the files with size and time of change."""
    states = [(name, os.stat(name)) for name in options.tracks]
    return {
        "tracks": [[name, state.st_size, state.st_mtime_ns] for name, state in states],
        "frame_period_s": options.frame_period, "length_unit": options.length_unit,
        "steps": [options.steps.start, options.steps.stop, options.steps.step],
        "stride": options.stride, "min_length": options.min_length,
    }
