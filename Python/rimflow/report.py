"""The report of a run: plots (PNG) and index.html, readable without a network connection."""
import html
import os

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from rimflow import force_report
from rimflow.files import replacing, write_text

AXES = ("x", "y", "z")
COLOURS = ("#c1433c", "#3b7d3c", "#33609e")
FOUND, PREDICTED, LOST = 0, 1, 2
STYLE = """body{font:16px/1.5 sans-serif;max-width:1100px;margin:2em auto;padding:0 1em;color:#222}
.numbers td,.numbers th{padding:0.1em 1.2em 0.1em 0;font-variant-numeric:tabular-nums}
th{text-align:left;padding-right:2em;font-weight:600;vertical-align:top}img{max-width:100%}figure{margin:2em 0}figcaption{color:#555}"""
STATUS_NAMES = {FOUND: "found", PREDICTED: "predicted from its neighbours", LOST: "lost"}


def write_report(folder, trajectory, run, forces=None):
    """trajectory: arrays over the snapshots (see rimflow.process.Trajectory); run: what run.json holds; forces: rimflow.forces.Forces.
    Returns the file names."""
    os.makedirs(folder, exist_ok=True)
    pages = []
    if np.any(trajectory.status != LOST):
        pages = [("trajectory.png", "Trajectory of the sphere's centre, coloured by its speed", plot_trajectory),
                 ("motion.png", "Position and velocity over time; the bands are two standard deviations wide to either side", plot_motion),
                 ("quality.png", "How well each snapshot was determined", plot_quality)]
    if forces and forces.known.any():
        of_forces = lambda plot: lambda trajectory, run: plot(trajectory, forces, run)
        pages += [(name, caption, of_forces(plot)) for name, caption, plot in force_report.PAGES]
    if run["reconstruction"]:
        pages.append(("reconstruction.png", "How well the flow was reconstructed", plot_reconstruction))
    for name, _, plot in pages:
        figure = plot(trajectory, run)
        with replacing(os.path.join(folder, name)) as temporary:
            figure.savefig(temporary, dpi=110)
        plt.close(figure)
    write_text(os.path.join(folder, "index.html"), index_html(folder, trajectory, run, pages))
    return [name for name, _, _ in pages] + ["index.html"]


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
    limits = np.stack([low, high])[:, order]
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
    figure, axes = plt.subplots(3, 2, figsize=(11, 8), sharex=True, layout="constrained")
    time = t.time[shown]
    for i in range(3):
        position, sigma = 1e3 * t.centre[shown, i], 1e3 * t.sigma[shown, i]
        line = _line(time, position)
        left, right = axes[i]
        found = t.status == FOUND
        left.plot(t.time[found], 1e3 * t.raw[found, i] - _line(time, position, t.time[found]), "+", color="0.45", label="single snapshots")
        left.fill_between(time, position - line - 2 * sigma, position - line + 2 * sigma, color=COLOURS[i], alpha=0.25, lw=0)
        left.plot(time, position - line, color=COLOURS[i], label="smoothed")
        slope = (line[-1] - line[0]) / (time[-1] - time[0]) if len(time) > 1 else 0.0
        left.set_ylabel(f"{AXES[i]} - line [mm]")
        left.set_title(f"{AXES[i]} less the straight line {line[0]:.3f} mm {slope / 1e3:+.4f} m/s (t - t0)", fontsize=9)
        velocity, sigma = t.velocity[shown, i], t.velocity_sigma[shown, i]
        right.fill_between(time, velocity - 2 * sigma, velocity + 2 * sigma, color=COLOURS[i], alpha=0.25, lw=0)
        right.plot(time, velocity, color=COLOURS[i])
        right.set_ylabel(f"{'uvw'[i]} [m/s]")
    speed = np.linalg.norm(t.velocity[shown], axis=1)
    axes[0, 1].set_title(f"velocity; speed {speed.mean():.4f} m/s on average, {speed.min():.4f} to {speed.max():.4f}", fontsize=9)
    axes[0, 0].legend(fontsize=8)
    for ax in axes.flat:
        ax.grid(alpha=0.3)
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
        ax.ticklabel_format(axis="x", useOffset=False)
    return figure


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
    series = lambda name, scale=1: [scale * r[name] for r in rows]
    figure, axes = plt.subplots(3, 1, figsize=(10, 9), sharex=True, layout="constrained")
    for name, label, colour in (("MisfitVelocity", "velocity", COLOURS[2]), ("MisfitAcceleration", "acceleration", COLOURS[0])):
        axes[0].plot(snapshot, series(name), ".-", color=colour, label=label)
    axes[0].axhline(1, color="0.6", lw=1)
    axes[0].set_ylabel("misfit at the particles\n[noise levels]")
    axes[0].legend(fontsize=8)
    axes[1].plot(snapshot, series("Iterations"), ".-", color="0.3")
    axes[1].set_ylabel("iterations on\nthe finest grid")
    axes[2].plot(snapshot, [100 * r["Outliers"] / max(1, r["Outliers"] + r["ParticlesUsed"]) for r in rows], ".-", color="0.3")
    axes[2].set_ylabel("particles left out\nas ghosts [%]")
    axes[2].set_xlabel("snapshot")
    axes[2].xaxis.set_major_locator(plt.MaxNLocator(integer=True))
    for ax in axes:
        ax.grid(alpha=0.3)
        ax.set_ylim(bottom=0)
    return figure


def index_html(folder, t, run, pages):
    s = run["settings"]
    counts = {status: int(np.sum(t.status == status)) for status in STATUS_NAMES}
    rows = [("Snapshots", f"{len(t.time)}: " + ", ".join(f"{n} {STATUS_NAMES[k]}" for k, n in counts.items() if n)),
            ("Time", f"{t.time.min():.6g} to {t.time.max():.6g} s" if len(t.time) else "none"),
            ("Sphere", f"d = {1e3 * s['diameter_m']:g} mm, " + (f"{s['body_density_kg_m3']:g} kg/m3" if s["body_density_kg_m3"] else "density not known")),
            ("Fluid", f"{s['density_kg_m3']:g} kg/m3, {s['viscosity_m2_s']:g} m2/s")]
    shown = t.status != LOST
    if shown.any():
        speed = np.linalg.norm(t.velocity[shown], axis=1)
        rows += [("Speed of the sphere", f"{speed.mean():.5f} m/s on average, {speed.min():.5f} to {speed.max():.5f} m/s"),
                 ("Reynolds number V d/nu", f"{run['reynolds']:.4g}"),
                 ("Uncertainty of the centre", f"{100 * np.mean(t.sigma[shown]) / t.diameter:.3f} % of d per axis, smoothed; "
                  f"{100 * np.mean(t.raw_sigma[t.status == FOUND]) / t.diameter:.3f} % from one snapshot (one standard deviation)"
                  if np.any(t.status == FOUND) else "no snapshot was found")]
    rows += [("Method", {"likelihood": "void likelihood", "published": "published cost function"}[s["method"]]),
             ("Computed", f"{run['started']}, {run['seconds']:.1f} s, RIMFlow {run['versions']['rimflow']}, ParaView {run['versions']['paraview']}")]
    table = "\n".join(f"<tr><th>{html.escape(k)}</th><td>{html.escape(v)}</td></tr>" for k, v in rows)
    images = sorted(f for f in os.listdir(folder) if f.endswith(".png") and f not in [p[0] for p in pages])
    figures = "\n".join(f'<figure><img src="{name}" alt="{html.escape(caption)}"><figcaption>{html.escape(caption)}</figcaption></figure>'
                        for name, caption in [(n, c) for n, c, _ in pages] + [(n, image_caption(n)) for n in images])
    problems = "\n".join(f"<li>Snapshot {k}: {html.escape(text)}</li>" for k, text in run["problems"])
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>RIMFlow: {html.escape(os.path.basename(s['tracks'][0]))}</title>
<style>{STYLE}</style></head><body>
<h1>The invisible sphere</h1>
<p>{html.escape(os.path.basename(s['tracks'][0]))}{f" and {len(s['tracks']) - 1} more files" if len(s['tracks']) > 1 else ""}</p>
<table>
{table}
</table>
{f"<h2>Problems</h2><ul>{problems}</ul>" if problems else ""}
{force_report.section(run)}
{figures if figures else "<p>The sphere was found in no snapshot, so there is nothing to plot. Check the diameter and the part of the volume that has particles.</p>"}
<p>Files beside this report: trajectory.csv{" and forces.csv" if s["forces"] else ""} (all numbers), sphere.pvd (open it in ParaView{"; colour it by Pressure" if run["forces"] else ""}){", fields.pvd (the flow, open it in ParaView)" if s["fields"] != "none" else ""}, run.json (settings, versions, timings).</p>
</body></html>
"""


def image_caption(name):
    return {"tracks.png": "Particle tracks, coloured by their speed, and the sphere that was found among them",
            "vortices.png": "Vortices (iso-surface of the Q-criterion, coloured by the velocity along the sphere's motion) and the sphere",
            "slice.png": "Velocity in the plane through the sphere's centre",
            "surface.png": "Pressure on the sphere at the instants A to D of the plots over time, from the side, the front and the rear"}.get(name, name)
