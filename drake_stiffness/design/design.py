"""Measurement design: which postures and loads tell most of what a cell's model has to be told.

Candidates (`candidates`) give information matrices; a criterion (`design_criteria`) says what is wanted of their sum; the relaxation
(`design_relaxation`) bounds what any plan can reach; rounding and exchange (`design_exchange`) find a plan near that bound.

Only what all candidates together determine enters: a basis of those directions is fixed first (`design_space`), and a plan that
determines fewer is refused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.design.candidates import Candidates
from drake_stiffness.design.criteria import Criterion
from drake_stiffness.design.exchange import exchange, rounded_plan
from drake_stiffness.design.relaxation import Relaxation, relax
from drake_stiffness.design.space import Progress, Space, make_criterion
from drake_stiffness.errors import InputError
from drake_stiffness.rotations import Array

# A direction that a plan sees with less than this share of what the mean candidate gives counts as not determined.
_UNDETERMINED = 1e-6


@dataclass(frozen=True, eq=False)
class Designed:
    """A plan and how good it is.

    Attributes
    ----------
    space : Space
    criterion : Criterion
    chosen : (n,) numbers of candidates, in the order they shall be done
    relaxation : Relaxation
    value : float
        phi of the plan, what was measured included.
    random : (plans,)
        phi of random plans of equal size.
    fewest : int or None
        For ratio: no plan of fewer postures can exceed the threshold (certified).
    reached : bool
        For ratio: whether this plan exceeds it.
    """

    space: Space
    criterion: Criterion
    chosen: NDArray[np.int_]
    relaxation: Relaxation
    value: float
    random: Array
    fewest: int | None = None
    reached: bool = True

    @property
    def efficiency(self) -> float:
        """phi of the plan over what no plan of as many postures exceeds."""
        return self.value / self.relaxation.bound

    @property
    def plan(self) -> Candidates:
        return self.space.candidates.take(self.chosen)

    @property
    def covariance(self) -> Array:
        """Predicted covariance along the basis, (r, r)."""
        return np.asarray(np.linalg.inv(self.space.information.plan(self.chosen)), dtype=float)


def choose(space: Space, criterion: Criterion, n: int, progress: Progress = lambda text: None) -> Designed:
    """The plan of n postures.

    Raises
    ------
    InputError
        If n postures cannot determine what all candidates together determine.
    """
    information = space.information
    need = fewest_for_rank(space)
    if n < need:
        raise InputError(
            f"-n: {n} postures cannot determine the {space.basis.shape[1]} combinations that these loads and points show; at least {need} "
            "are needed. Ask for more postures, or more loads in each (loads.per_posture in DESIGN.yaml)."
        )
    progress(f"relaxation over {information.number} candidates")
    relaxation = relax(information, criterion, n)
    progress(f"exchange of {n} postures")
    chosen = exchange(information, criterion, rounded_plan(relaxation.x, n))
    if not determines_all(space, chosen):
        raise InputError(
            f"-n: the best {n} postures found leave some of the {space.basis.shape[1]} combinations undetermined that all candidates "
            "together determine; ask for more postures, or more loads in each (loads.per_posture in DESIGN.yaml)."
        )
    rng = np.random.default_rng([space.settings.seed, 1])
    ridge = information.ridge(n)
    random = np.array([
        float(criterion.value(information.plan(rng.choice(information.number, n, replace=False)) + ridge))
        for _ in range(space.settings.random_plans)
    ])  # fmt: skip
    order = rng.permutation(chosen)  # drift is told from postures by a random order
    return Designed(space, criterion, order, relaxation, float(criterion.value(information.plan(chosen))), random)


def fewest_for_rank(space: Space) -> int:
    """How many postures the number of combinations asks for at least."""
    S = np.vstack([space.rows[0] @ space.basis, np.zeros((1, space.basis.shape[1]))])
    each = max(int(np.linalg.matrix_rank(S)), 1)
    values = np.linalg.eigvalsh(space.information.start)
    known = int((values > 1e-12 * max(values[-1], 1e-300)).sum()) if values[-1] > 0 else 0
    return -(-max(space.basis.shape[1] - known, 1) // each)


def determines_all(space: Space, chosen: NDArray[np.int_]) -> bool:
    """Whether a plan, with what was measured, sees every direction of the basis."""
    A = (space.rows[chosen] @ space.basis).reshape(-1, space.basis.shape[1])
    if space.measured is not None:
        own = space.measured.R.shape[1]
        A = np.vstack([A, space.measured.R @ space.basis[:own]])
    mean = space.information.total(np.full(space.candidates.number, chosen.size / space.candidates.number))
    # In the metric of the mean plan every direction has length one.
    half = np.linalg.inv(np.linalg.cholesky(mean))
    singular = np.linalg.svd(A @ half.T, compute_uv=False)
    return singular.size >= half.shape[0] and bool(singular[half.shape[0] - 1] > _UNDETERMINED)


def choose_fewest(space: Space, most: int, progress: Progress = lambda text: None) -> Designed:
    """The smallest plan, of at most `most` postures, whose worst ratio exceeds the threshold.

    The relaxed bound grows with the number of postures, so the smallest number whose bound exceeds the threshold is a certified
    lower limit; from there on plans are tried.
    """
    criterion = make_criterion(space, "ratio")
    wanted = space.settings.threshold**2
    low = fewest_for_rank(space)
    if most < low:
        return choose(space, criterion, most, progress)  # says what is wrong

    def bound(n: int) -> bool:
        progress(f"whether {n} postures could do")
        return relax(space.information, criterion, n).bound >= wanted

    limit = first_true(bound, low, most)
    if limit is None:
        found = choose(space, criterion, most, progress)
        return _marked(found, most + 1, reached=False)
    plans: dict[int, Designed] = {}

    def enough(n: int) -> bool:
        plans[n] = choose(space, criterion, n, progress)
        return plans[n].value >= wanted

    least = first_true(enough, limit, most)
    if least is None:
        return _marked(plans.get(most) or choose(space, criterion, most, progress), limit, reached=False)
    return _marked(plans[least], limit, reached=True)


def first_true(test: Callable[[int], bool], low: int, high: int) -> int | None:
    """The smallest number in low .. high that passes a test which larger ones pass as well; None if none does."""
    if test(low):
        return low
    if low == high or not test(high):
        return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if test(middle) else (middle, high)
    return high


def _marked(found: Designed, fewest: int, *, reached: bool) -> Designed:
    return replace(found, fewest=fewest, reached=reached)
