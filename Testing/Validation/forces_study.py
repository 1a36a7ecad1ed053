"""Pressure and forces against the reference flow. Start it by `./rimflow bench forces`; --help lists the options.

Makes the flow, its grids and its tracks in --out where they are missing (sphere_flow.py), and runs the filters on them:
exact fields -> vtkSurfaceForce; exact velocity and acceleration -> vtkOmni3DPressure -> vtkSurfaceForce; and tracks -> locator -> VIC#
-> vtkOmni3DPressure -> vtkSurfaceForce. Writes fields.csv, snapshots.csv, tables.md and plots; with --page also the tables of
Documentation/validation-forces.md and the plots and CSV beside its images.
"""

import argparse
import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
SOURCE = os.path.dirname(os.path.dirname(HERE))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "Benchmarks", "common")]

import forces_page
import sphere_flow
from filters_on_truth import ExactFields, FromTracks, balance_of, image_of, pressure_error
from moving_sphere import MovingSphere, fields_on_grid, grid_axes
from tables import between_marks, fill, read_rows, write_rows

DIAMETER, SPEED, DENSITY = 9.53e-3, 0.25, 1820.0
MOTIONS = (  # direction, centre in mm half way, offset of the nodes in mm
    ((0.17, 0.95, -0.21), (-1.1, 0.8, 0.6), (0, 0, 0)),
    ((-0.35, 0.88, 0.32), (0.4, -1.3, -0.7), (0.17, -0.23, 0.11)),
    ((1, 1, 1), (0.2, 0.1, -0.3), (0.05, 0.21, -0.13)),
)
SPACINGS = (10, 12, 14, 16, 20)  # nodes per diameter
ERRORS = ("Cd", "Cd_cv", "Cd_p", "Cd_v", "side", "side_cv")
FIELD_COLUMNS = ("reynolds", "nodes_per_diameter", "motion", "input", *ERRORS, "pressure_error", "Cd_true")
TRACK_COLUMNS = ("tracks", "snapshot", "time_s", *ERRORS, "pressure_error", "acceleration_error", "velocity_error", "centre_error_um", "coverage", "spacing_m", "Cd_true")


def parse(arguments):
    parser = argparse.ArgumentParser(prog="rimflow bench forces", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    build = os.environ.get("RIMFLOW_BUILD_DIR", os.path.join(SOURCE, "build"))
    parser.add_argument("--out", default=os.path.join(build, "forces-study"), help="folder for data, CSV, tables and plots")
    parser.add_argument("--page", action="store_true", help="bring Documentation/validation-forces.md, its plots and its CSV up to date")
    parser.add_argument("--redraw", action="store_true", help="tables and plots from the CSV files that are there")
    parser.add_argument("--reynolds", type=float, nargs="+", default=[100, 250], help="of the flows (default 100 250); rows of others stay as they are")
    parser.add_argument("--every", type=int, default=8, help="every so many snapshots of the tracks (default 8); 0: no tracks")
    parser.add_argument("--spacing", type=float, nargs="+", default=[0.0, 0.5e-3], help="of VIC#, m; 0: its own choice (default 0 0.0005)")
    parser.add_argument("--fields-only", action="store_true", help="only the exact fields; the rows of the tracks stay as they are")
    parser.add_argument("--tracks-only", action="store_true", help="only the tracks; the rows of the exact fields stay as they are")
    return parser.parse_args(arguments)


def sphere_in(flow, motion, time=0.0):
    direction, centre, _ = MOTIONS[motion]
    return MovingSphere(flow, DIAMETER, SPEED, DENSITY, direction, 1e-3 * np.array(centre), time)


def study_fields(flow):
    """One row per grid, motion and input of the filters."""
    for per_diameter in SPACINGS:
        for motion, (_, _, offset) in enumerate(MOTIONS):
            sphere = sphere_in(flow, motion)
            spacing = DIAMETER / per_diameter
            axes = grid_axes(1e-3 * np.array(sphere_flow.BOX_MM), spacing, 1e-3 * np.array(offset))
            truth = fields_on_grid(sphere, axes, 0.0)
            filters = ExactFields(sphere)
            exact = image_of(sphere, axes, truth)
            for name, image in (("exact pressure", exact), ("exact acceleration", filters.pressure(exact))):
                row = {"reynolds": flow.reynolds, "nodes_per_diameter": per_diameter, "motion": motion, "input": name}
                row.update(balance_of(sphere, filters.forces(image)))
                row["pressure_error"] = pressure_error(sphere, image, 0.0, 1.5 * spacing)
                print(forces_page.line(row), flush=True)
                yield row


def study_tracks(name, path, sphere, every, spacing):
    """One row per snapshot of a track file."""
    for snapshot, row in FromTracks(sphere, path, spacing).snapshots(every):
        print(forces_page.line(row), flush=True)
        yield {"tracks": name, "snapshot": snapshot, **row}


def track_files(out, flow):
    """Ideal and noisy tracks of the first motion, made if they are missing."""
    label = f"re{flow.reynolds:g}"
    names = [f"{label}_{kind}" for kind in ("noisy", "clean")]
    if not all(os.path.exists(os.path.join(out, f"{name}.dat.gz")) for name in names):
        direction, centre, _ = (",".join(map(str, vector)) for vector in MOTIONS[0])
        sphere_flow.main(["--reynolds", str(flow.reynolds), "--out", out, "--tracks", f"--direction={direction}", f"--centre={centre}"])
    return {name: os.path.join(out, f"{name}.dat.gz") for name in names}


def main(arguments):
    settings = parse(arguments)
    os.makedirs(settings.out, exist_ok=True)
    field_file, track_file = (os.path.join(settings.out, f"{name}.csv") for name in ("fields", "snapshots"))
    field_rows, track_rows = read_rows(field_file), read_rows(track_file)
    if not settings.redraw:
        flows = [sphere_flow.stored_flow(os.path.join(settings.out, f"flow_re{re:g}.npz"), re, sphere_flow.NODES) for re in settings.reynolds]
        if not settings.tracks_only:
            field_rows = [row for row in field_rows if float(row["reynolds"]) not in settings.reynolds]
            for flow in flows:
                field_rows += study_fields(flow)
                write_rows(field_file, FIELD_COLUMNS, field_rows)
        if settings.every and not settings.fields_only:
            middle = sphere_flow.recording_times().mean()
            for flow in flows:
                for label, path in track_files(settings.out, flow).items():
                    for spacing in settings.spacing:
                        name = f"{label}_h {1e3 * spacing:g} mm" if spacing else label
                        track_rows = [row for row in track_rows if row["tracks"] != name]
                        track_rows += study_tracks(name, path, sphere_in(flow, 0, middle), settings.every, spacing)
                        write_rows(track_file, TRACK_COLUMNS, track_rows)
    found = forces_page.tables(read_rows(field_file), read_rows(track_file))
    with open(os.path.join(settings.out, "tables.md"), "w", encoding="utf-8") as file:
        file.write(between_marks(found))
    images = os.path.join(SOURCE, "Documentation", "images", "validation-forces") if settings.page else settings.out
    os.makedirs(images, exist_ok=True)
    forces_page.draw(images, read_rows(field_file), read_rows(track_file))
    if settings.page:
        fill(os.path.join(SOURCE, "Documentation", "validation-forces.md"), found)
        write_rows(os.path.join(images, "fields.csv"), FIELD_COLUMNS, read_rows(field_file))
        write_rows(os.path.join(images, "snapshots.csv"), TRACK_COLUMNS, read_rows(track_file))


if __name__ == "__main__":
    main(sys.argv[1:])
