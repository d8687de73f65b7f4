"""Many semidefinite fits of the 62 unknowns of the KR 270 campaign, and complete profiles: seconds and peak memory.

Run: python benchmarks/bench_profile.py [--fits 1000]

Every row is a process of its own. All fit the same compressed campaign to the same noisy right-hand sides, drawn around the identified
springs; a shortcut for fits that no cone touches is switched off, so every fit is a semidefinite program.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from typing import Any

from table import KR270, child, peak_mib, show, worker

# Fresh cvxpy problems are slow: this many are measured and the seconds scaled.
FRESH = 50
TASKS = ("direct", "fresh", "compiled", "parameters", "base", "curves")


def campaign() -> tuple[Any, Any]:
    """The solution of the KR 270 campaign and its observations."""
    from drake_stiffness.identification import identify
    from drake_stiffness.start import starting_model
    from drake_stiffness.task import read_task

    task = read_task(KR270 / "campaign.yaml")
    o = task.observations()
    return identify(starting_model(task.model, task.taking_part()), o), o


def right_hand_sides(problem: Any, fits: int) -> Any:
    """The compressed readings of so many campaigns with noise of their own, (fits, r)."""
    import numpy as np

    return problem.g + np.random.default_rng(0).standard_normal((fits, problem.g.size))


def direct(problem: Any, G: Any) -> list[float]:
    """Clarabel called directly."""
    import numpy as np

    from drake_stiffness.intervals.cone_program import ConeLeastSquares

    class Always(ConeLeastSquares):
        def feasible(self, x: Any) -> bool:
            return False

    program = Always(problem.F, problem.blocks, problem.lower, problem.upper)
    return [float(np.sum((problem.F @ program.solve(g) - g) ** 2)) for g in G]


def in_cvxpy(problem: Any, g: Any) -> Any:
    """The same program in cvxpy; g may be a parameter."""
    import cvxpy as cp

    x = cp.Variable(problem.F.shape[1])
    held = []
    for block in problem.blocks:
        if block.shape[0] == 1:
            held.append(x[int(block[0, 0])] >= 0)
        else:
            held.append(cp.bmat([[x[int(i)] for i in row] for row in block]) >> 0)
    return cp.Problem(cp.Minimize(cp.sum_squares(problem.F @ x - g)), held)


def fresh(problem: Any, G: Any) -> list[float]:
    """A new cvxpy problem for every right-hand side."""
    import cvxpy as cp

    return [float(in_cvxpy(problem, g).solve(solver=cp.CLARABEL)) for g in G]


def compiled(problem: Any, G: Any) -> list[float]:
    """One cvxpy problem, compiled once, the right-hand side a parameter."""
    import cvxpy as cp

    g = cp.Parameter(problem.g.size)
    whole = in_cvxpy(problem, g)
    values = []
    for one in G:
        g.value = one
        values.append(float(whole.solve(solver=cp.CLARABEL)))
    return values


def measure(task: str, fits: int) -> dict[str, Any]:
    """Seconds of one task, after everything it needs was imported and compiled once."""
    from drake_stiffness.intervals.profile import base_combinations, problem_of, profile_curves, profile_intervals

    solution, o = campaign()
    problem = problem_of(solution, o)
    if task in ("direct", "fresh", "compiled"):
        solve = {"direct": direct, "fresh": fresh, "compiled": compiled}[task]
        number = FRESH if task == "fresh" else fits
        G = right_hand_sides(problem, number)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            solve(problem, G[:1])
            start, cpu = time.perf_counter(), time.process_time()
            values = solve(problem, G)
        seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
        return {"seconds": seconds * fits / number, "cpu": cpu * fits / number, "number": number, "first": values[:20]}
    start, cpu = time.perf_counter(), time.process_time()
    if task == "curves":
        _, ends = profile_curves(solution, o, base_combinations(solution), processes=1)
        number = ends.size
    else:
        which = base_combinations(solution) if task == "base" else None
        number = 2 * len(profile_intervals(solution, o, which, processes=1))
    return {"seconds": time.perf_counter() - start, "cpu": time.process_time() - cpu, "number": number}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fits", type=int, default=1000)
    parser.add_argument("--worker", nargs=2, metavar=("TASK", "FITS"), help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.worker:
        task, fits = args.worker[0], int(args.worker[1])
        print(json.dumps(measure(task, fits) | {"peak_mib": peak_mib()}))
        return
    ended = {task: child(worker(__file__, task, str(args.fits)), limit_s=600.0) for task in TASKS}
    names = {
        "direct": f"{args.fits} fits, Clarabel directly (cone_program)",
        "fresh": f"{args.fits} fits, fresh cvxpy problems, compressed ({FRESH} measured, scaled)",
        "compiled": f"{args.fits} fits, one compiled cvxpy problem with a parameter",
        "parameters": "95 % intervals of all parameters, one process",
        "base": "95 % intervals of all base parameters, one process",
        "curves": "profiles of all base parameters over 20 levels, one process",
    }
    slow = ended["fresh"].result
    rows, notes = [], []
    for task, e in ended.items():
        if e.result is None:
            rows.append([names[task], e.why, "-", "-", "-", "-"])
            continue
        r = e.result
        faster = f"{slow['cpu'] / r['cpu']:.1f}" if slow and "first" in r else "-"
        programs = args.fits if "first" in r else r["number"]
        cells = [
            f"{r['seconds']:.2f}",
            f"{r['cpu']:.2f}",
            f"{1e3 * r['cpu'] / programs:.2f}",
            faster,
            f"{e.peak_mib:.0f}",
        ]
        rows.append([names[task], *cells])
    firsts = [e.result["first"] for e in ended.values() if e.result and "first" in e.result]
    if len(firsts) == 3:
        apart = max(abs(a - b) for other in firsts[1:] for a, b in zip(firsts[0], other, strict=True))
        notes.append(f"Chi-square of the first 20 fits agrees between the three ways to {apart:.1e}.")
    notes.append("CPU seconds count where other work shares the machine; ratios are of CPU seconds.")
    show(
        "Semidefinite fits and profiles of the KR 270 campaign (62 unknowns)",
        ("task", "seconds", "CPU s", "CPU ms per program", "times faster than fresh", "peak MiB"),
        rows,
        notes,
    )


if __name__ == "__main__":
    main()
