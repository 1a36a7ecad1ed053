"""The report's part on forces: plots over time, the pressure on the surface, and what the reader can conclude."""
import html

import matplotlib.pyplot as plt
import numpy as np

from rimflow import forces

SURFACE, VOLUME, MOTION, SPEED = "#33609e", "#c1433c", "#3b7d3c", "#333333"
LETTERS = "ABCD"  # of the instants


def _mark_instants(axes, f):
    """Dashed lines through all panels with the instants' letters on top."""
    for letter, row in zip(LETTERS, f.instants):
        for ax in axes:
            ax.axvline(f["time_s"][row], color="0.6", lw=0.9, ls="--", zorder=0)
        axes[0].annotate(letter, (f["time_s"][row], 1), xycoords=("data", "axes fraction"), xytext=(0, 3), textcoords="offset points",
                         ha="center", color="0.3")


def series(ax, time, values, colour, label, sigma=None, scale=1.0):
    """A line over time, interrupted where nothing is known, with a band of two standard deviations."""
    if not np.isfinite(values).any():
        return
    ax.plot(time, scale * values, ".-" if len(time) < 80 else "-", color=colour, label=label, ms=5)
    if sigma is not None and np.isfinite(sigma).any():
        ax.fill_between(time, scale * (values - 2 * sigma), scale * (values + 2 * sigma), color=colour, alpha=0.2, lw=0)


def _finish(axes):
    axes[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.06), ncols=4, fontsize=9, frameon=False)
    for ax in axes:
        ax.grid(alpha=0.3)
    axes[-1].set_xlabel("time [s]")
    axes[-1].ticklabel_format(axis="x", useOffset=False)


def plot_forces(t, f, run):
    """Drag, lift and speed over time."""
    figure, axes = plt.subplots(3, 1, figsize=(10, 10), sharex=True, layout="constrained")
    colours = (SURFACE, VOLUME, MOTION)
    scale, unit = (1e3, "mN") if np.nanmax(np.abs(f["drag_N"])) < 1 else (1.0, "N")
    for e, colour in zip(forces.estimates(f), colours):
        series(axes[0], t.time, f.drag(e.force), colour, e.name, e.drag_sigma, scale)
        series(axes[1], t.time, np.linalg.norm(f.lift(e.force), axis=1), colour, e.name, e.lift_sigma, scale)
    series(axes[0], t.time, f.drag(f.vector("Fp")), "#7fa3d1", "pressure alone", None, scale)
    axes[0].axhline(0, color="0.5", lw=0.8, ls=":")
    axes[0].set_ylabel(f"drag [{unit}]")
    axes[1].set_ylabel(f"lift, magnitude [{unit}]")
    axes[1].set_ylim(bottom=0)
    speed = np.linalg.norm(t.velocity, axis=1)
    sigma = np.sqrt(np.sum((t.velocity_sigma * f.motion)**2, axis=1))
    series(axes[2], t.time, speed, SPEED, "", sigma)
    axes[2].set_ylabel("speed of the sphere [m/s]")
    _mark_instants(axes, f)
    _finish(axes)
    return figure


def plot_coefficients(t, f, run):
    """Cd and Cl over time beside the standard drag curve."""
    figure, axes = plt.subplots(2, 1, figsize=(10, 7.5), sharex=True, layout="constrained")
    for e, colour in zip(forces.estimates(f), (SURFACE, VOLUME, MOTION)):
        cd, cl, sigma = forces.coefficients(f, e)
        series(axes[0], t.time, cd, colour, e.name, sigma)
        series(axes[1], t.time, cl, colour, e.name, e.lift_sigma / f.reference)
    reynolds = np.linalg.norm(t.velocity, axis=1) * t.diameter / run["settings"]["viscosity_m2_s"]
    series(axes[0], t.time, forces.standard_drag(reynolds), "0.5", "fixed sphere at this Reynolds number")
    axes[0].set_ylabel("drag coefficient Cd")
    axes[1].set_ylabel("lift coefficient Cl")
    axes[1].set_ylim(bottom=0)
    _mark_instants(axes, f)
    _finish(axes)
    return figure


def plot_surface_pressure(t, f, run):
    """The pressure coefficient from the front of the sphere to its rear."""
    figure, ax = plt.subplots(figsize=(9, 5.5), layout="constrained")
    edges = np.linspace(0, 180, 31)
    middle = 0.5 * (edges[1:] + edges[:-1])
    density = run["settings"]["density_kg_m3"]
    for letter, row, colour in zip(LETTERS, f.instants, plt.get_cmap("viridis")(np.linspace(0, 0.85, 4))):
        if row not in f.surfaces:
            continue  # its file could not be written
        points, pressure = f.surfaces[row]
        normal = (points - t.centre[row]) / np.linalg.norm(points - t.centre[row], axis=1)[:, None]
        angle = np.degrees(np.arccos(np.clip(normal @ f.motion[row], -1, 1)))
        cp = pressure / (0.5 * density * np.sum(t.velocity[row]**2))
        rings = [cp[(angle >= low) & (angle <= high)] for low, high in zip(edges[:-1], edges[1:])]
        mean, low, high = (np.array([g(r) if len(r) else np.nan for r in rings]) for g in (np.mean, np.min, np.max))
        ax.plot(middle, mean, color=colour, label=f"{letter}: {t.time[row]:.6g} s")
        ax.fill_between(middle, low, high, color=colour, alpha=0.12, lw=0)
    ax.axhline(0, color="0.5", lw=0.8, ls=":")
    ax.set(xlabel="angle from the front of the sphere (the direction of its motion) [degrees]", xlim=(0, 180),
           ylabel="pressure coefficient p / (rho V²/2)")
    ax.set_xticks(np.arange(0, 181, 30))
    ax.grid(alpha=0.3)
    if f.surfaces:
        ax.legend(fontsize=9, title="mean around the axis; bands: least to largest")
    return figure


METHODS = (("surface", "Surface: pressure and friction"), ("control_volume", "Control volume"), ("motion", "Motion and buoyancy (inertia check)"))


def section(run):
    """The part of index.html: a table of the coefficients, and what it says."""
    summary = run["forces"]
    if not summary:
        return ""
    number = lambda v: "not known" if v is None else f"{v:.3f}"
    rows = [f"<tr><td>{name}</td>" + "".join(f"<td>{number(summary[key][column])}</td>" for column in
            ("Cd_mean", "Cd_std", "Cd_step", "Cd_sigma", "Cl_mean", "Cl_std")) + f"<td>{1e3 * summary[key]['drag_mean_N']:.4g}</td></tr>"
            for key, name in METHODS if key in summary]
    sentences = "".join(f"<li>{html.escape(s)}</li>" for s in conclusions(run))
    notes = grouped(run["notes"])
    listed = "".join(f"<li>{html.escape(text)} ({snapshots})</li>" for text, snapshots in notes)
    return f"""<p>Of the fluid on the sphere, without buoyancy. Drag is the part against the motion, lift the magnitude of the rest; the coefficients are relative to &rho;V&sup2;/2 &middot; &pi;d&sup2;/4.</p>
<table class="numbers"><tr><th></th><th>Cd, mean</th><th>std. dev. over time</th><th>snapshot to snapshot</th><th>stated uncertainty</th><th>Cl, mean</th><th>std. dev. over time</th><th>drag, mean [mN]</th></tr>
{"".join(rows)}
</table>
<ul>{sentences}</ul>
{f"<p>Notes on the flow and the forces:</p><ul>{listed}</ul>" if notes else ""}
"""


def grouped(notes):
    """[(snapshot, text)] -> [(text, "3 snapshots: 1, 2, 7")], so that one sentence is not repeated for a thousand snapshots."""
    by_text = {}
    for snapshot, text in notes:
        by_text.setdefault(text, []).append(snapshot)
    few = lambda s: ", ".join(map(str, s[:8])) + (", ..." if len(s) > 8 else "")
    return [(text, f"{len(s)} snapshot{'s' if len(s) > 1 else ''}: {few(s)}") for text, s in by_text.items()]


def conclusions(run):
    """Sentences on how far the methods agree, whether the drag changes in time, and how it compares with a fixed sphere's."""
    summary = run["forces"]
    surface, volume, motion = (summary.get(key) for key, _ in METHODS)
    if not surface:
        return ["The force on the surface is known in no snapshot."]
    result = []
    cd, sigma = surface["Cd_mean"], surface["Cd_sigma"]
    if volume:
        apart = abs(volume["Cd_mean"] - cd)
        margin = 2 * np.hypot(sigma or surface["Cd_step"] or 0, volume["Cd_sigma"] or volume["Cd_step"] or 0)
        result.append(f"Surface and control volume differ by {100 * apart / abs(volume['Cd_mean']):.1f} % in their mean drag, "
                      + (f"within two standard deviations of that difference ({100 * margin / abs(volume['Cd_mean']):.0f} %)." if apart <= margin else
                         "more than two standard deviations. The surface depends on the layer next to the wall, which the grid may not resolve; "
                         "the control volume depends on it far less, but needs undisturbed data around the sphere. Take their difference as the uncertainty."))
    if motion:
        apart = abs(motion["Cd_mean"] - cd)
        result.append(f"The motion of the sphere with its buoyancy and weight demands Cd = {motion['Cd_mean']:.3f}, {100 * apart / abs(cd):.1f} % from "
                      "the surface's. It needs no flow field, but the right densities, and a sphere that moves freely.")
    if sigma and surface["snapshots"] > 2:
        ratio, slow = surface["Cd_std"] / sigma, surface["Cd_std"] > 1.5 * surface["Cd_step"]
        result.append(f"Over time Cd varies by {surface['Cd_std']:.3f} (one standard deviation), {ratio:.1f} times the stated uncertainty of one snapshot: "
                      + ("the drag changes over the recording." if slow and ratio >= 1.5 else
                         "it changes slowly, by less than what is uncertain. The change may be real, as part of that is alike in all snapshots, or the error of the sphere's velocity, which changes slowly, too." if slow else
                         "no change of the drag can be told from what is uncertain." if ratio < 1.5 else
                         "neighbouring snapshots scatter as much, so this is noise, and the stated uncertainty is too small."))
    if run["reynolds"]:
        result.append(f"A fixed sphere in steady flow at the mean Reynolds number, {run['reynolds']:.4g}, has Cd = "
                      f"{forces.standard_drag(run['reynolds']):.3f} (Brown & Lawler 2003).")
    if surface["Cl_mean"] and surface["Cl_noise"]:
        result.append(f"Noise alone makes a lift of Cl = {surface['Cl_noise']:.3f} on average, because a magnitude is never negative; "
                      f"found is {surface['Cl_mean']:.3f}.")
    return result


PAGES = (("forces.png", "Drag, lift and speed over time; the bands are two standard deviations wide to either side, the letters mark the instants "
          "whose pressure is shown", plot_forces),
         ("coefficients.png", "Drag and lift coefficient over time", plot_coefficients),
         ("surface-pressure.png", "Pressure on the sphere from its front to its rear; zero is the mean over the measured volume", plot_surface_pressure))
