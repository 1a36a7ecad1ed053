"""Tables (Markdown) and plots (PNG) from the rows of results.csv."""
import os

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import LogLocator

from tables import markdown, mean, numbers, unique

FLOWS = {"random": "random solenoidal", "abc": "ABC", "taylor-green": "Taylor-Green", "stokes": "Stokes sphere", "cfd": "CFD sphere"}
QUANTITIES = ("velocity", "vorticity", "acceleration")
OURS = "#0072b2"
# Okabe and Ito's colours, which stay apart for the colour-blind; each method has its own marker besides.
LOOK = {"VIC#": (OURS, "o", "-"), "VIC#, no accelerations": (OURS, "s", "--"), "VIC#, no Body": ("black", "x", ":"),
        "RBF cubic, 50 neighbours (SciPy)": ("#009e73", "^", "-"), "RBF, smoothed (SciPy)": ("#56b4e9", ">", "-"), "Delaunay linear (SciPy)": ("#d55e00", "v", "-"),
        "Delaunay linear with wall points": ("#d55e00", "P", ":"), "Gaussian weighting": ("#cc79a7", "D", "-"), "Shepard (VTK)": ("#e69f00", "<", "-")}


def ratio_text(value):
    return "-" if np.isnan(value) else f"{value:.3f}"


def errors_text(rows):
    return " / ".join(ratio_text(mean(rows, f"{q}_error")) for q in QUANTITIES)


def peers_table(rows):
    rows = numbers(rows, study="peers")
    lines = []
    for method in unique(rows, "method"):
        clean, noisy = (numbers(rows, method=method, noise=n) for n in (0.0, 0.05))
        settings = [s for s in unique(clean + noisy, "setting") if s and "iterations" not in s]
        name = method + (f" ({' or '.join(settings)})" if settings else "")
        divergence = [mean(noisy, "divergence" + order) for order in ("", "_order4")]
        lines.append([name, errors_text(clean), errors_text(noisy), " / ".join(map(ratio_text, divergence)), f"{mean(clean + noisy, 'seconds'):.1f} s"])
    return markdown(["method", "clean", "5 % noise", "divergence (noisy), 2nd / 4th order", "time"], lines)


def against_best(found, methods):
    """VIC#'s error over that of the best other method, quantity by quantity."""
    others = [m for m in methods if not m.startswith("VIC#")]
    return " / ".join(f"{mean(numbers(found, method='VIC#'), q + '_error') / min(mean(numbers(found, method=m), q + '_error') for m in others):.2f}" for q in QUANTITIES)


def flows_table(rows):
    """All flows at the usual spacing and noise."""
    methods = [m for m in LOOK if m not in ("VIC#, no Body", "Delaunay linear with wall points")]
    lines = []
    for flow, title in FLOWS.items():
        found = [r for r in rows if r["study"] in ("spacing", "noise") and r["flow"] == flow and r["region"] in ("all", "far")
                 and float(r["particle_spacing_h"]) == 3 and (flow == "cfd" or float(r["noise"]) == 0.02)]
        if found:
            lines.append([title + (", far" if found[0]["region"] == "far" else "")] + [errors_text(numbers(found, method=m)) for m in methods]
                         + [against_best(found, methods)])
    return markdown(["flow"] + methods + ["VIC# over the best other"], lines)


def worse_table(rows):
    """Where another method is truer than VIC# with all that it can use: how often, and the worst such case."""
    lines = []
    for flow, title in FLOWS.items():
        for region in ("all", "near", "far"):
            found = numbers(rows, flow=flow, region=region)
            cases = list(dict.fromkeys((r["study"], r["particle_spacing_h"], r["noise"], r["seed"]) for r in found))
            for quantity in QUANTITIES:
                worse = []
                for case in cases:
                    here = [r for r in found if (r["study"], r["particle_spacing_h"], r["noise"], r["seed"]) == case]
                    ours = float(numbers(here, method="VIC#")[0][f"{quantity}_error"])
                    best = min((r for r in here if not r["method"].startswith("VIC#")), key=lambda r: float(r[f"{quantity}_error"]))
                    if ours > float(best[f"{quantity}_error"]):
                        worse.append((ours / float(best[f"{quantity}_error"]), ours, best))
                if worse:
                    _, ours, best = max(worse, key=lambda w: w[0])
                    noise = "" if best["noise"] == "nan" else f", {100 * float(best['noise']):g} % noise"
                    lines.append([title + ("" if region == "all" else f", {region}"), quantity, f"{len(worse)} of {len(cases)}",
                                  f"{best['particle_spacing_h']} h{noise}", f"{ours:.3f}", f"{float(best[f'{quantity}_error']):.3f}, {best['method']}"])
    return markdown(["flow", "error of", "cases", "worst case", "VIC# there", "best other there"], lines or [["none"] + 5 * [""]])


def wall_table(rows):
    methods = ("VIC#", "VIC#, no Body", "Delaunay linear (SciPy)", "Delaunay linear with wall points", "RBF cubic, 50 neighbours (SciPy)", "RBF, smoothed (SciPy)")
    lines = []
    for flow in ("stokes", "cfd"):
        tight = [r for r in rows if r["flow"] == flow and r["study"] == "spacing"]
        for ratio in sorted({float(r["particle_spacing_h"]) for r in tight})[:2]:
            for region in ("near", "far"):
                found = numbers(tight, region=region, particle_spacing_h=ratio)
                if found:
                    lines.append([FLOWS[flow], f"{ratio:.3g} h", region] + [errors_text(numbers(found, method=m)) for m in methods]
                                 + [against_best(found, methods)])
    return markdown(["flow", "particle spacing", "nodes"] + list(methods) + ["VIC# over the best other"], lines)


def exponent(found, column, smallest=0):
    """p of the fit column = c nodes^p over the cubes of at least `smallest` nodes."""
    found = [r for r in found if r["case"] == "cube" and int(r["nodes"]) >= smallest]
    if len({r["nodes"] for r in found}) < 2:
        return np.nan
    return float(np.polyfit(*(np.log([float(r[c]) for r in found]) for c in ("nodes", column)), 1)[0])


def scaling_table(rows):
    lines = []
    for nodes in sorted({int(r["nodes"]) for r in rows}):
        found = [r for r in rows if int(r["nodes"]) == nodes]
        r, parts = found[0], [numbers(found, calibration=c) for c in (1, 0)]
        lines.append([f"{r['nx']} x {r['ny']} x {r['nz']}" + (" (published)" if r["case"] == "paper" else ""), f"{nodes:,}", f"{int(r['particles']):,}"]
                     + [f"{mean(of, 'seconds'):.1f} s ({mean(of, 'processor_seconds'):.1f} s)" if of else "-" for of in parts]
                     + [", ".join(x["iterations"] for x in found), f"{max(float(x['peak_MB']) for x in found):.0f} MB", f"{mean(found, 'velocity_error'):.4f}"])
    for start, name in ((0, "exponent p of time = c nodes^p, all cubes"), (64**3, "the same, from 64 x 64 x 64 on")):
        lines.append([name, "", ""] + [f"{exponent(of, 'seconds', start):.2f} ({exponent(of, 'processor_seconds', start):.2f})"
                                       for of in (numbers(rows, calibration=1), numbers(rows, calibration=0))] + ["", "", ""])
    return markdown(["grid", "nodes", "particles", "first snapshot: wall (processor) time", "each further", "iterations", "peak memory", "velocity error"], lines)


def scaling_plot(rows):
    """Processor time, which other work on the machine does not change, and memory, over the number of nodes."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 5))
    cubes, paper = ([r for r in rows if r["case"] == c] for c in ("cube", "paper"))
    sizes = sorted({int(r["nodes"]) for r in cubes})
    for calibration, name, marker, line in ((1, "first snapshot, with calibration", "o", "-"), (0, "each further snapshot", "s", "--")):
        found = numbers(cubes, calibration=calibration)
        times = [mean([r for r in found if int(r["nodes"]) == n], "processor_seconds") for n in sizes]
        left.loglog(sizes, times, line, color=OURS, marker=marker, lw=2, label=f"{name}: fit ~ nodes^{exponent(found, 'processor_seconds'):.2f}")
        at = numbers(paper, calibration=calibration)
        if at:
            left.loglog(int(at[0]["nodes"]), mean(at, "processor_seconds"), color="#d55e00", marker=marker, ms=9, ls="none", mfc="none", mew=2, zorder=4,
                        label="160 x 109 x 36 nodes, 90,000 particles" + (", first" if calibration else ", further"))
    left.loglog(sizes, [0.5 * times[0] * (n / sizes[0]) ** 1.2 for n in sizes], ":", color="black", label="slope of nodes^1.2")
    left.set_ylabel("processor time per snapshot, all threads [s]")
    right.loglog(sizes, [max(float(r["peak_MB"]) for r in cubes if int(r["nodes"]) == n) for n in sizes], "-", color=OURS, marker="o", lw=2, label="VIC#")
    if paper:
        right.loglog(int(paper[0]["nodes"]), max(float(r["peak_MB"]) for r in paper), color="#d55e00", marker="o", ms=9, ls="none", mfc="none", mew=2,
                     label="160 x 109 x 36 nodes, 90,000 particles")
    right.axhline(min(float(r["start_MB"]) for r in rows), color="0.4", ls=":", label="ParaView's Python and the tracks alone")
    right.set_ylabel("peak memory of the whole process [MB]")
    for ax in (left, right):
        ax.legend(fontsize=8, loc="upper left")
        ax.set_ylim(top=ax.get_ylim()[1] * (10 if ax is left else 3))  # room for the legend
        ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        ax.yaxis.set_major_formatter(plt.FuncFormatter(lambda v, _: f"{v:g}"))
        ax.yaxis.set_minor_formatter(plt.NullFormatter())
        ax.set_xticks(sizes, [f"{round(n ** (1 / 3))}$^3$" for n in sizes])
        ax.xaxis.set_minor_formatter(plt.NullFormatter())
        ax.tick_params(which="minor", length=0)
        ax.set_xlabel("nodes [-]")
        ax.grid(alpha=0.3)
    figure.suptitle("VIC# on larger grids: particles 2 h apart, random solenoidal flow, 2 % noise", fontsize=11)
    figure.tight_layout()
    return figure


def tables(rows):
    made = {"peers": (peers_table, ("peers",)), "flows": (flows_table, ("spacing",)), "worse": (worse_table, ("spacing",)), "wall": (wall_table, ("spacing",))}
    return {name: make(rows) for name, (make, studies) in made.items() if any(r["study"] in studies for r in rows)}


def panels(rows, flows, methods, across, label, regions, title, ticks=None):
    """Rows: velocity, vorticity, acceleration; columns: flows. `across(rows)` gives the abscissa of a row."""
    figure, axes = plt.subplots(3, len(flows), figsize=(max(2.6 * len(flows) + 1, 8), 9), sharex="col", sharey="row", squeeze=False)
    handles = {}
    for column, flow in enumerate(flows):
        for row, quantity in enumerate(QUANTITIES):
            ax = axes[row, column]
            for method in methods:
                found = [r for r in rows if r["flow"] == flow and r["method"] == method and r["region"] in regions]
                if not found:
                    continue
                found.sort(key=across)
                colour, marker, line = LOOK[method]
                ours = method.startswith("VIC#")
                handles[method], = ax.plot([across(r) for r in found], [float(r[f"{quantity}_error"]) for r in found], line, color=colour, marker=marker,
                                           lw=2 if ours else 1.2, ms=5, zorder=4 if colour == "black" else 3 if ours else 2, label=method)
            ax.set_yscale("log")
            ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            ax.yaxis.set_major_formatter(plt.FuncFormatter(lambda v, _: f"{v:g}"))
            ax.yaxis.set_minor_formatter(plt.NullFormatter())
            ax.grid(alpha=0.3, which="both")
            if ticks:
                ax.set_xticks(ticks)
            if flow == "stokes" and quantity == "acceleration":
                ax.set_title("without the pressure that\nNavier-Stokes asks for", fontsize=8, color="0.3", y=1, pad=-24)
                ax.set_ylim(top=max(ax.get_ylim()[1], 8))
            if column == 0:
                ax.set_ylabel(f"{quantity}: rms error / rms [-]")
        axes[0, column].set_title(FLOWS[flow] + (f", {regions[0]}" if flow in ("stokes", "cfd") else ""), fontsize=10)
        axes[2, column].set_xlabel(label)
    figure.suptitle(title, fontsize=11)
    figure.legend(handles.values(), handles.keys(), loc="lower center", ncols=3, fontsize=9)
    figure.tight_layout(rect=(0, 0.07, 1, 1))  # the legend stands below
    return figure


def spacing_of(row):
    return float(row["particle_spacing_h"])


def noise_of(row):
    return 100 * float(row["noise"])


def plots(rows):
    away = [m for m in LOOK if m not in ("VIC#, no Body", "Delaunay linear with wall points")]
    by_spacing = [r for r in rows if r["study"] == "spacing"]
    by_noise = [r for r in rows if r["study"] in ("spacing", "noise") and float(r["particle_spacing_h"]) == 3 and r["flow"] != "cfd"]
    if by_spacing:
        yield "spacing.png", panels(by_spacing, [f for f in FLOWS if numbers(by_spacing, flow=f)], away, spacing_of, "particle spacing / grid spacing [-]",
                                    ("far", "all"), "Error against particle spacing; 2 % noise on velocity, 8 % on acceleration (CFD: its own)")
        spheres = [f for f in ("stokes", "cfd") if numbers(by_spacing, flow=f)]
        if spheres:
            near = ["VIC#", "VIC#, no accelerations", "VIC#, no Body", "RBF cubic, 50 neighbours (SciPy)", "RBF, smoothed (SciPy)", "Delaunay linear (SciPy)",
                    "Delaunay linear with wall points"]
            yield "wall.png", panels(by_spacing, spheres, near, spacing_of, "particle spacing / grid spacing [-]", ("near",), "Within 1.5 h of the wall")
    if by_noise:
        yield "noise.png", panels(by_noise, [f for f in FLOWS if numbers(by_noise, flow=f)], away, noise_of, "noise [% of rms velocity]",
                                  ("far", "all"), "Error against noise; particles 3 h apart, noise on acceleration 4 times that part", [0, 1, 2, 5])


def write(folder, rows, scaling):
    """The plots into `folder`; returns the tables. rows: of results.csv, scaling: of scaling.csv; either may be empty."""
    drawn, found = list(plots(rows)), tables(rows)
    if scaling:
        drawn.append(("scaling.png", scaling_plot(scaling)))
        found["scaling"] = scaling_table(scaling)
    for name, figure in drawn:
        figure.savefig(os.path.join(folder, name), dpi=90)
        plt.close(figure)
    return found
