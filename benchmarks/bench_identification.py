"""Identification of 7 links x 21 + 6 joints of the KR 270 against the number of postures: where the seconds go.

Run: python benchmarks/bench_identification.py [--postures 50 500 5000]

Every figure is of a process of its own. The campaign is made in memory: random postures, each unloaded, with 2.5 kN down
and with 3.5 kN sideways, three reference points, 12 um noise; the truth is known. Beside the program's own identification
stands the one linear problem in it as others would solve it: all rows handed to cvxpy, the rows compressed by QR handed to
cvxpy, and plain least squares without any constraint.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
import warnings
from pathlib import Path
from typing import Any

from table import KR270, Stopwatch, child, peak_mib, show, timed, worker

SIGMA_M = 12e-6
TASKS = ("identify", "uncompressed", "compressed", "least squares")


def campaign(postures: int) -> tuple[Any, Any, Any]:
    """Start model (153 unknowns), observations, and the model they were made with."""
    import numpy as np

    from drake_stiffness.assembly import joint_spring, link_spring, make_model
    from drake_stiffness.campaign import Measurements, Noise
    from drake_stiffness.cell import read_cell
    from drake_stiffness.effects.effect import Cases
    from drake_stiffness.observation import observe
    from drake_stiffness.plant import build_arm
    from drake_stiffness.simulation import simulate_readings
    from drake_stiffness.tables import Table

    rng = np.random.default_rng(0)
    cell = read_cell(KR270 / "cell.yaml")
    arm = build_arm(cell)
    springs: list[Any] = [joint_spring(arm, joint) for joint in arm.joint_names]
    springs += [link_spring(arm, link, "symmetric", "x") for link in arm.link_names]
    values = []
    for spring in springs:
        if len(spring.parameters) == 1:
            values.append(np.array([rng.uniform(0.3e-6, 1.5e-6)]))
            continue
        half = rng.normal(size=(6, 6)) * 0.05
        compliance = np.diag(rng.uniform(0.01, 0.04, 6)) + half @ half.T
        values.append(spring.template.values(compliance * np.outer(spring.component_scales, spring.component_scales)))
    truth = make_model(cell, arm, springs, np.concatenate(values))
    q = rng.uniform(np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi), (postures, 6)).T
    wrench = np.zeros((6, 3 * postures))
    wrench[2, 1::3], wrench[0, 2::3] = -2500.0, 3500.0
    experiment, step = np.repeat(np.arange(postures), 3), np.tile(np.arange(3), postures)
    cases = Cases(q.repeat(3, axis=1), wrench, truth.load_point, experiment, step, np.full(3 * postures, np.nan))
    points = np.array(list(cell.reference_points_m))
    case, point = np.repeat(np.arange(3 * postures), points.size), np.tile(points, 3 * postures)
    p = simulate_readings(truth, cases, case, point).p
    p += SIGMA_M * rng.standard_normal(p.shape)
    measurements = Measurements(
        table=Table(Path("in memory"), (), [], []),
        cases=cases,
        experiments=tuple(f"E{i}" for i in range(postures)),
        case=case,
        row=np.arange(case.size),
        point=point,
        position=p.T,
        relative=False,
        orientation=np.full((case.size, 3), np.nan),
    )
    return make_model(cell, arm, springs), observe(measurements, True, Noise(position_sigma_mm=SIGMA_M * 1e3)), truth


def time_identify(postures: int, repeats: int) -> dict[str, Any]:
    """Seconds of `identification.identify` and of the statistics after it, split into stages."""
    import clarabel  # noqa: F401
    import cvxpy

    from drake_stiffness import identification, semidefinite
    from drake_stiffness import statistics as fit_statistics
    from drake_stiffness.identifiability import Identifiability

    model, observations, _ = campaign(postures)
    watch = Stopwatch()
    watch.watch(identification, "columns", "columns")
    watch.watch(identification, "analyse", "compression")
    watch.watch(Identifiability, "pseudo_inverse_seen", "compression")
    watch.watch(identification, "predicted", "equilibrium")
    watch.watch(semidefinite.Linearised, "semidefinite", "solver")
    solve, native = cvxpy.Problem.solve, {"seconds": 0.0, "calls": 0.0}

    def counted(problem: Any, *args: Any, **kwargs: Any) -> Any:
        native["calls"] += 1
        value = solve(problem, *args, **kwargs)
        native["seconds"] += problem.solver_stats.solve_time
        return value

    cvxpy.Problem.solve = counted
    rounds: list[dict[str, float]] = []
    for _ in range(repeats):
        watch.seconds.clear()
        native.update(seconds=0.0, calls=0.0)
        start, cpu = time.perf_counter(), time.process_time()
        solution = identification.identify(model, observations, "sdp")
        total, cpu = time.perf_counter() - start, time.process_time() - cpu
        with watch("statistics"):
            fit = fit_statistics.goodness(solution, observations)
            fit_statistics.statistics(solution, observations, fit)
        once = dict(watch.seconds)
        once["cpu"] = cpu
        once["total"] = total + once["statistics"]
        once["other"] = total - sum(once[name] for name in ("columns", "compression", "equilibrium", "solver"))
        once |= {"clarabel": native["seconds"], "solves": native["calls"], "iterations": float(solution.iterations)}
        rounds.append(once)
    middle = {name: statistics.median(r[name] for r in rounds) for name in rounds[0]}
    return middle | {"rank": solution.identifiability.rank, "chi2": fit.chi2_per_dof, "rows": observations.rows}


def time_linear(postures: int, task: str) -> dict[str, Any]:
    """Seconds of the linear problem around the truth, min |A x - b|^2 with every compliance positive semidefinite."""
    import clarabel  # noqa: F401
    import cvxpy as cp
    import numpy as np

    from drake_stiffness.observation import columns, measured, predicted

    model, observations, truth = campaign(postures)
    A = columns(observations, model)
    b = measured(observations) - predicted(observations, truth) + A @ (truth.x / truth.scales)
    if task == "least squares":
        return {"total": statistics.median(timed(lambda: np.linalg.lstsq(A, b, rcond=None)) for _ in range(3))}
    start = time.perf_counter()
    if task == "compressed":
        Q, R = np.linalg.qr(A)
        A, b = R, Q.T @ b
    compression = time.perf_counter() - start
    x = cp.Variable(model.x.size)
    constraints = []
    for effect, own in zip(model.effects, model.slices, strict=True):
        part = x[own]
        if own.stop - own.start == 1:
            constraints.append(part >= 0)
        else:
            constraints.append(cp.reshape(effect.basis.reshape(21, 36).T @ part, (6, 6), order="C") >> 0)
    problem = cp.Problem(cp.Minimize(cp.sum_squares(A @ x - b)), constraints)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        problem.solve(solver=cp.CLARABEL)
    total = time.perf_counter() - start
    return {
        "total": total,
        "compression": compression,
        "clarabel": problem.solver_stats.solve_time,
        "iterations": problem.solver_stats.num_iters,
        "status": problem.status,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--postures", type=int, nargs="+", default=[50, 500, 5000])
    parser.add_argument("--limit-s", type=float, default=120.0, help="for every process")
    parser.add_argument("--limit-gib", type=float, default=12.0, help="address space of every process")
    parser.add_argument("--worker", nargs=2, metavar=("TASK", "POSTURES"), help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.worker:
        task, postures = args.worker[0], int(args.worker[1])
        repeats = 5 if postures <= 100 else 3 if postures <= 1000 else 1
        found = time_identify(postures, repeats) if task == "identify" else time_linear(postures, task)
        print(json.dumps(found | {"peak_mib": peak_mib()}))
        return
    own, beside, notes = [], [], []
    for postures in args.postures:
        ended = {
            task: child(worker(__file__, task, str(postures)), limit_s=args.limit_s, limit_gib=args.limit_gib)
            for task in TASKS
        }
        f = ended["identify"].result
        if f is None:
            own.append([f"{postures}", *["-"] * 9])
            notes.append(f"{postures} postures: identification ended without a result: {ended['identify'].why}")
        else:
            stages = ("columns", "compression", "equilibrium", "solver", "statistics", "other", "total")
            cells = [f"{f[name]:.3f}" for name in stages]
            cells[3] = f"{f['solver']:.3f} ({f['clarabel']:.3f})"
            own.append(
                [
                    f"{postures}",
                    f"{f['rows']}",
                    *cells,
                    f"{100 * f['solver'] / f['total']:.0f} %",
                    f"{f['peak_mib']:.0f}",
                ]
            )
            notes.append(
                f"{postures} postures: rank {f['rank']} of 153, {f['iterations']:.0f} outer iterations, {f['solves']:.0f} runs of "
                f"Clarabel, {f['cpu']:.2f} CPU seconds, chi-square per degree of freedom {f['chi2']:.3f}"
            )
        cells = []
        for task in TASKS[1:]:
            e = ended[task]
            cells += [f"{e.result['total']:.3f}", f"{e.peak_mib:.0f}"] if e.result else [e.why, "-"]
            if e.result and e.result.get("status", "optimal") != "optimal":
                notes.append(f"{postures} postures, {task}: Clarabel ended as {e.result['status']}")
        beside.append([f"{postures}", *cells])
    show(
        "Identification, seconds by stage (solver: all of it, in brackets Clarabel alone; the rest is cvxpy and small algebra)",
        ("postures", "rows", "columns", "compression", "equilibrium", "solver", "statistics", "other", "total", "solver's share", "peak MiB"),
        own,
        notes,
    )  # fmt: skip
    show(
        "One linear problem of it, seconds and peak MiB of the process",
        ("postures", "cvxpy, all rows", "MiB", "QR, then cvxpy", "MiB", "numpy lstsq, no constraint", "MiB"),
        beside,
        [
            f"Limits of a process: {args.limit_s:.0f} s with the making of the campaign, {args.limit_gib:.0f} GiB of address space."
        ],
    )


if __name__ == "__main__":
    main()
