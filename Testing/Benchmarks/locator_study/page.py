"""Tables (Markdown) and plots (PNG) from the rows of results.csv."""
import os

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import LogLocator

from locate import PUBLISHED, VOID
from tables import markdown, numbers, unique

COLOUR = {VOID: "#0072b2", PUBLISHED: "#d55e00"}  # Okabe and Ito's
MARKER = {VOID: "o", PUBLISHED: "s"}
LEAST = 0.1           # foot of the axis of chi-squared
FEW = 20  # snapshots: the chi2 of fewer says little
CHI2 = 0.5, 2.0       # the stated uncertainty is true while chi-squared per degree of freedom lies between
PAPER = {7.93: (1.1, 8.1), 9.53: (1.2, 7.7), 11.11: (0.7, 4.0)}  # Jose et al. 2025, tab:uncertainties: d in mm -> mean, largest in % of d
CLOUDS = {"seeding": "seeding", "noise": "position noise", "ghosts": "ghosts in the sphere", "wake depth": "wake depleted by", "wake width": "wake depleted by",
          "edge": "centre", "corner": "centre", "light sheet": "light", "thin side": "seeding", "diameter": "diameter"}


def value(row, column):
    return float(row[column]) if row[column] != "" else np.nan


def percent(row, column, digits=2):
    v = 100 * value(row, column)
    return "-" if np.isnan(v) else f"{v:.{digits}f}"


def chi2_text(row):
    v = value(row, "chi2_per_dof")
    return "-" if np.isnan(v) else f"{v:.2f}" if CHI2[0] <= v <= CHI2[1] else f"**{v:.2f}**"


def found_text(row):
    wrong, extra = int(row["wrong"]), int(row["extra"])
    return f"{row['found']} of {row['snapshots']}" + (f", {wrong} wrong" if wrong else "") + (f", {extra} too many" if extra else "")


def clouds(rows):
    """Single snapshots of the default method; the usual case, which is part of several studies, once."""
    found = {tuple(v for k, v in r.items() if k not in ("study", "case", "value")): r for r in reversed(rows) if r["tracks"] == "cloud" and r["study"] in CLOUDS}
    return list(found.values())[::-1]


def label(row):
    return f"{CLOUDS[row['study']]} {row['case']}"


# --- tables ----------------------------------------------------------------------------------------------------------------------------

def single_table(rows):
    lines = [[label(r), found_text(r), f"{r['blind_found']} of {r['blind']}", percent(r, "mean_error"), percent(r, "largest_error"), percent(r, "stated_mean"), chi2_text(r),
              percent(r, "within68", 0), percent(r, "within95", 0)] for r in clouds(rows)]
    return markdown(["case", "found", "of these without a guess", "error, % of d: mean", "largest", "stated sigma, % of d", "chi2 per dof", "within 68 % ellipsoid", "within 95 %"], lines)


def both_table(rows):
    rows = [r for r in rows if r["tracks"] == "Stokes" and r["study"] in CLOUDS] + [r for r in rows if r["tracks"] == "CFD series" and r["estimate"] == "single"]
    lines = []
    for study, case in dict.fromkeys((r["study"], r["case"]) for r in rows):
        ours, theirs = (numbers(rows, study=study, case=case, method=m) for m in (VOID, PUBLISHED))
        if ours and theirs:
            text = case if study == "part of the tracks" else label(ours[0])
            lines.append(["CFD" if study == "part of the tracks" else "Stokes", text]
                         + [cell for r in (ours[0], theirs[0]) for cell in (found_text(r), f"{percent(r, 'mean_error')} / {percent(r, 'largest_error')}", percent(r, "stated_mean"), chi2_text(r))])
    head = [f"{m}: {c}" if i == 0 else c for m in (VOID, PUBLISHED) for i, c in enumerate(("found", "error mean / largest, % of d", "stated, % of d", "chi2"))]
    return markdown(["flow", "case"] + head, lines)


def series_table(rows):
    rows = [r for r in rows if r["study"] in ("series", "part of the tracks")]
    lines = []
    for tracks, method, case in dict.fromkeys((r["tracks"], r["method"], r["case"]) for r in rows):
        single, smoothed, velocity = (numbers(rows, tracks=tracks, method=method, case=case, estimate=e)[0] for e in ("single", "smoothed", "velocity"))
        lines.append([tracks.split()[0], case, method, found_text(single), f"{percent(single, 'mean_error')} / {percent(single, 'largest_error')}", chi2_text(single),
                      f"{percent(smoothed, 'mean_error')} / {percent(smoothed, 'largest_error')}", chi2_text(smoothed),
                      f"{percent(velocity, 'mean_error')} / {percent(velocity, 'largest_error')}", chi2_text(velocity)])
    return markdown(["flow", "case", "method", "found", "single snapshot, % of d: mean / largest", "chi2", "smoothed: mean / largest", "chi2", "velocity, %: mean / largest", "chi2"], lines)


def none_table(rows):
    return markdown(["tracers without a sphere", "snapshots", "false finds"], [[r["case"], r["snapshots"], r["extra"]] for r in numbers(rows, study="no sphere")])


def paper_table(rows):
    def pair(found, *columns):
        return " / ".join(percent(found[0], c) for c in columns) if found else "-"

    lines = []
    for d, (mean, largest) in PAPER.items():
        here = numbers([r for r in rows if r["study"] == "diameter"], value=d)
        theirs, ours = numbers(here, method=PUBLISHED), numbers(here, tracks="cloud")
        lines.append([f"{d:g} mm", f"{mean} / {largest}", pair(theirs, "stated_mean", "stated_largest"), pair(theirs, "mean_error", "largest_error"),
                      pair(ours, "stated_mean", "stated_largest"), pair(ours, "mean_error", "largest_error")])
    return markdown(["diameter", "paper: stated", "published cost here: stated", "its true error", "void likelihood: stated", "its true error"], lines)


def grid_rows(rows):
    return sorted(numbers(rows, study="grid", estimate="single"), key=lambda r: (r["tracks"] == "Stokes", float(r["value"])))


def grid_table(rows):
    return markdown(["flow", "grid spacing", "found", "error, % of d: mean", "largest", "stated, % of d", "chi2 per dof"],
                    [[r["tracks"].split()[0], f"{1e3 * value(r, 'grid_spacing_m'):.2f} mm ({r['case']})", found_text(r), percent(r, "mean_error"), percent(r, "largest_error"),
                      percent(r, "stated_mean"), chi2_text(r)] for r in grid_rows(rows)])


def weak_table(rows):
    """Where the default method's statement is not true, or its answer is wrong or missing."""
    lines = []
    for r in clouds(rows) + [r for r in numbers(rows, method=VOID) if r["tracks"] != "cloud" or r["study"] not in CLOUDS]:
        chi2, empty = value(r, "chi2_per_dof"), r["study"] == "no sphere"
        faults = [f"chi2 per dof {chi2:.2f}"] * (int(r["snapshots"]) >= FEW and not CHI2[0] <= chi2 <= CHI2[1] and not empty and r["found"] != "0" and (r["tracks"] == "cloud" or chi2 > CHI2[1]))
        faults += [f"{r['wrong']} of {r['snapshots']} finds wrong"] * (r["wrong"] != "0") + [f"{r['extra']} false finds in {r['snapshots']}"] * (r["extra"] != "0")
        lost = int(r["snapshots"]) - int(r["found"]) - int(r["wrong"])
        faults += [f"{lost} of {r['snapshots']} lost"] * (lost > 0 and not empty and r["estimate"] == "single")
        if faults:
            lines.append([r["tracks"], label(r) if r["study"] in CLOUDS else f"{r['study']}: {r['case']}", r["estimate"], "; ".join(faults)])
    return markdown(["tracks", "case", "estimate", "what is off"], lines or [["none", "", "", ""]])


# --- plots -----------------------------------------------------------------------------------------------------------------------------

def finish(ax, x, y, log="y"):
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    ax.grid(alpha=0.3, which="both")
    for axis, name in ((ax.xaxis, "x"), (ax.yaxis, "y")):
        if name in log:
            low, high = axis.get_view_interval()
            if axis.get_scale() == "log" and high < 60 * low and not axis.get_major_locator().__class__.__name__.startswith("Fixed"):
                axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter(plt.FuncFormatter(lambda v, _: f"{v:g}"))
            axis.set_minor_formatter(plt.NullFormatter())


def band(ax, direction="h"):
    span, line = (ax.axhspan, ax.axhline) if direction == "h" else (ax.axvspan, ax.axvline)
    span(*CHI2, color="#009e73", alpha=0.13, lw=0)
    line(1, color="#009e73", lw=1)


def error_lines(ax, rows, method):
    """Mean and largest error over the case's value."""
    rows = sorted((r for r in rows if r["mean_error"] != ""), key=lambda r: float(r["value"]))
    if not rows:
        return
    x = [float(r["value"]) for r in rows]
    look = {"color": COLOUR[method], "marker": MARKER[method], "ms": 5}
    ax.plot(x, [100 * value(r, "mean_error") for r in rows], "-", lw=2, label=f"{method}: mean error", **look)
    ax.plot(x, [100 * value(r, "largest_error") for r in rows], ":", lw=1.2, mfc="none", label=f"{method}: largest error", **look)
    ax.plot(x, [100 * value(r, "stated_mean") for r in rows], "--", lw=1, color=COLOUR[method], label=f"{method}: stated sigma")


def chi2_line(ax, rows, method, **look):
    """Over the case's value; what lies below the axis stands at its foot, as a triangle that points down."""
    rows = sorted((r for r in rows if r["chi2_per_dof"] != ""), key=lambda r: float(r["value"]))
    if not rows:
        return
    x, y = (np.array([f(r) for r in rows]) for f in (lambda r: float(r["value"]), lambda r: value(r, "chi2_per_dof")))
    look = {"color": COLOUR[method], "marker": MARKER[method], "lw": 2, **look}
    ax.plot(x, np.maximum(y, LEAST), **look)
    if (y < LEAST).any():
        ax.plot(x[y < LEAST], np.full((y < LEAST).sum(), LEAST), "v", color=COLOUR[method], ms=10, clip_on=False, zorder=4)


def chi2_axis(ax, x, log="y"):
    band(ax)
    ax.set_yscale("log")
    top = max(np.nanmax(line.get_ydata()) for line in ax.lines if len(line.get_ydata()))
    ax.set_ylim(LEAST, max(ax.get_ylim()[1], 1.2 * top, 4))
    finish(ax, x, "chi$^2$ per degree of freedom [-]", log)


def legend_below(figure, ax, columns):
    handles, names = ax.get_legend_handles_labels()
    figure.legend(handles, names, loc="lower center", ncols=columns, fontsize=9)


def seeding_plot(rows):
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 5.2))
    found = numbers(rows, study="seeding")
    for method, tracks in ((VOID, "cloud"), (PUBLISHED, "Stokes")):
        error_lines(left, numbers(found, method=method, tracks=tracks), method)
    cfd = numbers(rows, tracks="CFD series", estimate="single")
    for method in (VOID, PUBLISHED):
        here = sorted(numbers(cfd, method=method), key=lambda r: float(r["value"]))
        if here:
            x = [0.36 * float(r["value"]) for r in here]  # the demo after its 10 % drop-out, per mm3
            left.plot(x, [100 * value(r, "mean_error") for r in here], "-.", color=COLOUR[method], marker="^", ms=7, mfc="none", lw=1, label=f"{method}: mean error, CFD sphere")
            chi2_line(right, [{**r, "value": v} for r, v in zip(here, x)], method, linestyle="-.", marker="^", ms=7, mfc="none", lw=1)
    n = np.array([0.05, 0.8])
    left.plot(n, 100 / (n * np.pi * 5.555**2) / 11.11, color="0.5", lw=1)
    left.annotate("1/(n $\\pi$ R$^2$): the scale of\nwhat one snapshot can tell", (0.4, 100 / (0.4 * np.pi * 5.555**2) / 11.11), textcoords="offset points", xytext=(-8, -6),
                  fontsize=8, color="0.35", ha="right", va="top")
    for ax in (left, right):
        ax.set_xscale("log")
        ax.set_xticks([0.05, 0.1, 0.2, 0.4, 0.8])
    left.set_yscale("log")
    finish(left, "tracers per mm$^3$", "error of the centre [% of d]", "xy")
    chi2_line(right, numbers(found, tracks="cloud"), VOID)
    chi2_line(right, numbers(found, tracks="Stokes", method=PUBLISHED), PUBLISHED)
    chi2_axis(right, "tracers per mm$^3$", "xy")
    right.text(0.06, 1.04, "as stated", fontsize=8, color="#00664b", va="bottom")
    right.text(0.06, 2.1, "errors larger than stated", fontsize=8, color="0.3", va="bottom")
    right.text(0.06, 0.48, "errors smaller than stated", fontsize=8, color="0.3", va="top")
    figure.suptitle("One snapshot, against the seeding density (d = 11.11 mm; CFD sphere: 9.53 mm)", fontsize=11)
    legend_below(figure, left, 4)
    figure.tight_layout(rect=(0, 0.09, 1, 1))
    return figure


def conditions_plot(rows):
    panels = [("noise", "position noise [$\\mu$m]"), ("ghosts", "ghosts in the sphere [%]"), ("wake depth", "missing in the wake [%]"),
              ("wake width", "radius of a 95 % wake [R]"), ("edge", "centre inside a face by [R]"), ("light sheet", "off the sheet's middle [mm]")]
    figure, axes = plt.subplots(2, len(panels), figsize=(16, 6.4), sharex="col", sharey="row")
    for column, (study, text) in zip(axes.T, panels):
        found = numbers(rows, study=study)
        for method, tracks in ((VOID, "cloud"), (PUBLISHED, "Stokes")):
            here = numbers(found, method=method, tracks=tracks)
            error_lines(column[0], here, method)
            chi2_line(column[1], here, method)
        column[0].set_yscale("log")
        finish(column[0], "", "error of the centre [% of d]")
        chi2_axis(column[1], text)
    for ax in axes[:, 1:].flat:
        ax.set_ylabel("")
    for ax, y, text in ((axes[1, 0], 2.06, "errors larger than stated"), (axes[1, 0], 1.03, "as stated"), (axes[1, 0], 0.4, "errors smaller than stated")):
        ax.text(0.03, y, text, fontsize=8, color="0.3", transform=ax.get_yaxis_transform())
    figure.suptitle("One snapshot at 0.4 tracers per mm$^3$, d = 11.11 mm; void likelihood: random clouds, published cost: Stokes flow", fontsize=11)
    legend_below(figure, axes[0, 0], 6)
    figure.tight_layout(rect=(0, 0.05, 1, 1))
    return figure


def coverage_plot(rows):
    found = clouds(rows)[::-1]
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 0.25 * len(found) + 1.6), sharey=True)
    y = np.arange(len(found))
    chi2 = np.array([value(r, "chi2_per_dof") for r in found])
    band(left, "v")
    outside = (chi2 < CHI2[0]) | (chi2 > CHI2[1])
    left.scatter(chi2[~outside], y[~outside], color=COLOUR[VOID], zorder=3)
    left.scatter(chi2[outside], y[outside], color="#d55e00", marker="X", s=60, zorder=3)
    left.set_xscale("log")
    left.set_xlim(min(0.22, np.nanmin(chi2) * 0.9), max(4, np.nanmax(chi2) * 1.1))
    left.set_xticks([0.5, 1, 2, 5] if np.nanmax(chi2) > 4 else [0.5, 1, 2])
    for x, text, side in ((CHI2[0], "errors smaller\nthan stated", "right"), (CHI2[1], "errors larger\nthan stated", "left")):
        left.text(x * (0.97 if side == "right" else 1.03), len(found) - 0.4, text, fontsize=8, color="0.3", ha=side, va="center")
    finish(left, "chi$^2$ of the error per degree of freedom [-]", "", "x")
    left.set_yticks(y, [label(r) for r in found], fontsize=8)
    for share, name, colour in ((68, "within68", "#e69f00"), (95, "within95", "#56b4e9")):
        right.axvline(share, color=colour, lw=1.2)
        right.text(share, len(found) - 0.2, f"{share} %", color=colour, fontsize=9, ha="center", va="bottom")
        right.errorbar([100 * value(r, name) for r in found], y, fmt="o", color=colour, ms=5, lw=1,
                       xerr=[100 * np.sqrt(0.01 * share * (1 - 0.01 * share) / max(int(r["found"]), 1)) for r in found])
    finish(right, "true centres in the stated ellipsoid [%]; bars: chance", "", "")
    left.set_ylim(-0.8, len(found) + 0.6)
    figure.suptitle("Is the stated uncertainty true? Void likelihood, one snapshot", fontsize=11)
    figure.tight_layout()
    return figure


def series_plot(rows):
    found = [r for r in rows if r["study"] in ("series", "part of the tracks")]
    cases = list(dict.fromkeys((r["tracks"], r["case"], r["method"]) for r in found))[::-1]
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 0.36 * len(cases) + 1.8), sharey=True)
    looks = {"single": ("o", 0.15, "one snapshot", left), "smoothed": ("D", -0.15, "smoothed", left), "velocity": ("o", 0, "velocity of the smoothed path", right)}
    for y, (tracks, case, method) in enumerate(cases):
        for estimate, (marker, shift, name, ax) in looks.items():
            r = numbers(found, tracks=tracks, case=case, method=method, estimate=estimate)[0]
            if r["mean_error"] != "":
                ax.plot([100 * value(r, c) for c in ("mean_error", "largest_error")], [y + shift] * 2, "-", color=COLOUR[method], lw=1)
                ax.plot(100 * value(r, "mean_error"), y + shift, marker, color=COLOUR[method], mfc="white" if estimate == "smoothed" else None, ms=6)
    left.set_yticks(range(len(cases)), [f"{tracks.split()[0]}: {case}" + (" (published cost)" if method == PUBLISHED else "") for tracks, case, method in cases], fontsize=8)
    for marker, shift, name, ax in looks.values():
        ax.plot([], [], marker, color="0.3", mfc="white" if name == "smoothed" else "0.3", label=f"{name}: mean, line to the largest")
    for method in COLOUR:
        left.plot([], [], "-", color=COLOUR[method], lw=3, label=method)
    for ax, text in ((left, "error of the centre [% of d]"), (right, "error of the velocity [% of the speed]")):
        ax.set_xscale("log")
        finish(ax, text, "", "x")
    figure.suptitle("Series of snapshots: 40 (Stokes flow, 5 um noise, 10 % drop-out unless said otherwise) or the demo's 16 (CFD)", fontsize=11)
    handles = [sum((ax.get_legend_handles_labels()[i] for ax in (left, right)), []) for i in (0, 1)]
    figure.legend(*handles, loc="lower center", ncols=3, fontsize=8)
    figure.tight_layout(rect=(0, 0.08, 1, 1))
    return figure


def stated_plot(rows):
    figure, ax = plt.subplots(figsize=(9, 4.6))
    found = numbers(rows, study="diameter")
    bars = [("published cost, paper: stated", "#999999", None), ("published cost here: stated", COLOUR[PUBLISHED], (PUBLISHED, "Stokes", "stated")),
            ("published cost here: true error", "#f5b58a", (PUBLISHED, "Stokes", "error")), ("void likelihood: stated", COLOUR[VOID], (VOID, "cloud", "stated")),
            ("void likelihood: true error", "#8cc3e6", (VOID, "cloud", "error"))]
    for i, (name, colour, which) in enumerate(bars):
        for j, d in enumerate(PAPER):
            if which:
                here = numbers(numbers(found, method=which[0], tracks=which[1]), value=d)
                columns = ("stated_mean", "stated_largest") if which[2] == "stated" else ("mean_error", "largest_error")
                mean, largest = (100 * value(here[0], c) for c in columns) if here else (np.nan, np.nan)
            else:
                mean, largest = PAPER[d]
            x = j + (i - 2) * 0.17
            ax.bar(x, mean, 0.15, color=colour, label=name if j == 0 else None)
            ax.plot([x, x], [mean, largest], color="black", lw=1)
            ax.plot(x, largest, "_", color="black", ms=8)
            if np.isfinite(largest):
                ax.text(x, largest * 1.08, f"{mean:.2g}", ha="center", fontsize=8)
    ax.set_yscale("log")
    ax.set_xticks(range(len(PAPER)), [f"d = {d:g} mm" for d in PAPER])
    finish(ax, "", "% of d; bar and number: mean, tick: largest")
    ax.set_ylim(top=ax.get_ylim()[1] * 2)
    ax.legend(fontsize=8, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.08))
    ax.set_title("Uncertainty of a single snapshot at 0.4 tracers per mm$^3$: stated and true", fontsize=11)
    figure.tight_layout()
    return figure


def grid_plot(rows):
    flows = unique(grid_rows(rows), "tracks")
    figure, axes = plt.subplots(1, len(flows), figsize=(5.5 * len(flows), 4.2), sharey=True, squeeze=False)
    for ax, tracks in zip(axes[0], flows):
        found = numbers(grid_rows(rows), tracks=tracks)
        x = [1e3 * value(r, "grid_spacing_m") for r in found]
        for column, line, name in (("mean_error", "-", "mean error"), ("largest_error", ":", "largest error"), ("stated_mean", "--", "stated sigma")):
            y = [100 * value(r, column) for r in found]
            ax.plot(x, y, line, color=COLOUR[PUBLISHED], marker="s", ms=5)
            ax.annotate(name, (x[-1], y[-1]), textcoords="offset points", xytext=(6, 0), fontsize=9, va="center", color=COLOUR[PUBLISHED])
        ax.set_yscale("log")
        ax.set_xlim(right=max(x) * 1.3)
        ax.set_title({"Stokes": "Stokes flow, d = 11.11 mm", "CFD series": "CFD, d = 9.53 mm"}[tracks], fontsize=10)
        finish(ax, "grid spacing of the flow [mm]", "error of the centre [% of d]")
    figure.suptitle("Published cost against the grid spacing", fontsize=11)
    figure.tight_layout()
    return figure


MADE = {"single": (single_table, "seeding"), "both": (both_table, "seeding"), "series": (series_table, "series"), "none": (none_table, "no sphere"),
        "paper": (paper_table, "diameter"), "grid": (grid_table, "grid"), "weak": (weak_table, None)}
DRAWN = {"seeding.png": (seeding_plot, "seeding"), "conditions.png": (conditions_plot, "noise"), "coverage.png": (coverage_plot, "seeding"),
         "series.png": (series_plot, "series"), "stated.png": (stated_plot, "diameter"), "grid.png": (grid_plot, "grid")}


def write(folder, rows):
    """The plots that the rows suffice for, into `folder`; returns the tables."""
    studies = unique(rows, "study") + [None]
    for name, (draw, study) in DRAWN.items():
        if study in studies:
            figure = draw(rows)
            figure.savefig(os.path.join(folder, name), dpi=90)
            plt.close(figure)
    return {name: make(rows) for name, (make, study) in MADE.items() if study in studies}
