"""The report of a run: plots (PNG) and index.html, readable without a network connection.

index.html holds its pictures itself (as data: URIs, a few MB), so that this one file can be mailed or copied; the same pictures lie beside
it for slides. It has no scripts and no fonts of its own.
"""
import base64
import html
import json
import mimetypes
import os
import re

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from rimflow import force_report
from rimflow.files import replacing, write_text
from rimflow.forces import standard_drag
from rimflow.pipeline import FOUND, LOST, PREDICTED, SIGNIFICANT

AXES = ("x", "y", "z")
COLOURS = ("#c1433c", "#3b7d3c", "#33609e")
STYLE = """body{font:16px/1.5 sans-serif;max-width:1100px;margin:2em auto;padding:0 1em;color:#222}
h2{margin-top:2em;border-bottom:1px solid #ccc}nav a{margin-right:1.2em}pre{white-space:pre-wrap;overflow-wrap:anywhere;font-size:13px}
.numbers td,.numbers th{padding:0.1em 1.2em 0.1em 0;font-variant-numeric:tabular-nums}
td{vertical-align:top}th{text-align:left;padding-right:2em;font-weight:600;vertical-align:top}
img{max-width:100%;max-height:95vh}figure{margin:2em 0}figcaption{color:#555}.problems{border-left:4px solid #c1433c;padding-left:1em}
@media print{figure,tr{break-inside:avoid}}"""
STATUS_NAMES = {FOUND: "found", PREDICTED: "predicted from its neighbours", LOST: "lost"}


def write_report(folder, trajectory, run, forces=None):
    """trajectory: arrays over the snapshots (see rimflow.process.Trajectory); run: what run.json holds; forces: rimflow.forces.Forces.
    Returns the file names."""
    os.makedirs(folder, exist_ok=True)
    known, quality = np.any(trajectory.status != LOST), bool(run["reconstruction"])
    turning = known and np.any(rotation_known(trajectory))
    of_forces = {name: (caption, lambda t, run, plot=plot: plot(t, forces, run)) for name, caption, plot in force_report.PAGES}
    pages = {}  # name -> (caption, plot)
    if known:
        pages["trajectory.png"] = ("Path of the sphere's centre, coloured by its speed", plot_trajectory)
        pages["motion.png"] = ("Position, velocity and acceleration over time; the bands are two standard deviations wide to either side", plot_motion)
    if turning:
        pages["rotation.png"] = ("Rotation of the sphere over time; the bands are two standard deviations wide to either side", plot_rotation)
    if forces and forces.known.any():
        pages.update(of_forces)
    if known:
        pages["quality.png"] = ("How well the sphere's place was determined in each snapshot", plot_quality)
    if quality:
        pages["reconstruction.png"] = ("How well the flow and its pressure were reconstructed in each snapshot", plot_reconstruction)
    for name, (_, plot) in pages.items():
        figure = plot(trajectory, run)
        with replacing(os.path.join(folder, name)) as temporary:
            figure.savefig(temporary, dpi=110)
        plt.close(figure)
    captions = {**{name: caption for name, (caption, _) in pages.items()}, **drawn(folder)}
    write_text(os.path.join(folder, "index.html"), index_html(folder, trajectory, run, captions))
    return [*pages, "index.html"]


def drawn(folder):
    """The captions of ParaView's pictures (rimflow.images) that there are."""
    captions = {"tracks.png": "Particle tracks, coloured by their speed, and the sphere that was found among them",
                "slice.png": "Velocity in the plane through the sphere's centre",
                "vortices.png": "Vortices (iso-surface of the Q-criterion, coloured by the velocity along the sphere's motion) and the sphere",
                "surface.png": "Pressure on the sphere at the instants A to D of the plots over time, from the side, the front and the rear"}
    return {name: caption for name, caption in captions.items() if os.path.exists(os.path.join(folder, name))}


def plot_trajectory(t, run):
    shown = t.status != LOST
    centre, raw = 1e3 * t.centre[shown], 1e3 * t.raw[t.status == FOUND]
    speed = np.linalg.norm(t.velocity[shown], axis=1)
    figure = plt.figure(figsize=(8, 8), layout="constrained")
    ax = figure.add_subplot(projection="3d")
    # the vertical axis of the plot is the direction that points up, as far as an axis can
    up = int(np.argmax(np.abs(run["settings"]["up"] or (0, 1, 0))))
    order = [(up + 1) % 3, (up + 2) % 3, up]
    ax.plot(*centre[:, order].T, color="0.7", lw=1, zorder=1)
    ax.scatter(*raw[:, order].T, s=8, color="0.45", marker="+", label="single snapshots", zorder=2)
    # steady motion: do not stretch rounding errors over the whole colour map
    span = max(np.ptp(speed), 0.02 * speed.mean(), 1e-12)
    points = ax.scatter(*centre[:, order].T, c=speed, s=28, cmap="viridis", vmin=speed.mean() - span / 2,
                        vmax=speed.mean() + span / 2, label="smoothed", depthshade=False, zorder=3)
    radius = 500 * t.diameter
    a, b = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13))
    sphere = radius * np.array([np.cos(a) * np.sin(b), np.sin(a) * np.sin(b), np.cos(b)])
    ax.plot_wireframe(*(sphere + centre[-1][order][:, None, None]), color="0.4", lw=0.3, alpha=0.6)
    low, high = centre.min(0) - 1.1 * radius, centre.max(0) + 1.1 * radius
    missing = np.maximum(0, 0.3 * np.max(high - low) - (high - low))  # a long path: not so slender that the axes cannot be read
    limits = np.stack([low - 0.5 * missing, high + 0.5 * missing])[:, order]
    ax.set(xlim=limits[:, 0], ylim=limits[:, 1], zlim=limits[:, 2], xlabel=f"{AXES[order[0]]} [mm]", ylabel=f"{AXES[order[1]]} [mm]",
           zlabel=f"{AXES[order[2]]} [mm]", title=f"Centre of the sphere, d = {1e3 * t.diameter:g} mm (drawn at its last place)")
    ax.set_box_aspect(np.ptp(limits, axis=0))
    ax.xaxis.set_major_locator(plt.MaxNLocator(4))
    ax.yaxis.set_major_locator(plt.MaxNLocator(4))
    figure.colorbar(points, ax=ax, shrink=0.6, label="speed [m/s]")
    ax.legend(loc="upper left")
    return figure


def plot_motion(t, run):
    shown = t.status != LOST
    figure, axes = plt.subplots(3, 3, figsize=(14, 8), sharex=True, layout="constrained")
    time = t.time[shown]
    for i in range(3):
        position, sigma = 1e3 * t.centre[shown, i], 1e3 * t.sigma[shown, i]
        line = _line(time, position)
        left, *others = axes[i]
        found = t.status == FOUND
        left.plot(t.time[found], 1e3 * t.raw[found, i] - _line(time, position, t.time[found]), "+", color="0.45", label="single snapshots")
        left.fill_between(time, position - line - 2 * sigma, position - line + 2 * sigma, color=COLOURS[i], alpha=0.25, lw=0)
        left.plot(time, position - line, color=COLOURS[i], label="smoothed")
        slope = (line[-1] - line[0]) / (time[-1] - time[0]) if len(time) > 1 else 0.0
        left.set_ylabel(f"{AXES[i]} - line [mm]")
        left.set_title(f"{AXES[i]} less the straight line {line[0]:.3f} mm {slope / 1e3:+.4f} m/s (t - t0)", fontsize=9)
        for ax, values, sigma, label in zip(others, (t.velocity, t.acceleration), (t.velocity_sigma, t.acceleration_sigma),
                                            (f"{'uvw'[i]} [m/s]", f"a{AXES[i]} [m/s2]")):
            band(ax, time, values[shown, i], sigma[shown, i], COLOURS[i])
            ax.set_ylabel(label)
    speed = np.linalg.norm(t.velocity[shown], axis=1)
    axes[0, 1].set_title(f"velocity; speed {speed.mean():.4f} m/s on average, {speed.min():.4f} to {speed.max():.4f}", fontsize=9)
    axes[0, 2].set_title("acceleration", fontsize=9)
    axes[0, 0].legend(fontsize=8)
    _over_time(axes)
    return figure


def rotation_known(t):
    """(n,): where the rotation rate is known."""
    return (t.status != LOST) & np.all(t.rotation_sigma > 0, axis=1)


def plot_rotation(t, run):
    figure, axes = plt.subplots(1, 3, figsize=(14, 3.4), sharex=True, layout="constrained")
    known = rotation_known(t)
    for i, ax in enumerate(axes):
        band(ax, t.time[known], t.rotation[known, i], t.rotation_sigma[known, i], COLOURS[i])
        ax.axhline(0, color="0.5", lw=0.8, ls=":")
        ax.set_ylabel(f"rotation about {AXES[i]} [rad/s]")
    _over_time(axes[None])
    return figure


def band(ax, time, values, sigma, colour):
    """A line over time with a band of two standard deviations."""
    ax.fill_between(time, values - 2 * sigma, values + 2 * sigma, color=colour, alpha=0.25, lw=0)
    ax.plot(time, values, color=colour, marker=None if len(time) > 1 else ".")


def _over_time(axes):
    for ax in axes.flat:
        ax.grid(alpha=0.3)
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
        ax.ticklabel_format(axis="x", useOffset=False)
        ax.xaxis.set_major_locator(plt.MaxNLocator(5))


def _line(time, values, at=None):
    """A straight line through `values`, so that a plot shows micrometres on a path of centimetres."""
    at = time if at is None else at
    if len(time) < 2:
        return np.full(len(at), values.mean())
    mid = time.mean()
    return np.polyval(np.polyfit(time - mid, values, 1), at - mid)


def plot_quality(t, run):
    figure, axes = plt.subplots(3, 1, figsize=(10, 9), sharex=True, layout="constrained")
    found = t.status == FOUND
    percent = 100 / t.diameter
    for i in range(3):
        axes[0].plot(t.snapshot[found], percent * t.raw_sigma[found, i], ".-", color=COLOURS[i], label=f"{AXES[i]}, single snapshot")
        axes[0].plot(t.snapshot[t.status != LOST], percent * t.sigma[t.status != LOST, i], "--", color=COLOURS[i], label=f"{AXES[i]}, smoothed")
    axes[0].set_ylabel("standard deviation\nof the centre [% of d]")
    axes[0].legend(ncols=3, fontsize=8)
    distance = percent * np.linalg.norm(t.raw - t.centre, axis=1)
    axes[1].plot(t.snapshot[found], distance[found], ".-", color="0.3")
    axes[1].set_ylabel("single snapshot to\nsmoothed centre [% of d]")
    axes[2].plot(t.snapshot[found], t.particles_inside[found], ".-", color="0.3")
    axes[2].set_ylabel("particles inside\nthe sphere")
    axes[2].yaxis.set_major_locator(plt.MaxNLocator(integer=True))
    for status, colour in ((PREDICTED, "#e0a030"), (LOST, "#c1433c")):
        for ax in axes:
            for k, snapshot in enumerate(t.snapshot[t.status == status]):
                ax.axvline(snapshot, color=colour, lw=1.5, alpha=0.6, label=STATUS_NAMES[status] if k == 0 else None)
    if np.any(~found):
        axes[2].legend(fontsize=8)
    for ax in axes:
        ax.grid(alpha=0.3)
        ax.set_ylim(bottom=0)
    axes[2].set_xlabel("snapshot")
    return figure


def plot_reconstruction(t, run):
    rows = run["reconstruction"]
    snapshot = [r["snapshot"] for r in rows]
    series = lambda name, scale=1: [np.nan if r.get(name) is None else scale * r[name] for r in rows]
    figure, axes = plt.subplots(2, 2, figsize=(12, 6.5), sharex=True, layout="constrained")
    misfit, curl, ghosts, iterations = axes.flat
    for name, label, colour in (("MisfitVelocity", "velocity", COLOURS[2]), ("MisfitAcceleration", "acceleration", COLOURS[0])):
        misfit.plot(snapshot, series(name), ".-", color=colour, label=label)
    misfit.axhline(1, color="0.6", lw=1)
    misfit.set_ylabel("misfit at the particles\n[noise levels]")
    misfit.legend(fontsize=8)
    curl.plot(snapshot, series("PressureCurlResidual", 100), ".-", color="0.3")
    curl.set_ylabel("pressure gradient that no\npressure explains [% of its rms]")
    ghosts.plot(snapshot, [100 * r["Outliers"] / max(1, r["Outliers"] + r["ParticlesUsed"]) for r in rows], ".-", color="0.3")
    ghosts.set_ylabel("particles left out\nas ghosts [%]")
    iterations.plot(snapshot, series("Iterations"), ".-", color="0.3")
    iterations.set_ylabel("iterations on\nthe finest grid")
    for ax in axes[-1]:
        ax.set_xlabel("snapshot")
        ax.xaxis.set_major_locator(plt.MaxNLocator(integer=True))
    for ax in axes.flat:
        ax.grid(alpha=0.3)
        ax.set_ylim(bottom=0)
    return figure


def index_html(folder, t, run, captions):
    """captions: of the pictures that there are, by their names."""
    s = run["settings"]
    title = os.path.basename(s["tracks"][0]) + (f" and {len(s['tracks']) - 1} more files" if len(s["tracks"]) > 1 else "")
    shown = lambda *names: "".join(figure(folder, name, captions[name]) for name in names if name in captions)
    film = movie(folder)
    sections = [
        ("measured", "What was measured", table(measured(t, run))),
        ("path", "The sphere's path", table(path(t)) + shown("trajectory.png", "motion.png", "rotation.png")),
        ("forces", "Forces on the sphere", force_report.section(run) and force_report.section(run) + shown("forces.png", "coefficients.png")),
        ("pressure", "Pressure on the sphere", shown("surface-pressure.png", "surface.png")),
        ("flow", "The flow", shown("tracks.png", "slice.png", "vortices.png")),
        ("movie", "Movie", film),
        ("quality", "Quality", table(quality_numbers(run)) + shown("quality.png", "reconstruction.png")),
        ("files", "Files of this run", table(file_list(run, film))),
        ("settings", "Settings and versions", details(run))]
    sections = [(name, heading, body) for name, heading, body in sections if body]
    links = "".join(f'<a href="#{name}">{heading}</a>' for name, heading, _ in sections)
    bodies = "\n".join(f'<h2 id="{name}">{heading}</h2>\n{body}' for name, heading, body in sections)
    nothing = "" if np.any(t.status != LOST) else (
        "<p>The sphere was found in no snapshot, so there is nothing to plot. Check the diameter and the part of the volume that has particles.</p>")
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>RIMFlow: {html.escape(title)}</title>
<style>{STYLE}</style></head><body>
<h1>The invisible sphere</h1>
<p>{html.escape(title)}</p>
{table(results(t, run))}
{nothing}{problems(run["problems"])}
<nav>{links}</nav>
{bodies}
</body></html>
"""


def table(rows):
    lines = "".join(f"<tr><th>{html.escape(k)}</th><td>{html.escape(v)}</td></tr>\n" for k, v in rows)
    return f"<table>\n{lines}</table>\n" if rows else ""


def figure(folder, name, caption):
    """A picture inside the page, with the name under which it also lies in the report's folder."""
    kind = mimetypes.guess_type(name)[0] or "image/webp"
    with open(os.path.join(folder, name), "rb") as f:
        data = base64.b64encode(f.read()).decode("ascii")
    text = html.escape(caption)
    return f'<figure><img src="data:{kind};base64,{data}" alt="{text}"><figcaption>{text} ({html.escape(os.path.basename(name))})</figcaption></figure>\n'


def with_sigma(value, sigma, unit):
    """0.2468 +- 0.0005 m/s: as many digits as the standard deviation has two of; it may be unknown (NaN or negative)."""
    if not (np.isfinite(sigma) and sigma > 0):
        return f"{value:.4g} {unit}"
    digits = max(0, 1 - int(np.floor(np.log10(sigma))))
    return f"{value:.{digits}f} \u00b1 {sigma:.{digits}f} {unit}"


def results(t, run):
    """What one wants to know first."""
    counts = {status: int(np.sum(t.status == status)) for status in STATUS_NAMES}
    rows = [("Snapshots", f"{len(t.time)}: " + ", ".join(f"{n} {STATUS_NAMES[k]}" for k, n in counts.items() if n))]
    shown = t.status != LOST
    if shown.any():
        speed = np.linalg.norm(t.velocity[shown], axis=1)
        rows += [("Speed of the sphere", f"{speed.mean():.5f} m/s on average, {speed.min():.5f} to {speed.max():.5f} m/s"),
                 ("Reynolds number V d/nu", f"{run['reynolds']:.4g}"),
                 ("Uncertainty of the centre", f"{100 * np.mean(t.sigma[shown]) / t.diameter:.3f} % of d per axis, smoothed; "
                  f"{100 * np.mean(t.raw_sigma[t.status == FOUND]) / t.diameter:.3f} % from one snapshot (one standard deviation)"
                  if np.any(t.status == FOUND) else "no snapshot was found")]
    for key, name in force_report.METHODS:
        if key in run["forces"]:
            found = run["forces"][key]
            sigma = "" if found["Cd_sigma"] is None else f", stated uncertainty of one snapshot {found['Cd_sigma']:.3f}"
            rows.append((f"Cd, {name[0].lower()}{name[1:]}", f"{found['Cd_mean']:.3f} on average over {found['snapshots']} snapshots{sigma}"))
    if run["forces"] and run["reynolds"]:
        rows.append(("Cd of a fixed sphere", f"{standard_drag(run['reynolds']):.3f} at this Reynolds number (Brown & Lawler 2003)"))
    return rows


def measured(t, run):
    """The recording: files, times, what was put in."""
    s = run["settings"]
    names = s["tracks"] if len(s["tracks"]) <= 3 else [s["tracks"][0], "...", s["tracks"][-1]]
    rows = [("Tracks", "\n".join(names) + (f" ({len(s['tracks'])} files)" if len(s["tracks"]) > 3 else ""))]
    if len(t.time):
        rows.append(("Snapshots", f"{len(t.time)}, number {t.snapshot.min()} to {t.snapshot.max()} of the recording"))
        step = f", {1e3 * np.median(np.diff(t.time)):.4g} ms apart" if len(t.time) > 1 else ""
        rows.append(("Time", f"{t.time.min():.9g} to {t.time.max():.9g} s (the files' own){step}"))
    if run["reconstruction"]:
        used = [r["ParticlesUsed"] for r in run["reconstruction"]]
        rows.append(("Particles", f"{np.mean(used):.0f} per snapshot on average, {min(used):.0f} to {max(used):.0f}"))
    rows += [("Sphere", f"d = {1e3 * s['diameter_m']:g} mm, " + (f"{s['body_density_kg_m3']:g} kg/m3" if s["body_density_kg_m3"] else "density not known")),
             ("Fluid", f"density {s['density_kg_m3']:g} kg/m3, kinematic viscosity {s['viscosity_m2_s']:g} m2/s"),
             ("Up", ", ".join(f"{v:g}" for v in s["up"] or (0, 1, 0))),
             ("Method", {"likelihood": "void likelihood", "published": "published cost function"}[s["method"]]),
             ("Units", "SI throughout; axes and times are those of the track files")]
    return rows


def path(t):
    """The motion in numbers."""
    shown = t.status != LOST
    if not shown.any():
        return []
    first, last = np.flatnonzero(shown)[[0, -1]]
    millimetres = lambda v: "(" + ", ".join(f"{1e3 * c:.3f}" for c in v) + ") mm"
    rows = [("Path", f"from {millimetres(t.centre[first])} to {millimetres(t.centre[last])}, {1e3 * np.linalg.norm(t.centre[last] - t.centre[first]):.4g} mm apart")]
    for name, values, sigma, unit in (("Velocity", t.velocity, t.velocity_sigma, "m/s"), ("Acceleration", t.acceleration, t.acceleration_sigma, "m/s2")):
        if np.isfinite(values[shown]).all():
            rows.append((f"{name}, mean and standard deviation of one snapshot's", "; ".join(
                f"{axis} {with_sigma(values[shown, i].mean(), sigma[shown, i].mean(), unit)}" for i, axis in enumerate(AXES))))
    known = rotation_known(t)
    if known.any():
        beyond = np.sum((t.rotation[known] / t.rotation_sigma[known])**2, axis=1) > SIGNIFICANT
        rows.append(("Rotation", "; ".join(f"{axis} {with_sigma(t.rotation[known, i].mean(), t.rotation_sigma[known, i].mean(), 'rad/s')}"
                                           for i, axis in enumerate(AXES))
                     + f". More than noise (three standard deviations) in {beyond.sum()} of {known.sum()} snapshots"))
    else:
        rows.append(("Rotation", "not known"))
    return rows


def quality_numbers(run):
    """Means of what says how far to believe the flow."""
    rows = run["reconstruction"]
    if not rows:
        return []
    mean = lambda name: np.mean([r[name] for r in rows if r.get(name) is not None] or [np.nan])
    ghosts = 100 * np.mean([r["Outliers"] / max(1, r["Outliers"] + r["ParticlesUsed"]) for r in rows])
    found = [("Misfit at the particles", f"velocity {mean('MisfitVelocity'):.2f}, acceleration {mean('MisfitAcceleration'):.2f} noise levels (1 is right; far above: the grid cannot follow the flow)"),
             ("Noise of the tracks", f"velocity {mean('VelocityNoise'):.3g} m/s, acceleration {mean('AccelerationNoise'):.3g} m/s2 per component"),
             ("Particles left out as ghosts", f"{ghosts:.2f} % (worry above a few per cent)")]
    curl = mean("PressureCurlResidual")
    if np.isfinite(curl):
        found.append(("Pressure gradient that no pressure explains", f"{100 * curl:.0f} % of its rms (worry above some 20 %)"))
    return found


def problems(found):
    """What went wrong, most frequent first; what happened in many snapshots is said once, also where the numbers in it differ."""
    lines = []
    for snapshots, text, others in gathered(found):
        differing = f" (the numbers are those of snapshot {snapshots[0]})" if others else ""
        lines.append(f"<li>Snapshot{'s' if len(snapshots) > 1 else ''} {ranges(snapshots)}: {html.escape(text)}{differing}</li>")
    count = len({snapshot for snapshot, _ in found})
    return f'<div class="problems"><h2>Problems in {count} snapshot{"s" if count > 1 else ""}</h2><ul>{"".join(lines)}</ul></div>' if lines else ""


def gathered(found):
    """[(snapshot, text)] -> [(snapshots, text of the first, whether others differ in their numbers)], most frequent first."""
    groups = {}
    for snapshot, text in sorted(found):
        groups.setdefault(re.sub(r"\d+(\.\d+)?", "0", text), []).append((snapshot, text))
    return [([snapshot for snapshot, _ in group], group[0][1], len({text for _, text in group}) > 1)
            for group in sorted(groups.values(), key=lambda group: (-len(group), group[0]))]


def ranges(numbers):
    """[1, 2, 3, 7] -> '1 to 3, 7'."""
    parts = []
    for n in sorted(numbers):
        if parts and n == parts[-1][1] + 1:
            parts[-1][1] = n
        else:
            parts.append([n, n])
    return ", ".join(str(a) if a == b else f"{a}, {b}" if b == a + 1 else f"{a} to {b}" for a, b in parts)


def movie(folder):
    """The animation that `--movie` made (rimflow.movie), and what it left out."""
    at = os.path.join(folder, "movie")
    if not os.path.exists(os.path.join(at, "movie.json")):
        return ""
    with open(os.path.join(at, "movie.json"), encoding="utf-8") as f:
        made = json.load(f)
    if not made["preview"]:
        return "<p>No frame could be drawn.</p>" + problems(made["left_out"])
    what = "the sphere with the pressure on it, its wake (iso-surface of the Q-criterion)" if made["frames_with_wake"] else "the sphere with the pressure on it"
    full = f" In full size: movie/{made['video']} (for players and slides)." if made["video"] else ""
    missing = "".join(f"<p>Left out: snapshot{'s' if len(snapshots) > 1 else ''} {ranges(snapshots)}, {html.escape(text)}.</p>"
                      for snapshots, text, _ in gathered(made["left_out"]))
    return (figure(folder, os.path.join("movie", made["preview"]), f"{what[0].upper()}{what[1:]}, and the drag over time; {made['frames']} frames, "
                   "the colours mean the same in all of them")
            + f"<p>Single frames: movie/NNNNNN.png, by the snapshot's number.{full}</p>{missing}")


def file_list(run, film):
    """What lies in the run's folder, and what to open it with."""
    s = run["settings"]
    rows = [("trajectory.csv", "place, velocity, acceleration, covariance, rotation of the sphere per snapshot, and what the single snapshots said; for a spreadsheet, "
             "pandas, Matlab; in ParaView: File > Open, CSV Reader")]
    if s["forces"]:
        rows.append(("forces.csv", "forces by three methods with standard deviations per snapshot; in ParaView: File > Open, CSV Reader, then Plot Data with time_s as X array"))
    rows += [("sphere.pvd", "the sphere over time; in ParaView: File > Open, Apply" + (", colour by Pressure, Play" if run["forces"] else ", Play")),
             ("trajectory.vtp", "the path as a line with the same numbers; in ParaView: File > Open, Apply, colour by any array"),
             ("trajectory.dat", "the path as text for other programs; in ParaView with the plugin: File > Open, Sphere Trajectory Reader (a Body for the filters)")]
    if s["fields"] != "none":
        rows.append(("fields.pvd", "velocity, acceleration, vorticity, Q-criterion, pressure and its error on a grid; in ParaView: File > Open, Apply, then Slice, or Contour by QCriterion"))
    if film:
        rows.append(("report/movie/", "the movie and its frames"))
    rows += [("report/", "this page and its pictures"), ("run.json", "settings, versions, timings, quality and problems per snapshot, for programs")]
    return rows


def details(run):
    """What is needed to make the run again."""
    v = run["versions"]
    rows = [("Computed", f"{run['started']}, {run['seconds']:.1f} s on {run['ranks']} process{'es' if run['ranks'] > 1 else ''}"),
            ("Of this", ", ".join(f"{name[:-2]} {seconds:.1f} s" for name, seconds in run["timings"].items())),
            *([("Memory", f"{run['memory_peak_MB']} MB at most per process")] if "memory_peak_MB" in run else []),
            ("Versions", ", ".join(f"{name} {number}" for name, number in v.items()))]
    settings = html.escape(json.dumps(run["settings"], indent=1))
    return table(rows) + f"<details><summary>All settings, as in run.json</summary><pre>{settings}</pre></details>"
