"""VIC# beside its peers, on the same tracks in the same run. Start it by `./rimflow bench vic`; --help lists the options.

Writes results.csv (one line per method, case and region), scaling.csv (one per grid and snapshot), the plots and the tables (tables.md) into
--out; with --page the tables go into Documentation/validation-vic.md, and plots and CSV beside its images.
"""
import argparse
import os
import sys
import time

sys.path[:0] = [os.path.dirname(os.path.abspath(__file__)), os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common")]

import cases
import methods
import page
import scaling
from tables import between_marks, fill, read_rows, write_rows

SOURCE = os.path.normpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", ".."))
SPACINGS = (2, 3, 4, 5, 6)            # particle spacing over grid spacing
NOISES = (0.0, 0.01, 0.02, 0.05)      # of the rms velocity; accelerations four times as much of theirs
USUAL_SPACING, USUAL_NOISE = 3, 0.02
TABLE_SEEDS = 2
COLUMNS = ["study", "flow", "particle_spacing_h", "noise", "seed", "particles", "method", "setting", "accelerations", "body", "region", "nodes",
           "velocity_error", "vorticity_error", "vorticity_order", "vorticity_error_order2", "acceleration_error", "divergence", "divergence_order4", "seconds"]

VIC, VIC_U, VIC_FREE = "VIC#", "VIC#, no accelerations", "VIC#, no Body"
LINEAR, LINEAR_WALL = "Delaunay linear (SciPy)", "Delaunay linear with wall points"
RBF, RBF_SMOOTHED = "RBF cubic, 50 neighbours (SciPy)", "RBF, smoothed (SciPy)"
GAUSSIAN, SHEPARD, VTK_GAUSSIAN, VTK_LINEAR = "Gaussian weighting", "Shepard (VTK)", "Gaussian kernel (VTK)", "Delaunay linear (VTK)"


def contenders(case, table=False):
    """Method name -> (function, uses accelerations, knows the body)."""
    has_body = case.body is not None
    found = {VIC: (lambda c: methods.vic_sharp(c, True, has_body), 1, has_body), VIC_U: (lambda c: methods.vic_sharp(c, False, has_body), 0, has_body)}
    if has_body:
        found[VIC_FREE] = (lambda c: methods.vic_sharp(c, True, False), 1, False)
        found[LINEAR_WALL] = (lambda c: methods.delaunay(c, wall=True), 1, True)
    found.update({LINEAR: (methods.delaunay, 1, False), RBF: (methods.rbf, 1, False),
                  RBF_SMOOTHED: (methods.rbf_smoothed, 1, False), GAUSSIAN: (methods.gaussian, 1, False), SHEPARD: (methods.vtk_shepard, 1, False)})
    if table:
        found.update({VTK_GAUSSIAN: (methods.vtk_gaussian, 1, False), VTK_LINEAR: (methods.vtk_delaunay, 1, False)})
    return found


def judge(study, case, ratio, noise, seed, table=False):
    """The rows of one case. A node where any method has no value is left out for all."""
    results, finite = {}, case.chosen
    everyone = contenders(case, table)
    for name, (method, _, _) in everyone.items():
        results[name] = case.prepare(method(case))
        finite = finite & results[name].finite
    rows = []
    for region, nodes in case.regions().items():
        nodes = nodes & finite
        if nodes.sum() < 50:
            continue
        for name, result in results.items():
            e = case.errors(result, nodes)
            rows.append(dict(zip(COLUMNS, [study, case.name, f"{ratio:.3g}", f"{noise:g}", seed, len(case.x), name, result.setting,
                                           everyone[name][1], int(everyone[name][2]), region, int(nodes.sum())]
                                 + [f"{e[k]:.4f}" for k in ("velocity", "vorticity")] + [e["order"]]
                                 + [f"{e[k]:.4f}" for k in ("vorticity_order2", "acceleration", "divergence", "divergence_order4")] + [f"{result.seconds:.2f}"])))
    return rows


def sweep_case(flow, ratio, noise, seed, sphere, cells):
    if flow == "random":
        return cases.random_case(round((cells / ratio) ** 3), noise, seed, kmax=10, cells=cells)
    if flow == "cfd":
        return sphere.case(ratio, seed)
    return cases.analytic_case(flow, ratio, noise, seed)


def studies(arguments):
    """(study, flow, function that makes the case, particle spacing over h, noise, seed), in the order of the run."""
    plan, seed = [], arguments.seed
    for s in range(seed, seed + (1 if arguments.quick else TABLE_SEEDS)):
        for noise in (0.0, 0.05):
            plan.append(("peers", "random", lambda s=s, noise=noise: cases.random_case(10000, noise, s), None, noise, s))
    if arguments.quick:
        return plan
    done = set()
    for flow in page.FLOWS:
        if flow == "cfd":
            continue
        points = [(r, USUAL_NOISE, "spacing") for r in SPACINGS] + [(USUAL_SPACING, n, "noise") for n in NOISES]
        for ratio, noise, study in points:
            if (flow, ratio, noise) not in done:
                done.add((flow, ratio, noise))
                plan.append((study, flow, lambda f=flow, r=ratio, n=noise: sweep_case(f, r, n, seed, None, cases.CELLS), ratio, noise, seed))
    sphere = []

    def cfd(ratio):
        if not sphere:
            sphere.append(cases.SphereTracks(arguments.tracks, arguments.truth, arguments.diameter, arguments.velocity, arguments.viscosity))
        return sphere[0].case(ratio, seed)

    for ratio in (None,) + SPACINGS[1:]:
        plan.append(("spacing", "cfd", lambda r=ratio: cfd(r), ratio, float("nan"), seed))
    return [p for p in plan if not arguments.flows or p[1] in arguments.flows]


def parse(argv):
    demo = os.path.join(SOURCE, "Examples", "demo", "sphere.dat.gz")
    p = argparse.ArgumentParser(prog="rimflow bench vic", description="VIC# beside its peers, on the same tracks.",
                                formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    p.add_argument("--out", default=os.path.join(os.environ.get("RIMFLOW_BUILD_DIR", os.path.join(SOURCE, "build")), "vic-peers"), help="folder for CSV, tables and plots")
    p.add_argument("--page", action="store_true", help="bring Documentation/validation-vic.md, its plots and its CSV up to date")
    p.add_argument("--quick", action="store_true", help="only the table of the random flow, one seed")
    p.add_argument("--redraw", action="store_true", help="tables and plots from the results.csv and scaling.csv that are there")
    p.add_argument("--flows", nargs="+", choices=page.FLOWS, help="only these flows")
    p.add_argument("--scaling", action="store_true", help="only VIC#'s time and memory against the number of nodes")
    p.add_argument("--largest", type=int, default=max(scaling.SIZES), help="nodes per axis of the largest grid there; 256 take 6 GB")
    p.add_argument("--seed", type=int, default=1, help="of the particles, the noise and the random flow")
    g = p.add_argument_group("the CFD sphere", "other tracks with a truth on a grid: an .npz file with x y z (mm), u v w (m/s), ax ay az (m/s2), centre_mm, t_s, arrays indexed [x, y, z]")
    g.add_argument("--tracks", default=demo, help="a track file that STBTrackReader reads")
    g.add_argument("--truth", default=os.path.join(SOURCE, "Testing", "Data", "sphere", "truth.npz"))
    g.add_argument("--diameter", type=float, default=9.53e-3, help="m")
    g.add_argument("--velocity", type=float, nargs=3, default=[-0.018360375, 0.246922075, 0.034530825], help="of the sphere, m/s")
    g.add_argument("--viscosity", type=float, default=2.3825e-5, help="m2/s")
    arguments = p.parse_args(argv)
    if arguments.page and (arguments.quick or arguments.flows):
        p.error("--page needs all flows: leave out --quick and --flows")
    if arguments.quick + bool(arguments.flows) + arguments.scaling > 1:
        p.error("--quick (the table of the random flow), --flows and --scaling are parts of the whole: choose one")
    if arguments.largest < min(scaling.SIZES):
        p.error(f"--largest {arguments.largest} leaves no grid: the smallest is {min(scaling.SIZES)}")
    return arguments


def compare(plan):
    """The rows of results.csv."""
    start, rows = time.perf_counter(), []
    for i, (study, flow, make, ratio, noise, seed) in enumerate(plan):
        case = make()
        ratio = case.r / case.nodes.spacing if ratio is None else ratio
        found = judge(study, case, ratio, noise, seed, table=study == "peers")
        rows += found
        best = [r for r in found if r["method"] == VIC][-1]
        linear = [r for r in found if r["method"] == LINEAR][-1]
        print(f"[{i + 1}/{len(plan)}, {time.perf_counter() - start:.0f} s] {study} {flow} r/h {ratio:.3g} noise {noise:g}: velocity {best['velocity_error']} "
              f"(linear {linear['velocity_error']}), acceleration {best['acceleration_error']} ({linear['acceleration_error']})", flush=True)
    return rows


def main(argv=None):
    arguments = parse(sys.argv[1:] if argv is None else argv)
    out = os.path.join(SOURCE, "Documentation", "images", "validation-vic") if arguments.page else arguments.out
    os.makedirs(out, exist_ok=True)
    peers, growth = (os.path.join(out, name) for name in ("results.csv", "scaling.csv"))
    if not arguments.redraw:
        if not arguments.scaling:
            write_rows(peers, COLUMNS, compare(studies(arguments)))
        if not (arguments.quick or arguments.flows):
            write_rows(growth, scaling.COLUMNS, scaling.run(arguments.seed, arguments.largest))
    tables = page.write(out, read_rows(peers), read_rows(growth))
    if arguments.page:
        fill(os.path.join(SOURCE, "Documentation", "validation-vic.md"), tables)
    else:
        with open(os.path.join(out, "tables.md"), "w", encoding="utf-8") as f:
            f.write(between_marks(tables))
    print(tables["peers"] if "peers" in tables else "", f"\nresults: {out}")


if __name__ == "__main__":
    main()
