"""The report of `rimflow sensitivity`: plots (PNG) beside the published limits, and index.html, readable without a network connection."""
import html
import os

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from rimflow import report
from rimflow.files import replacing, write_text

GOOD, BAD, PLAIN = "#33609e", "#c1433c", "0.35"
TITLES = {
    "step": "finite-difference step", "weights": "weights ±10 %", "shells": "radii of the shells", "search": "search cube ±25 %",
    "guess": "initial guess", "model": "noise and ghosts as given", "noise": "noise added to the data", "drop": "particles dropped",
    "single criterion": "each criterion alone", "stated uncertainty": "stated standard deviation"}
METHODS = {"likelihood": "void likelihood", "published": "published cost function"}
SHOWN_FROM = 1e-6  # diameters; what is smaller is drawn there


def write_report(folder, run, rows, tracks, calibration, recording):
    """rows: of sensitivity.csv (rimflow.sensitivity.Row); tracks: the baseline per method; calibration: or None; recording: the snapshots."""
    os.makedirs(folder, exist_ok=True)
    for name in os.listdir(folder):  # of an earlier run with other methods
        if name.endswith(".png"):
            os.remove(os.path.join(folder, name))
    pages = []
    for method in tracks:
        mine = [r for r in rows if r.method == method]
        if len(mine) > 2:
            pages.append((f"shifts-{method}.png", f"{METHODS[method].capitalize()}: how far the centre moves from the baseline when one thing is "
                          "changed. Dots: mean over the snapshots, rings: largest; below 0.000001 drawn there. Lines: the limits.", lambda mine=mine: plot_shifts(mine)))
    if calibration:
        pages.append(("weights.png", "Published cost function over its weights: frame-to-frame jitter of the centre, the snapshots that converged, and how far "
                      "the centre is from that of the void likelihood. Steady is not yet true.",
                      lambda: plot_weights(calibration, run)))
    for method, track in tracks.items():
        mine = [r for r in rows if r.method == method]
        pages.append((f"snapshots-{method}.png", f"{METHODS[method].capitalize()}, snapshot by snapshot, and the shifts over time",
                      lambda mine=mine, track=track, method=method: plot_snapshots(method, track, mine, recording)))
    for name, _, plot in pages:
        figure = plot()
        with replacing(os.path.join(folder, name)) as temporary:
            figure.savefig(temporary, dpi=110)
        plt.close(figure)
    write_text(os.path.join(folder, "index.html"), index_html(folder, run, rows, tracks, calibration, pages))


def plot_shifts(rows):
    """One line per variation, grouped by study, on a logarithmic axis."""
    rows = [r for r in rows if r.study != "baseline"]
    studies = list(dict.fromkeys(r.study for r in rows))
    figure, ax = plt.subplots(figsize=(10, 1.8 + 0.23 * (len(rows) + 1.4 * len(studies))), layout="constrained")
    y, ticks, labels = 0.0, [], []
    for study in studies:
        mine = [r for r in rows if r.study == study]
        ax.text(0.005, y, TITLES.get(study, study), transform=ax.get_yaxis_transform(), va="center", fontsize=9, fontweight="bold")
        top = y + 0.5
        for r in mine:
            y += 1
            colour = {"yes": GOOD, "no": BAD}.get(r.holds, PLAIN)
            ticks.append(y)
            labels.append(r.variation)
            if np.isfinite(r.mean):
                mean, most = max(r.mean, SHOWN_FROM), max(r.max, SHOWN_FROM)
                ax.plot([mean, most], [y, y], color=colour, lw=1.5, alpha=0.5)
                ax.plot(mean, y, "o", color=colour, ms=6)
                ax.plot(most, y, "o", mec=colour, mfc="white", ms=5)
            if np.isfinite(r.expected):
                ax.plot(r.expected, y, "x", color="0.2", ms=6)
        limit = mine[0].limit
        for value, style in ((limit.mean, "-"), (limit.max, "--")):
            if value:
                ax.plot([value, value], [top, y + 0.5], style, color="black", lw=1.6)
        if limit.published_mean and limit.published_mean != limit.mean:
            ax.plot([limit.published_mean] * 2, [top, y + 0.5], ":", color="0.45", lw=1.6)
        y += 1.4
    ax.set(xscale="log", xlim=(SHOWN_FROM / 1.5, 1.5), ylim=(y - 0.6, -1), xlabel="distance from the baseline's centre [diameters]")
    ax.set_yticks(ticks, labels, fontsize=8)
    ax.grid(axis="x", alpha=0.3)
    handles = [plt.Line2D([], [], marker="o", ls="", color=PLAIN, label="mean"),
               plt.Line2D([], [], marker="o", ls="", mec=PLAIN, mfc="white", label="largest"),
               plt.Line2D([], [], color="black", label="limit of the mean"), plt.Line2D([], [], color="black", ls="--", label="limit of the largest"),
               plt.Line2D([], [], marker="s", ls="", color=GOOD, label="keeps it"), plt.Line2D([], [], marker="s", ls="", color=BAD, label="does not")]
    if any(r.limit.published_mean and r.limit.published_mean != r.limit.mean for r in rows):
        handles.append(plt.Line2D([], [], color="0.45", ls=":", label="published limit of the mean"))
    if any(np.isfinite(r.expected) for r in rows):
        handles.append(plt.Line2D([], [], marker="x", ls="", color="0.2", label="expected by chance"))
    ax.legend(handles=handles, loc="lower left", bbox_to_anchor=(0, 1), ncols=4, fontsize=8, frameon=False)
    return figure


def plot_weights(c, run):
    figure, axes = plt.subplots(1, 3, figsize=(16, 5), layout="constrained")
    n = len(run["settings"]["snapshots"])
    for ax, values, title in ((axes[0], 100 * c.jitter, "jitter from snapshot to snapshot [% of d]"),
                              (axes[1], 100 * c.converged, f"snapshots that converged, of {n} [%]"),
                              (axes[2], 100 * c.distance, "distance from the void likelihood's centre [% of d]")):
        image = ax.imshow(values.T, origin="lower", cmap="viridis" if ax is axes[1] else "viridis_r", aspect="auto",
                          vmin=0, vmax=100 if ax is axes[1] else np.nanmax(values))
        middle = 0.5 * image.get_clim()[1]
        for i in range(len(c.w1)):
            for j in range(len(c.w2)):
                dark = (values[i, j] > middle) == (ax is not axes[1])
                ax.text(i, j, f"{values[i, j]:.3g}", ha="center", va="center", fontsize=9, color="white" if dark else "black")
                if c.retained[i, j]:
                    ax.add_patch(plt.Rectangle((i - 0.46, j - 0.46), 0.92, 0.92, fill=False, ec="#e0702a", lw=2.5))
        if c.chosen:
            ax.plot(c.chosen[0] + 0.32, c.chosen[1] + 0.3, "*", color="#e0702a", ms=15, mec="black")
        ax.plot(int(np.argmin(np.abs(c.w1 - 3.077))) + 0.32, int(np.argmin(np.abs(c.w2 - 4.415))) - 0.3, "P", color="white", ms=9, mec="black")
        ax.set_xticks(range(len(c.w1)), [f"{w:.3g}" for w in c.w1])
        ax.set_yticks(range(len(c.w2)), [f"{w:.3g}" for w in c.w2])
        ax.set(xlabel="w1, weight of the velocity", ylabel="w2, weight of the vortices", title=title)
        figure.colorbar(image, ax=ax)
    handles = [plt.Line2D([], [], marker="s", ls="", mfc="none", mec="#e0702a", mew=2.5, ms=10, label="retained"),
               plt.Line2D([], [], marker="*", ls="", color="#e0702a", mec="black", ms=13, label="chosen"),
               plt.Line2D([], [], marker="P", ls="", color="white", mec="black", ms=9, label="published")]
    axes[0].legend(handles=handles, loc="upper left", bbox_to_anchor=(0, -0.12), ncols=3, frameon=False)
    return figure


def plot_snapshots(method, track, rows, recording):
    """Cost and gradient, single criteria, stated uncertainty, and the shift of every study over time."""
    time, d = np.array(recording.times), recording.diameter
    published = method == "published"
    figure, axes = plt.subplots(4 if published else 2, 1, figsize=(10, 11 if published else 6.5), sharex=True, layout="constrained")
    panels = iter(axes)
    if published:
        ax = next(panels)
        ax.plot(time, track.cost, ".-", color=PLAIN, label="cost J at the minimum")
        ax.set_ylabel("J*")
        other = ax.twinx()
        other.plot(time, 0.5 * d * track.gradient_norm, "x", color=BAD)
        logarithmic(other)
        other.set_ylabel("R |grad J| where\nthe search ended (x)", color=BAD)
        ax = next(panels)
        for i, name in enumerate(("void density", "velocity", "vortices")):
            ax.plot(time, track.offsets[:, i] / d, ".-", color=report.COLOURS[i], label=name)
        ax.axhline(0.05, color="black", lw=1.2, label="published limit")
        ax.set_ylabel("minimum of one criterion\nto the centre found [d]")
        above(ax, 4)
    ax = next(panels)
    for i, name in enumerate(report.AXES):
        ax.plot(time, 100 * track.sigma[:, i] / d, ".-", color=report.COLOURS[i], label=name)
    limit = next(r.limit for r in rows if r.study == "stated uncertainty")
    ax.axhline(100 * limit.published_mean, color="black", lw=1.2, label="paper, mean")
    ax.axhline(100 * limit.published_max, color="black", lw=1.2, ls="--", label="paper, largest")
    ax.set_ylabel("stated standard\ndeviation [% of d]")
    logarithmic(ax)
    above(ax, 5)
    ax = next(panels)
    studies = [s for s in dict.fromkeys(r.study for r in rows) if s not in ("baseline", "single criterion", "stated uncertainty")]
    for study, colour in zip(studies, plt.cm.tab10.colors):
        mean = np.nanmean([np.where(np.isfinite(r.shift), r.shift, np.nan) for r in rows if r.study == study], axis=0)
        ax.plot(time, np.maximum(mean, SHOWN_FROM), ".-", color=colour, label=TITLES[study])
    if studies:
        ax.set(yscale="log")
        above(ax, 3)
    ax.set_ylabel("shift, mean over a\nstudy's variations [d]")
    for ax in axes:
        ax.grid(alpha=0.3)
    axes[-1].set_xlabel("time [s]")
    axes[-1].ticklabel_format(axis="x", useOffset=False)
    return figure


def logarithmic(ax):
    """A logarithmic y axis over a decade or two, with plain numbers at 1, 2, 5."""
    ax.set_yscale("log")
    ax.yaxis.set_major_locator(plt.LogLocator(subs=(1, 2, 5)))
    ax.yaxis.set_major_formatter(plt.FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_locator(plt.NullLocator())


def above(ax, columns):
    ax.legend(fontsize=8, ncols=columns, loc="lower left", bbox_to_anchor=(0, 0.98), frameon=False)


def number(value):
    return "" if value is None or not np.isfinite(value) else f"{value:.2g}" if value else "0"


def index_html(folder, run, rows, tracks, calibration, pages):
    s = run["settings"]
    title = os.path.basename(s["tracks"][0])
    head = [("Snapshots", f"{len(s['snapshots'])}: " + ", ".join(map(str, s["snapshots"]))), ("Sphere", f"d = {1e3 * s['diameter_m']:g} mm"),
            ("Up", ", ".join(f"{v:g}" for v in s["up"]) if s["up"] else "the direction of the sphere's motion")]
    if run["grid_spacing_m"]:
        head.append(("Grid spacing", f"{1e3 * np.mean(run['grid_spacing_m']):.4g} mm"))
    if "published" in tracks:
        head.append(("Cost at the minimum", spread(run["cost"]["published"], "J*")))
        head.append(("Gradient there", spread(run["gradient_norm_1_m"]["published"], "R |grad J|", 0.5 * s["diameter_m"])))
    if calibration:
        chosen = run["chosen_weights"]
        head.append(("Weights that converge most steadily", f"w1 = {chosen[0]:.4g}, w2 = {chosen[1]:.4g} "
                     f"({int(calibration.retained.sum())} of {calibration.retained.size} pairs retained{'; they lie on the edge of the grid that was searched' if run['chosen_weights_on_edge'] else ''})" if chosen else "none on the grid"))
    head.append(("Computed", f"{run['started']}, {run['seconds']:.1f} s, RIMFlow {run['versions']['rimflow']}, ParaView {run['versions']['paraview']}"))
    figures = "".join(report.figure(folder, name, caption) for name, caption, _ in pages)
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>RIMFlow, sensitivity: {html.escape(title)}</title>
<style>{report.STYLE}
.studies{{border-collapse:collapse;font-size:14px}}.studies th,.studies td{{padding:.15em .8em .15em 0;text-align:left}}.studies .no{{color:{BAD};font-weight:600}}</style></head><body>
<h1>How firm is the sphere's place?</h1>
<p>{html.escape(title)}{f" and {len(s['tracks']) - 1} more files" if len(s['tracks']) > 1 else ""}. Distances are in diameters of the sphere, from the centre that is found with nothing changed (the baseline).
They say how far the answer moves, not how far it is from the truth.</p>
{report.table(head)}
{"".join(summary(method, [r for r in rows if r.method == method]) for method in tracks)}
{figures}
<p>Files beside this report: sensitivity.csv (every variation), snapshots.csv (the baseline per snapshot){", weights.csv (every pair of weights)" if calibration else ""}, run.json (settings, versions).</p>
</body></html>
"""


def summary(method, rows):
    """One line per study: its worst variation against the limit, and whether the shift grows over time."""
    lines = []
    for study in dict.fromkeys(r.study for r in rows if r.study != "baseline"):
        mine = [r for r in rows if r.study == study]
        worst = max(mine, key=lambda r: r.mean if np.isfinite(r.mean) else np.inf)
        most = max((r.max for r in mine if np.isfinite(r.max)), default=np.nan)
        kept = sum(r.holds == "yes" for r in mine)
        judged = sum(r.holds != "" for r in mine)
        verdict = "no limit given" if not judged else f"{kept} of {judged} keep it" if kept < judged else "yes"
        growing = [r for r in mine if r.drift > 2 * r.drift_sigma and r.drift > 0.005]
        steady = "" if not np.isfinite(mine[0].drift) else f"{len(growing)} of {len(mine)} drift" if growing else "none"
        limit, mark = worst.limit, ' class="no"' if kept < judged else ""
        lines.append(f"<tr><td>{html.escape(TITLES.get(study, study))}</td><td>{number(worst.mean)}</td><td>{number(limit.mean)}</td>"
                     f"<td>{number(most)}</td><td>{number(limit.max)}</td><td>{number(limit.published_mean)}</td><td>{number(worst.expected)}</td>"
                     f"<td>{steady}</td><td{mark}>{verdict}</td></tr>")
    return f"""<h2>{METHODS[method].capitalize()}</h2>
<table class="studies"><tr><th>study</th><th>mean [d], worst variation</th><th>its limit</th><th>largest [d]</th><th>its limit</th><th>published limit of the mean</th>
<th>expected by chance</th><th>drift over time</th><th>kept?</th></tr>
{"".join(lines)}</table>
"""


def spread(known, name, scale=1.0):
    if known is None:
        return "not known"
    mean, std, least, most = (scale * known[key] for key in ("mean", "std", "min", "max"))
    return f"{name} = {mean:.4g} on average, standard deviation {std:.3g}, {least:.4g} to {most:.4g}"
