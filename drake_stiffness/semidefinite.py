"""The solvers of one linearisation: least squares in closed form, the semidefinite program in cvxpy with Clarabel.

The semidefinite program is

    minimise  || u ||^2   subject to   every compliance matrix in x = x_ls + V u / w + N y  being >= 0

in units of the parameters' scales: V the seen directions, w their weights, N the unseen directions. Where its solution is not
unique, the one of least norm is taken by a second program over the unseen directions alone, so what the data determine is not
touched by it. Both are compiled once and solved again for every right-hand side.
"""

from __future__ import annotations

import logging
import warnings
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.effects.compliance import LinkCompliance, Spring
from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.identifiability import Identifiability
from drake_stiffness.model import Model
from drake_stiffness.rotations import Array

log = logging.getLogger("drake_stiffness")

# Prior of the linearisation point of least squares: this many typical compliances (see `regularised`).
_LOOSE = 30.0
# Tolerances of the solver, tried in turn.
_TOLERANCES = (1e-10, 1e-9, 1e-8, 1e-7)
# Price of unseen directions in the fit, per squared unit of scale: far below what the data say of anything they see.
_FLAT = 1e-6
# A departure from least squares (in sigma of all readings together) that the price of unseen directions alone explains.
_NEGLIGIBLE = 1e-2


def spring_parameters(model: Model) -> NDArray[np.bool_]:
    """(n,) which parameters are compliances of linear springs."""
    return np.array([isinstance(e, Spring) for e in model.effects for _ in e.parameters], dtype=bool)


def cone_blocks(model: Model) -> tuple[NDArray[np.int_], ...]:
    """Every cone of a model as a square array of parameter numbers, -1 for a structural zero."""
    return tuple(
        np.where(block >= 0, block + own.start, -1)
        for effect, own in zip(model.effects, model.slices, strict=True)
        for block in effect.cone_blocks
    )


class Linearised:
    """One linearisation of a model: what is seen, the cones, and the ways to solve for the parameters.

    Parameters
    ----------
    model : Model
    view : Identifiability
    """

    def __init__(self, model: Model, view: Identifiability) -> None:
        self.model, self.view = model, view
        self.anchor = np.zeros(model.x.size)
        self.departure = 0.0  # from least squares to the cone, in sigma of all readings together
        self.solver = "closed form (no constraint active)"
        self._fit: Any = None
        self._completion: Any = None

    def least_squares(self, z: Array) -> Array:
        """Least squares (seed eq. 12) on what is fitted, with the least departure from the anchor on the rest."""
        return self.anchor + self.view.seen @ (z - self.view.seen.T @ self.anchor)

    def regularised(self, z: Array) -> Array:
        """A point to linearise at that weak directions cannot carry away.

        Least squares may put any value, of any sign, on what the data hardly see; the loaded equilibrium of such springs
        need not exist. A prior of many typical compliances per direction leaves all that is known untouched.
        """
        weight = self.view.weight
        shrink = weight**2 / (weight**2 + self._prior_precision())
        return self.anchor + self.view.seen @ (shrink * (z - self.view.seen.T @ self.anchor))

    def _prior_precision(self) -> Array:
        """1 / _LOOSE^2 on directions made of springs, nothing on the rest (frames and geometry have no natural zero)."""
        share = (self.view.seen[spring_parameters(self.model)] ** 2).sum(axis=0)
        return share / _LOOSE**2

    def semidefinite(self, z: Array) -> Array:
        """The semidefinite program, then the least-norm completion."""
        x = self.least_squares(z)
        self.departure = 0.0
        if not self._constrained() or not self.view.fitted or self._violation(x) <= 0.0:
            return x
        step, choice = self._solve_fit(x)
        self.departure = float(np.linalg.norm(step))
        if self.departure < _NEGLIGIBLE:
            # The cone does not bind what the data see, and Clarabel stops within its tolerance: that part is known exactly.
            exact = self._complete(x)
            if exact is not None:
                return self._project(exact)
        x = x + (self.view.seen / self.view.weight) @ step
        completed = self._complete(x)
        return self._project(x + self._free @ choice if completed is None else completed)

    def _constrained(self) -> bool:
        return any(effect.cone_blocks for effect in self.model.effects) or self._bounded.size > 0

    @cached_property
    def _bounded(self) -> NDArray[np.int_]:
        """Parameters outside any cone that have a finite bound."""
        inside = {i for block in self._blocks() for i in block.ravel() if i >= 0}
        finite = [np.isfinite(p.lower) or np.isfinite(p.upper) for p in self.model.parameters]
        return np.array([i for i, f in enumerate(finite) if f and i not in inside], dtype=int)

    def _limits(self, origin: Array, size: float) -> tuple[Array, Array]:
        """Bounds of those parameters in units of scale, counted from an origin in units of `size`."""
        chosen = [self.model.parameters[i] for i in self._bounded]
        lower = np.array([p.lower / p.scale for p in chosen]).reshape(-1)
        upper = np.array([p.upper / p.scale for p in chosen]).reshape(-1)
        at = origin[self._bounded]
        # cvxpy's parameters must be finite; nothing is ever larger than this in units of scale.
        return np.clip((lower - at) / size, -1e9, 1e9), np.clip((upper - at) / size, -1e9, 1e9)

    @cached_property
    def _held(self) -> NDArray[np.bool_]:
        """(n,) parameters that a cone or a bound speaks of."""
        held = spring_parameters(self.model)
        held[self._bounded] = True
        return held

    def _blocks(self) -> tuple[NDArray[np.int_], ...]:
        return cone_blocks(self.model)

    def _matrix(self, block: NDArray[np.int_], x: Array) -> Array:
        """A cone's matrix in scaled units: congruence with the component scales keeps definiteness."""
        return np.where(block >= 0, x[np.maximum(block, 0)], 0.0)

    def _violation(self, x: Array) -> float:
        """How far the most negative eigenvalue is below zero, in scaled units."""
        worst = max((-float(np.linalg.eigvalsh(self._matrix(b, x))[0]) for b in self._blocks()), default=-np.inf)
        lower, upper = self._limits(np.zeros_like(x), 1.0)
        at = x[self._bounded]
        return max(worst, float(np.maximum(lower - at, at - upper).max(initial=-np.inf)))

    def active(self, x: Array) -> tuple[str, ...]:
        """Springs that the cone holds at its border, if it moved what the data see.

        Least norm puts unseen entries on the border too; that is convention and not reported.
        """
        found: list[str] = []
        if self.departure < _NEGLIGIBLE:
            return ()
        for effect, own in zip(self.model.effects, self.model.slices, strict=True):
            for own_block in effect.cone_blocks:
                block = np.where(own_block >= 0, own_block + own.start, -1)
                if self.view.zero[block[block >= 0]].all():
                    continue
                values = np.linalg.eigvalsh(self._matrix(block, x))
                if values[0] <= 1e-7 * max(1.0, values[-1]):
                    found.append(effect.link_name() if isinstance(effect, LinkCompliance) else effect.where)
                    break
        return tuple(found)

    def _project(self, x: Array) -> Array:
        """Remove the last negative rounding (below solver tolerance) by clipping eigenvalues block by block."""
        x = x.copy()
        for block in self._blocks():
            values, vectors = np.linalg.eigh(self._matrix(block, x))
            if values[0] >= 0:
                continue
            clipped = vectors @ np.diag(np.maximum(values, 0.0)) @ vectors.T
            x[block[block >= 0]] = clipped[block >= 0]
        x[self._bounded] = np.clip(x[self._bounded], *self._limits(np.zeros_like(x), 1.0))
        return x

    def _constraints(self, x: Any, lower: Any, upper: Any) -> list[Any]:
        """Cones, and bounds (arrays or cvxpy parameters) on the bounded parameters."""
        cp = _cvxpy()

        constraints = []
        for block in self._blocks():
            size = block.shape[0]
            if size == 1:
                constraints.append(x[int(block[0, 0])] >= 0)
                continue
            pick = np.zeros((size * size, self.model.x.size))
            for row, number in enumerate(block.ravel()):
                if number >= 0:
                    pick[row, number] = 1.0
            constraints.append(cp.reshape(pick @ x, (size, size), order="C") >> 0)
        if self._bounded.size:
            constraints += [x[self._bounded] >= lower, x[self._bounded] <= upper]
        return constraints

    @cached_property
    def _free(self) -> Array:
        """Unseen directions that springs take part in, (n, f); others cannot touch a cone."""
        part = self.view.unseen[spring_parameters(self.model)]
        if not part.size:
            return np.zeros((self.model.x.size, 0))
        _, size, Wt = np.linalg.svd(part, full_matrices=False)
        return self.view.unseen @ Wt[size > 1e-3].T

    def _solve_fit(self, x0: Array) -> tuple[Array, Array]:
        """By how much the seen combinations must leave their least-squares values, in units of their noise.

        With x = x0 + V u / w + N y, w the weights and N the unseen directions, the fit term is || u ||^2 whatever the units and
        the conditioning of the data; frames and geometry drop out, because no cone holds them.
        """
        cp = _cvxpy()

        view, free = self.view, self._free
        unit = view.weight.min()
        if self._fit is None:
            u, y, base = cp.Variable(view.fitted), cp.Variable(free.shape[1]), cp.Parameter(x0.size)
            # In units of the weakest weight the columns of u are of the size of those of y, however long the campaign.
            x = base + (view.seen * (unit / view.weight)) @ u + (free @ y if free.shape[1] else 0)
            # Without a price on y the program has flat directions, which an interior-point method walks along for ever.
            cost = cp.sum_squares(u) + (_FLAT * cp.sum_squares(y) if free.shape[1] else 0)
            if view.hidden.shape[1] and free.shape[1]:
                # What the noise hides is not fitted, but moving along it costs what the readings say.
                cost += cp.sum_squares((view.hidden_weight[:, None] / unit * (view.hidden.T @ free)) @ y)
            limits = self._limits(np.zeros_like(x0), 1.0)
            self._fit = (cp.Problem(cp.Minimize(cost), self._constraints(x, *limits)), u, y, base)
        problem, u, y, base = self._fit
        # Frames and geometry without bounds are not at home in this program: only what is held enters.
        base.value = np.where(self._held, x0, 0.0)
        _run(problem, "fit", _TOLERANCES)
        self.solver = f"CLARABEL through cvxpy ({problem.solver_stats.num_iters} iterations)"
        return np.asarray(u.value) * unit, np.asarray(y.value) if free.shape[1] else np.zeros(0)

    def _complete(self, x0: Array) -> Array | None:
        """The springs of least norm among all that the data cannot tell from x0 and the cone allows; None if that fails."""
        cp = _cvxpy()

        free = self._free
        if not free.shape[1]:
            return x0
        if self._completion is None:
            y, base = cp.Variable(free.shape[1]), cp.Parameter(x0.size)
            x = base + free @ y
            lower, upper = (cp.Parameter(self._bounded.size) for _ in range(2))
            problem = cp.Problem(cp.Minimize(cp.sum_squares(x)), self._constraints(x, lower, upper))
            self._completion = (problem, y, base, lower, upper)
        problem, y, base, lower, upper = self._completion
        # Cones do not change with the unit, so all is done in units of the largest departure.
        off = x0 - self.anchor
        size = max(float(np.abs(off).max()), 1e-12)
        base.value = off / size
        lower.value, upper.value = self._limits(self.anchor, size)
        try:
            _run(problem, "completion", _TOLERANCES[2:])
        except UntrustworthyError:
            log.info("the least-norm completion did not solve; the solver's own choice among equal fits is kept")
            return None
        return np.asarray(x0 + free @ (np.asarray(y.value) * size))


def _cvxpy() -> Any:
    try:
        import cvxpy
    except ImportError:
        raise InputError(
            "cvxpy is not installed here, and method sdp needs it where a compliance matrix must be held positive semidefinite. "
            "Install cvxpy and clarabel, or take --method least-squares."
        ) from None
    return cvxpy


def _run(problem: Any, what: str, tolerances: tuple[float, ...]) -> None:
    """Solve with Clarabel, tight at first; where rounding stops it short, at looser tolerances."""
    cp = _cvxpy()
    for tolerance in tolerances:
        try:
            with warnings.catch_warnings():
                # Clarabel sometimes ends a little short of a tight tolerance and cvxpy warns; the status says the same.
                warnings.simplefilter("ignore", UserWarning)
                # Drake brings an unlicensed MOSEK that cvxpy would pick: always name the solver.
                problem.solve(
                    solver=cp.CLARABEL, tol_gap_abs=tolerance, tol_gap_rel=tolerance, tol_feas=tolerance, max_iter=200
                )
        except cp.error.SolverError:
            continue
        if problem.status == cp.OPTIMAL:
            return
    if problem.status != cp.OPTIMAL_INACCURATE:
        raise UntrustworthyError(f"the semidefinite program ({what}) ended as '{problem.status}' in Clarabel.")


def smallest_eigenvalue(model: Model) -> float:
    """Smallest eigenvalue over all springs, each scaled by its components' scales; >= 0 for positive semidefinite springs."""
    worst = np.inf
    for effect, own in zip(model.effects, model.slices, strict=True):
        scaled = model.x[own] / model.scales[own]
        for block in effect.cone_blocks:
            matrix = np.where(block >= 0, scaled[np.maximum(block, 0)], 0.0)
            worst = min(worst, float(np.linalg.eigvalsh(matrix)[0]))
    return worst if np.isfinite(worst) else 0.0
