"""Design of 30 postures out of 5,000 candidates for the KR 270: seconds, memory, and how near the bound the plans come.

Run: python benchmarks/bench_design.py [--postures 30] [--candidates 5000]

Every criterion is a process of its own, with the beam springs of the example's cell (62 unknowns, 32 combinations). Stages:
candidates with their sensitivities and the directions they determine; the relaxation with its certificate; rounding and exchange.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from itertools import pairwise
from typing import Any

from table import KR270, child, peak_mib, show, worker

CRITERIA = ("a", "d", "e", "ratio", "toolpath", "ds")


def design(criterion: str, postures: int, candidates: int) -> dict[str, Any]:
    """Seconds by stage and the figures of one plan."""
    import numpy as np

    from drake_stiffness.cell import read_cell
    from drake_stiffness.commands.design import loaded_path
    from drake_stiffness.design.assumptions import assumed_model
    from drake_stiffness.design.exchange import exchange, rounded_plan
    from drake_stiffness.design.relaxation import relax
    from drake_stiffness.design.settings import Design
    from drake_stiffness.design.space import make_criterion, path_gradients, prepare
    from drake_stiffness.design.suspicion import suspected_effect
    from drake_stiffness.plant import build_arm

    cell, settings = read_cell(KR270 / "cell.yaml"), Design(candidates=candidates)
    model = assumed_model(cell, build_arm(cell), settings)
    rows = None
    if criterion == "toolpath":
        rows = path_gradients(model, *loaded_path(KR270 / "pocket.src", KR270 / "process.yaml", model))
    suspect = suspected_effect("joint_zero_offset:joint_3", model, cell) if criterion == "ds" else None
    marks, cpu = [time.perf_counter()], time.process_time()
    space = prepare(model, postures, settings, suspect=suspect)
    phi, information = make_criterion(space, criterion, rows), space.information
    marks.append(time.perf_counter())
    relaxed = relax(information, phi, postures)
    marks.append(time.perf_counter())
    rounded = rounded_plan(relaxed.x, postures)
    plan = exchange(information, phi, rounded)
    marks.append(time.perf_counter())
    cpu = time.process_time() - cpu
    rng = np.random.default_rng([settings.seed, 1])  # the random plans that `design` compares with
    random = [float(phi.value(information.plan(rng.choice(candidates, postures, replace=False)))) for _ in range(100)]
    value = float(phi.value(information.plan(plan)))
    return {
        "seconds": [b - a for a, b in pairwise(marks)],
        "cpu": cpu,
        "relaxed": relaxed.value / relaxed.bound,
        "rounded": float(phi.value(information.plan(rounded))) / relaxed.bound,
        "plan": value / relaxed.bound,
        "random": statistics.median(random) / relaxed.bound,
        "gain": (value / statistics.median(random)) ** 0.5,
        "combinations": int(space.basis.shape[1]),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--postures", type=int, default=30)
    parser.add_argument("--candidates", type=int, default=5000)
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    args = parser.parse_args()
    sizes = ["--postures", str(args.postures), "--candidates", str(args.candidates)]
    if args.worker:
        print(json.dumps(design(args.worker, args.postures, args.candidates) | {"peak_mib": peak_mib()}))
        return
    table, notes = [], ["ds: suspected zero offset of joint 3, whose columns are differences of loaded equilibria"]
    for criterion in CRITERIA:
        ended = child([*worker(__file__, criterion), *sizes], limit_s=300.0)
        f = ended.result
        if f is None:
            table.append([criterion, *["-"] * 10])
            notes.append(f"{criterion}: no result: {ended.why}")
            continue
        seconds = [f"{s:.2f}" for s in (*f["seconds"], sum(f["seconds"]), f["cpu"])]
        shares = [f"{f[name]:.3f}" for name in ("rounded", "plan", "random")]
        table.append([criterion, *seconds, *shares, f"{f['gain']:.2f}", f"{f['peak_mib']:.0f}"])
    show(
        f"Design of {args.postures} postures out of {args.candidates} candidates, KR 270: seconds by stage; efficiency against the "
        "certified bound when rounded, after exchange, and of the median of 100 random plans; sigma of that median over the plan's",
        ("criterion", "candidates", "relaxation", "exchange", "total", "CPU", "rounded", "plan", "random", "sigma gain", "peak MiB"),
        table,
        notes,
    )  # fmt: skip


if __name__ == "__main__":
    main()
