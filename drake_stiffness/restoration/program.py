"""The conic program of restoration: springs inside what was identified, inside their cones, inside the rules of beams.

Springs y, each in units of its usual size, are y = y0 + D p: along directions that the campaign saw one unit of p is one standard
deviation (or one unit of y where even that is larger), along the others one unit of y. Rules are scaled to terms of size one. Three questions are asked of the same set:
how near it comes to what was identified, the smallest and largest value of an entry, and its centre.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.restoration.evidence import Evidence
from drake_stiffness.restoration.rules import Rule
from drake_stiffness.rotations import Array

# More than any rule is ever missed by, in units of size: what a rule is relaxed by to see whether it is the culprit.
_RELAXED = 1e3
# Multipliers below this share of the largest do not count as limiting.
_LIMITING = 0.05
# What is smaller than this share of a usual value is the solver's rounding.
_ZERO = 1e-5


@dataclass(frozen=True)
class Extreme:
    """One end of an interval: its value in units of scale (infinite where nothing bounds it), and the rules that hold it."""

    value: float
    rules: tuple[str, ...]


class RestorationProgram:
    """Compiled once for a model, its evidence and its rules.

    Parameters
    ----------
    evidence : Evidence
        Of the n springs.
    rules : list of Rule
    usual : (n,)
        Usual sizes of the springs, in units of scale (`usual_sizes`).
    radius : float
        Of the confidence region, in units of noise.
    """

    def __init__(self, evidence: Evidence, rules: list[Rule], usual: Array, radius: float) -> None:
        try:
            import cvxpy as cp
        except ImportError:
            raise InputError(
                "cvxpy is not installed here, and restoring a model needs it. Install cvxpy and clarabel, or restore on another machine."
            ) from None
        self.rules, self.usual, self.radius = rules, usual, radius
        self.linear = [rule for rule in rules if rule.block is None]
        self.conic = [rule for rule in rules if rule.block is not None]
        _, w, Vt = np.linalg.svd(evidence.rows * usual, full_matrices=True)
        n, r = evidence.centre.size, w.size
        step = np.ones(n)
        step[:r] = 1.0 / np.maximum(w, 1.0)
        self._w, self._D, self._y0 = w, Vt.T * step, evidence.centre / usual
        self._at_centre = np.abs(self._y0)
        self._p = cp.Variable(n)
        self._y = self._y0 + self._D @ self._p
        self._seen = w * step[:r]
        self._u = cp.multiply(self._seen, self._p[:r])  # departures from what was identified, in units of noise

    def y_of(self) -> Array:
        """The springs at the last solution, in units of scale."""
        return np.asarray(self._y0 + self._D @ np.asarray(self._p.value)) * self.usual

    def departure(self) -> float:
        """By how many standard deviations (all combinations together) the last solution leaves what was identified."""
        return float(np.linalg.norm(np.asarray(self._u.value))) if self._w.size else 0.0

    @cached_property
    def _nearest(self) -> tuple[Any, Any]:
        import cvxpy as cp

        relax = cp.Parameter(len(self.rules), nonneg=True)
        length = cp.norm(self._u) if self._w.size else cp.Constant(0.0)
        return cp.Problem(cp.Minimize(length), self._constraints(relax)), relax

    def nearest(self, without: NDArray[np.bool_] | None = None) -> float:
        """The least departure that the rules allow; infinite where they contradict each other."""
        problem, relax = self._nearest
        relax.value = np.zeros(len(self.rules)) if without is None else _RELAXED * without
        if _solve(problem) != "solved":
            return float("inf")
        return float(problem.value)

    @cached_property
    def _extremes(self) -> tuple[Any, Any, list[Any]]:
        import cvxpy as cp

        c = cp.Parameter(self._D.shape[1])
        constraints = self._constraints(None)
        if self._w.size:
            constraints.append(cp.norm(self._u) <= self.radius)
        return cp.Problem(cp.Minimize(c @ self._p), constraints), c, constraints

    def extreme(self, i: int, sign: float, typical: float) -> Extreme:
        """Smallest (sign 1) or largest (-1) value of one spring, in units of scale; `typical` its usual size there."""
        problem, c, constraints = self._extremes
        c.value = sign * self._D[i] * self.usual[i] / typical
        end = _solve(problem)
        if end == "infeasible":
            raise UntrustworthyError(
                "the restoration program lost its way: no springs were left at an end of an interval."
            )
        if end == "unbounded":
            return Extreme(-sign * np.inf, ("nothing bounds it",))
        value = float(self._y0[i] * self.usual[i] + sign * problem.value * typical)
        value = 0.0 if abs(value) < _ZERO * typical else value
        return Extreme(value, self._limiting(constraints))

    def centre(self, departure: float) -> bool:
        """Find the centre of what the rules leave, within a departure; False where there is no inside.

        The sum of the logarithms of all slacks and determinants is largest there (slacks of a pair low b <= a <= high b weighted so that
        a = sqrt(low high) b is its own centre); a price on the squared size keeps what nothing bounds at usual sizes.
        """
        import cvxpy as cp

        # Where nothing seen may move, those variables are left out: the program is smaller, and exact.
        r = self._w.size if departure == 0.0 else 0
        p = cp.Variable(self._y0.size - r)
        if not p.size:
            self._p.value = np.zeros(self._y0.size)
            return all(rule.inside(self._y0) for rule in self.rules)
        y = self._y0 + self._D[:, r:] @ p
        rows = np.array([rule.row for rule in self.linear]).reshape(-1, self._y0.size)
        weight, limit = (np.array([getattr(rule, key) for rule in self.linear]) for key in ("weight", "limit"))
        terms = [weight @ cp.log(limit - rows @ y)] if self.linear else []
        for rule in self.conic:
            assert rule.block is not None
            k = rule.block.shape[0]
            if k == 2:
                a, b, c = (rule.block[i] @ y for i in ((0, 0), (0, 1), (1, 1)))
                terms += [cp.log(a), cp.log(c - cp.sum(cp.quad_over_lin(b, a)))]
            else:
                terms.append(cp.log_det(cp.reshape(rule.block.reshape(k * k, -1) @ y, (k, k), order="C")))
        constraints = (
            [] if r or not self._w.size else [cp.norm(cp.multiply(self._seen, p[: self._w.size])) <= departure]
        )
        problem = cp.Problem(
            cp.Maximize(sum(terms) - cp.sum_squares(cp.multiply(self.usual / self.usual.max(), y))), constraints
        )
        if _solve(problem, accepted=1e-4) != "solved":
            return False
        self._p.value = np.concatenate([np.zeros(r), np.asarray(p.value)])
        self._at_centre = self.y_of() / self.usual
        found = all(rule.inside(self._at_centre) for rule in self.rules)
        self._at_centre = np.abs(self._at_centre)
        return found

    def _constraints(self, relax: Any) -> list[Any]:
        """Linear rules as one inequality, then the cones one by one."""
        import cvxpy as cp

        rows = np.array([rule.row for rule in self.linear]).reshape(len(self.linear), self._y0.size)
        limit = np.array([rule.limit for rule in self.linear])
        wide = np.flatnonzero([rule.block is None for rule in self.rules])
        found = [rows @ self._y <= (limit if relax is None else limit + relax[wide])] if len(limit) else []
        for place, rule in enumerate(self.rules):
            if rule.block is None:
                continue
            k = rule.block.shape[0]
            more = 0.0 if relax is None else relax[place]
            if k == 2:
                a, b, c = (rule.block[i] @ self._y for i in ((0, 0), (0, 1), (1, 1)))
                found.append(cp.SOC(a + c + 2 * more, cp.hstack([a - c, 2 * b])))
            else:
                matrix = cp.reshape(rule.block.reshape(k * k, -1) @ self._y, (k, k), order="C")
                found.append(matrix + more * np.eye(k) >> 0)
        return found

    def _limiting(self, constraints: list[Any]) -> tuple[str, ...]:
        """The rules that hold the last solution, two at most.

        A multiplier times the size that the terms of its rule usually have says what a relative change of the rule does.
        """
        sizes: list[tuple[float, str]] = []
        cones = iter(constraints)
        if self.linear:
            duals = np.atleast_1d(next(cones).dual_value)
            sizes += [
                (float(d * np.abs(rule.row) @ self._at_centre), rule.name)
                for d, rule in zip(duals, self.linear, strict=True)
            ]
        for rule, constraint in zip(self.conic, cones, strict=False):
            assert rule.block is not None
            dual = constraint.dual_value
            size = float(np.abs(np.asarray(dual[0] if isinstance(dual, list) else dual)).max())
            sizes.append((size * float(np.abs(np.einsum("iin->n", rule.block)) @ self._at_centre), rule.name))
        sizes.sort(key=lambda pair: -pair[0])
        return tuple(name for size, name in sizes[:2] if size > _LIMITING * sizes[0][0]) if sizes[0][0] > 1e-9 else ()


def _solve(problem: Any, accepted: float = 1e-6) -> Literal["solved", "infeasible", "unbounded"]:
    """Solve with Clarabel and say how it ended.

    Parameters
    ----------
    accepted : float
        Tolerance that will do where rounding stops the solver short of a tight one.

    Raises
    ------
    UntrustworthyError
        If the solver gives up for another reason.
    """
    import warnings

    import cvxpy as cp

    reduced = dict.fromkeys(("reduced_tol_gap_abs", "reduced_tol_gap_rel", "reduced_tol_feas"), accepted)
    # Where long steps end in rounding, shorter ones reach the same tolerance.
    for tolerance, step in ((1e-8, 0.99), (1e-8, 0.95), (1e-8, 0.9), (accepted, 0.95)):
        try:
            with warnings.catch_warnings():
                # Clarabel ends a little short of a tight tolerance at times and cvxpy warns; the status says the same.
                warnings.simplefilter("ignore", UserWarning)
                problem.solve(
                    solver=cp.CLARABEL,
                    tol_gap_abs=tolerance,
                    tol_gap_rel=tolerance,
                    tol_feas=tolerance,
                    max_iter=300,
                    max_step_fraction=step,
                    **reduced,
                )
        except cp.error.SolverError:
            continue
        ends = {
            cp.OPTIMAL: "solved", cp.OPTIMAL_INACCURATE: "solved", cp.INFEASIBLE: "infeasible", cp.UNBOUNDED: "unbounded",
        }  # fmt: skip
        if problem.status in ends:
            return ends[problem.status]  # type: ignore[return-value]
    raise UntrustworthyError(f"the restoration program ended as '{problem.status}' in Clarabel.")
