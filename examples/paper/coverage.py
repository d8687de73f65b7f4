"""Do profile-likelihood intervals cover the truth as often as they promise, near active constraints too?

    python examples/paper/coverage.py [FOLDER] [SEEDS]

writes `coverage.md` (the tables of docs/intervals.md) to FOLDER, `out/paper` unless given. A thousand seeds take about a quarter of
an hour of one core, nearly all of it for the KR 270, whose counts are kept in FOLDER/coverage: a run that was stopped goes on there.
Delete that folder after a change of the programs.
"""

from __future__ import annotations

import sys
from itertools import chain
from pathlib import Path

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm

from drake_stiffness.files import write_whole
from drake_stiffness.identification import identify
from drake_stiffness.intervals.cone_program import ConeLeastSquares
from drake_stiffness.intervals.cone_range import ConeRange
from drake_stiffness.intervals.interval import quantile
from drake_stiffness.intervals.profile import base_combinations, problem_of
from drake_stiffness.start import starting_model
from drake_stiffness.task import read_task

CAMPAIGN = Path(__file__).parents[1] / "kr270" / "campaign.yaml"
LEVEL, Q = 0.95, quantile(0.95)
PAIR = np.array([[0, 1], [1, 2]])


def coverage(F, blocks, truth, C, seeds, first=0):
    """How many of the seeds cover c^T truth, for every row c of C: what `intervals` states (the hull of the profile and of eq.
    (14) cut to the cones), the profile alone, the hull that `predict` uses, and estimate +- 1.96 sigma as if nothing held it."""
    program = ConeLeastSquares(F, blocks)
    held = [ConeLeastSquares(F, blocks, equal=c) for c in C]
    inverse = np.linalg.pinv(F)
    along = inverse @ (C @ inverse).T  # how x moves with c^T x at the least cost
    sigma = np.linalg.norm(C @ inverse, axis=1)
    true, hits = C @ truth, np.zeros((4, len(C)), dtype=int)
    for seed in range(first, first + seeds):
        g = F @ truth + np.random.default_rng(seed).normal(size=F.shape[0])
        step = inverse @ (g - F @ truth)
        # Where the unconstrained minimiser nearest to the truth is inside the cones, no program is needed.
        x = truth + step if program.feasible(truth + step) else program.solve(g)
        least, free, rise = np.sum((F @ x - g) ** 2), true + C @ step, []
        for i, h in enumerate(held):
            near = truth + step - along[:, i] * (C[i] @ step) / sigma[i] ** 2
            near = near if program.feasible(near) else h.solve(g, true[i])
            rise.append(np.sum((F @ near - g) ** 2) - least)
        low, high = np.minimum(free - Q**0.5 * sigma, C @ x), np.maximum(free + Q**0.5 * sigma, C @ x)
        profile, plain = np.array(rise) <= Q + 1e-6, abs(free - true) <= Q**0.5 * sigma  # the truth is inside the cones
        hits += [profile | plain, profile, (low <= true) & (true <= high), abs(C @ x - true) <= Q**0.5 * sigma]
    return hits


def kept(file, F, blocks, truth, C, seeds, chunk=20):
    """The same as shares of all seeds, rounded up to whole chunks; counts are kept in a file, so a stopped run goes on."""
    chunks = -(-seeds // chunk)
    counts = np.load(file) if file.exists() else np.zeros((0, 4, len(C)), dtype=int)
    while len(counts) < chunks:
        counts = np.concatenate([counts, coverage(F, blocks, truth, C, chunk, chunk * len(counts))[None]])
        np.save(file, counts)
    return counts[:chunks].sum(axis=0) / (chunk * chunks)


def row(name, shares):
    """Least, mean and largest share of every kind, in percent."""
    return [name, *(f"{100 * s.min():.1f} / {100 * s.mean():.1f} / {100 * s.max():.1f}" for s in shares)]


def small(seeds):
    """Two bounded unknowns and two 2x2 blocks seen by twenty correlated readings; sigma of every unknown is near one."""
    F = np.random.default_rng(1).normal(size=(20, 8)) @ (0.2 * np.eye(8) + 0.02)
    blocks = [np.array([[0]]), np.array([[1]]), PAIR + 2, PAIR + 5]
    C = np.vstack([np.eye(8), np.ones(8)])
    truths = {
        "no constraint near": [30, 30, 30, 5, 30, 30, 5, 30],
        "one bounded unknown at 0": [0, 30, 30, 5, 30, 30, 5, 30],
        "one bounded unknown half a sigma from 0": [0.5, 30, 30, 5, 30, 30, 5, 30],
        "one 2x2 block at its rim": [30, 30, 9, 6, 4, 30, 5, 30],
        "one 2x2 block zero": [30, 30, 0, 0, 0, 30, 5, 30],
        "everything at the rim": [0, 0, 9, 6, 4, 0, 0, 0],
    }
    for name, truth in truths.items():
        yield row(f"small problem, {name}", coverage(F, blocks, np.array(truth, dtype=float), C, seeds) / seeds)


def kr270(seeds, folder):
    """The base parameters of the KR 270 campaign, at the identified springs (many at the rim) and well inside the cones."""
    task = read_task(CAMPAIGN)
    o = task.observations()
    solution = identify(starting_model(task.model, task.taking_part()), o)
    problem, scales = problem_of(solution, o), solution.model.scales
    C = np.array([c.weights * scales for c in base_combinations(solution)])
    C -= C @ problem.unseen @ problem.unseen.T
    folder.mkdir(parents=True, exist_ok=True)
    rim = problem.x.copy()
    inside = rim + np.array([any(i in np.diag(b) for b in problem.blocks) for i in range(rim.size)])
    for name, truth in (
        ("well inside", inside),
        ("as identified, least norm", rim),
        ("joints alone", rim * (np.arange(62) < 6)),
    ):
        file = folder / f"{name.replace(' ', '_').replace(',', '')}.npy"
        yield row(f"KR 270, {len(C)} base parameters, {name}", kept(file, problem.F, problem.blocks, truth, C, seeds))


def bounded_critical(mu):
    """95 % quantile of the likelihood ratio of one bounded unknown at mu sigma: closed form of its null distribution."""

    def beyond(root):
        left = root if root <= mu else (root**2 + mu**2) / (2 * max(mu, 1e-12))
        return norm.cdf(root) - norm.cdf(-left) - LEVEL

    return brentq(beyond, 1.0, 3.0) ** 2


def bounded_widths():
    """Upper ends of one bounded unknown, sigma one: profile, and exact test inversion."""
    for y in (-2.0, -1.0, 0.0, 0.5, 1.0, 2.0, 4.0):
        grid = np.linspace(0.0, y + 6.0 if y > 0 else 6.0, 3001)
        ratio = (y - grid) ** 2 - min(y, 0.0) ** 2
        exact = grid[ratio <= np.array([bounded_critical(mu) for mu in grid])]
        low, high = ConeRange(np.eye(1), [np.array([[0]])]).extreme(np.ones(1), np.array([y]), Q)
        yield [f"{y:g}", f"{low:.2f} .. {high:.2f}", f"{exact.min():.2f} .. {exact.max():.2f}"]


def pair_widths(draws=300):
    """Of a = k11 in a 2x2 block seen with sigma one: profile, and inversion of simulated tests (nuisance at its constrained fit)."""
    F, c = np.eye(3), np.array([1.0, 0.0, 0.0])
    free, held, reach = ConeLeastSquares(F, [PAIR]), ConeLeastSquares(F, [PAIR], equal=c), ConeRange(F, [PAIR])

    def ratio(g, t):
        return np.sum((held.solve(g, t) - g) ** 2) - np.sum((free.solve(g) - g) ** 2)

    def accepted(g, t, rng):
        null = held.solve(g, t)  # the most likely truth with a = t
        simulated = [ratio(null + rng.normal(size=3), t) for _ in range(draws)]
        return ratio(g, t) <= np.quantile(simulated, LEVEL)

    for g in ([1.0, 1.5, 1.0], [3.0, 3.0, 1.0], [0.5, -1.0, -1.0], [9.0, 0.0, 9.0]):
        low, high = reach.extreme(c, np.array(g), Q)
        near = np.concatenate([low + np.arange(-0.55, 0.6, 0.1), high + np.arange(-0.55, 0.6, 0.1)])
        inside = [t for t in near[near > 0.01] if accepted(np.array(g), t, np.random.default_rng(7))]
        start = 0.0 if low < 0.06 else min(inside)
        yield [str(tuple(g)), f"{low:.2f} .. {high:.2f}", f"{start:.1f} .. {max(inside):.1f}"]


def main(folder, seeds):
    """All tables, printed as they come."""
    text = []
    for header, rows in (
        (
            ("least / mean / largest coverage in %", "stated", "profile", "hull of `predict`", "estimate ± 1.96 σ"),
            small(seeds),
        ),
        (
            ("the same", "stated", "profile", "hull of `predict`", "estimate ± 1.96 σ"),
            kr270(seeds, folder / "coverage"),
        ),
        (("one bounded unknown, reading", "profile", "exact inversion, closed form"), bounded_widths()),
        (("k11 of a 2x2 block, readings (k11, k12, k22)", "profile", "inversion of simulated tests"), pair_widths()),
    ):
        for cells in chain((header, ["---"] * len(header)), rows):
            text.append(f"| {' | '.join(cells)} |")
            print(text[-1], flush=True)
        text.append("")
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "coverage.md", "\n".join(text))


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/paper"), int(sys.argv[2]) if len(sys.argv) > 2 else 1000)
