"""Tables and plots of forces_study.py from the rows of its CSV files."""

import os

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from tables import markdown, numbers, unique


def column(rows, name):
    return np.array([float(row[name]) for row in rows])


def drag_error(rows, name):
    """Relative to the true drag."""
    return column(rows, name) / column(rows, "Cd_true") - 1


def line(row):
    """A row for the log."""
    return "  ".join(f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}" for name, value in row.items())


def percent(value, signed=False):
    return f"{100 * value:+.2f} %" if signed else f"{100 * value:.2f} %"


def largest(values):
    """The one farthest from zero, with its sign."""
    return values[np.argmax(np.abs(values))]


def tables(field_rows, track_rows):
    found = {}
    if field_rows:
        found["fields"] = fields_table(field_rows)
    if track_rows:
        found["tracks"] = tracks_table(track_rows)
    return found


def fields_table(rows):
    lines = []
    for reynolds in unique(rows, "reynolds"):
        for per_diameter in unique(rows, "nodes_per_diameter"):
            for name in unique(rows, "input"):
                group = numbers(rows, reynolds=float(reynolds), nodes_per_diameter=float(per_diameter), input=name)
                if not group:
                    continue
                drags = [percent(largest(drag_error(group, column_name)), True) for column_name in ("Cd", "Cd_cv")]
                sides = [percent(column(group, column_name).max()) for column_name in ("side", "side_cv")]
                lines.append([f"{float(reynolds):g}", f"d/{per_diameter}", name, *drags, *sides, percent(column(group, "pressure_error").max())])
    return markdown(["Re", "h", "input", "drag, surface", "drag, control volume", "side, surface", "side, control volume", "pressure"], lines)


def tracks_table(rows):
    lines = []
    for name in unique(rows, "tracks"):
        group = numbers(rows, tracks=name)
        cells = [name.replace("_", ", "), f"{1e3 * column(group, 'spacing_m').mean():.2f} mm", str(len(group))]
        for column_name in ("Cd", "Cd_cv"):
            error = drag_error(group, column_name)
            cells.append(f"{percent(error.mean(), True)} / {percent(error.std())} / {percent(largest(error), True)}")
        cells += [f"{percent(column(group, side).mean())} / {percent(column(group, side).max())}" for side in ("side", "side_cv")]
        for column_name in ("pressure_error", "acceleration_error", "velocity_error"):
            cells.append(f"{percent(column(group, column_name).mean())} / {percent(column(group, column_name).max())}")
        cells.append(f"{column(group, 'centre_error_um').mean():.1f} um")
        lines.append(cells)
    head = ["tracks", "h", "snapshots", "drag, surface", "drag, control volume", "side, surface", "side, control volume", "pressure", "acceleration", "velocity", "centre"]
    return markdown(head, lines)


def draw(folder, field_rows, track_rows):
    if field_rows:
        draw_fields(os.path.join(folder, "fields.png"), field_rows)
    if track_rows:
        draw_tracks(os.path.join(folder, "tracks.png"), track_rows)


def colour(reynolds):
    """The same for a Reynolds number in all plots, from blue (1) to red (300)."""
    return plt.get_cmap("turbo")(0.1 + 0.8 * np.log(float(reynolds)) / np.log(300))


def show_legend(place, axes):
    place.axis("off")
    place.legend(*axes.get_legend_handles_labels(), loc="center left", fontsize=7)


def draw_fields(path, rows):
    """Largest error over the motions against the resolution."""
    figure, (drag, side, legend) = plt.subplots(1, 3, figsize=(14, 4.5), width_ratios=(5, 5, 2), layout="constrained")
    for reynolds in unique(rows, "reynolds"):
        for source, filled in (("exact pressure", "full"), ("exact acceleration", "none")):
            for name, label, marker in (("", "surface", "o-"), ("_cv", "control volume", "s--")):
                points = []
                for per_diameter in unique(rows, "nodes_per_diameter"):
                    group = numbers(rows, reynolds=float(reynolds), nodes_per_diameter=float(per_diameter), input=source)
                    if group:
                        points.append((float(per_diameter), np.abs(drag_error(group, "Cd" + name)).max(), column(group, "side" + name).max()))
                if points:
                    resolution, drag_errors, sides = np.array(points).T
                    style = {"color": colour(reynolds), "fillstyle": filled, "markersize": 5}
                    drag.semilogy(resolution, 100 * drag_errors, marker, label=f"Re {float(reynolds):g}, {source}, {label}", **style)
                    side.semilogy(resolution, 100 * sides, marker, **style)
    for axes, title in ((drag, "error of the drag"), (side, "side force (true: 0)")):
        axes.set(xlabel="nodes per diameter", ylabel="% of the true force", title=title)
        axes.grid(alpha=0.3)
    show_legend(legend, drag)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def draw_tracks(path, rows):
    """Error per snapshot; clean tracks have hollow marks, a grid finer than VIC#'s own choice is pale."""
    figure, (surface, volume, pressure, legend) = plt.subplots(1, 4, figsize=(17, 4.5), width_ratios=(5, 5, 5, 2), layout="constrained")
    for name in unique(rows, "tracks"):
        group = numbers(rows, tracks=name)
        snapshot = column(group, "snapshot")
        reynolds = name.split("_")[0].removeprefix("re")
        style = {"color": colour(reynolds), "fillstyle": "none" if "clean" in name else "full", "alpha": 0.4 if "_h " in name else 1, "markersize": 5}
        surface.plot(snapshot, 100 * drag_error(group, "Cd"), "o-", label=name.replace("_", ", ").replace("re", "Re ", 1), **style)
        volume.plot(snapshot, 100 * drag_error(group, "Cd_cv"), "o-", **style)
        pressure.semilogy(snapshot, 100 * column(group, "pressure_error"), "o-", **style)
    for axes, title in ((surface, "error of the drag, surface"), (volume, "error of the drag, control volume")):
        axes.set(ylabel="% of the true drag", title=title, ylim=(-12, 12))
    pressure.set(ylabel="% of the rms pressure", title="error of the pressure")
    for axes in (surface, volume, pressure):
        axes.set_xlabel("snapshot")
        axes.grid(alpha=0.3)
    show_legend(legend, surface)
    figure.savefig(path, dpi=110)
    plt.close(figure)
