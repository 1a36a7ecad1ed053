"""The locator against the truth. Start it by `./rimflow bench locator`; --help lists the options.

Writes results.csv (one line per case, method and estimate), the plots and the tables (tables.md) into --out; with --page the tables go into
Documentation/validation-locator.md, and plots and CSV beside its images.
"""
import argparse
import multiprocessing
import os
import sys
import time

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "common")]
os.environ["OMP_NUM_THREADS"] = "1"  # the cases share the cores; set before the filters are loaded

import page
import studies
from tables import between_marks, fill, read_rows, write_rows

QUICK = 20, 1  # snapshots per case of the void likelihood, of the published cost


def parse(argv):
    p = argparse.ArgumentParser(prog="rimflow bench locator", description="The locator's error and stated uncertainty, both methods, where the truth is known.",
                                formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    p.add_argument("--out", default=os.path.join(os.environ.get("RIMFLOW_BUILD_DIR", os.path.join(studies.SOURCE, "build")), "locator-study"), help="folder for CSV, tables and plots")
    p.add_argument("--page", action="store_true", help="bring Documentation/validation-locator.md, its plots and its CSV up to date")
    p.add_argument("--quick", action="store_true", help="few snapshots per case")
    p.add_argument("--redraw", action="store_true", help="tables and plots from the results.csv that is there")
    p.add_argument("--frames", type=int, default=200, help="single snapshots per case")
    p.add_argument("--slow-frames", type=int, default=4, help="the same for the published cost, which needs the flow on a grid; 0: leave it out")
    p.add_argument("--studies", nargs="+", metavar="STUDY", help="only these; the other rows of results.csv stay as they are")
    p.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    arguments = p.parse_args(argv)
    if arguments.quick and arguments.page:
        p.error("--page needs enough snapshots to judge by: leave out --quick")
    for name, least in (("frames", 1), ("slow_frames", 0), ("jobs", 1)):
        if getattr(arguments, name) < least:
            p.error(f"--{name.replace('_', '-')} must be at least {least}")
    if arguments.quick:
        arguments.frames, arguments.slow_frames = QUICK
    known = list(dict.fromkeys(c.study for c in studies.all_cases(1, 1)))
    unknown = set(arguments.studies or ()) - set(known)
    if unknown:
        p.error(f"there is no study {', '.join(sorted(unknown))}; there are: {', '.join(known)}")
    return arguments


SUBJECTS = []  # what the worker processes inherit: cases, each once


def work(job):
    k, arguments = job
    return job, studies.RUNS[SUBJECTS[k].tracks](SUBJECTS[k], *arguments)


def measure(cases, processes, keep):
    """Hands the rows of results.csv, in the order of the cases, to keep(rows) whenever a case is done: so a run that is stopped leaves what it has."""
    SUBJECTS[:] = dict.fromkeys(c.subject for c in cases)
    todo = studies.jobs(SUBJECTS)
    waiting = [sum(k == j for j, _ in todo) for k in range(len(SUBJECTS))]
    parts, start = {}, time.perf_counter()

    def rows(case):
        k = SUBJECTS.index(case.subject)
        return studies.rows(case, [r for job in sorted(j for j in parts if j[0] == k) for r in parts[job]])

    with multiprocessing.get_context("fork").Pool(processes) as pool:
        for done, (job, found) in enumerate(pool.imap_unordered(work, todo)):
            k, parts[job] = job[0], found
            waiting[k] -= 1
            if not waiting[k]:
                for r in rows(next(c for c in cases if c.subject == SUBJECTS[k])):
                    print(f"[{done + 1}/{len(todo)}, {time.perf_counter() - start:.0f} s] {r['study']}, {r['case']}, {r['tracks']}, {r['method']}, {r['estimate']}: "
                          f"found {r['found']} of {r['snapshots']}, wrong {r['wrong']}, extra {r['extra']}, error {r['mean_error']} (largest {r['largest_error']}), "
                          f"stated {r['stated_mean']}, chi2 {r['chi2_per_dof']}", flush=True)
                keep([r for case in cases if not waiting[SUBJECTS.index(case.subject)] for r in rows(case)])
        pool.close()
        pool.join()  # leaving `with` alone would kill the processes, and VTK prints a stack trace for each


def main(argv=None):
    arguments = parse(sys.argv[1:] if argv is None else argv)
    out = os.path.join(studies.SOURCE, "Documentation", "images", "validation-locator") if arguments.page else arguments.out
    os.makedirs(out, exist_ok=True)
    path = os.path.join(out, "results.csv")
    if not arguments.redraw:
        cases = [c for c in studies.all_cases(arguments.frames, arguments.slow_frames) if arguments.slow_frames or c.method == studies.VOID and c.tracks != "Stokes"]
        if arguments.studies:
            cases = [c for c in cases if c.study in arguments.studies]
        part = arguments.studies or not arguments.slow_frames
        kept = [r for r in read_rows(path) if part and (r["study"], r["tracks"], r["method"]) not in {(c.study, c.tracks, c.method) for c in cases}]
        order = list(dict.fromkeys(c.study for c in studies.all_cases(1, 1)))
        measure(cases, arguments.jobs, lambda found: write_rows(path, studies.COLUMNS, sorted(kept + found, key=lambda r: order.index(r["study"]))))
    tables = page.write(out, read_rows(path))
    if arguments.page:
        fill(os.path.join(studies.SOURCE, "Documentation", "validation-locator.md"), tables)
    else:
        with open(os.path.join(out, "tables.md"), "w", encoding="utf-8") as f:
            f.write(between_marks(tables))
    print(f"results: {out}")


if __name__ == "__main__":
    main()
