"""Least squares with positive-semidefinite blocks and bounds, by Clarabel directly: set up once, solved for many right-hand sides.

    argmin || F x - g ||^2    over all x with every block positive semidefinite and lower <= x <= upper

F is compressed once by QR with pivoting, F B = Q diag(w s): B holds r base unknowns, each step as long as one sigma (or one unit
of x where the data hardly know it), and n - r directions that F does not see, one for every dependent unknown. B is sparse where few
unknowns merge with each other, and that is what makes a program fast. Only the right-hand side of the cones changes from one g to the
next (`DefaultSolver.update`, which asks for presolve and chordal decomposition to be off). F should be in units of its noise and x in
units of a typical size.

A cone of size 1 is a bound, one of size 2 a second-order cone (a + c >= |(a - c, 2 b)|), a larger one Clarabel's triangle: the
upper triangle column by column, entries off the diagonal times sqrt(2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.rotations import Array

Block = NDArray[np.int_]

# Price of a squared unit along directions that F does not see: among equal fits it takes nearly the least; without one the solver
# walks along them for ever.
_PRICE = 1e-8
_GOOD = ("Solved", "AlmostSolved")
# Equilibration, largest step, factor on the tolerance wanted: tried in turn. Rounding stops about one program in a thousand short,
# most often at the tip of a cone, and hardly ever in two of these ways. Rows and columns are of like size already, so equilibration
# only costs iterations; a solver that asks for less stops before rounding spoils what it has.
_WAYS = (
    (False, 0.99, 1.0),
    (False, 0.9, 1.0),
    (False, 0.99, 1e2),
    (True, 0.99, 1e2),
    (False, 0.99, 1e4),
    (True, 0.9, 1e4),
)
# Pivots below this, relative to the largest, are rounding.
_RANK = 1e-11
# Shares of a merged unknown below this are rounding.
_ROUNDING = 1e-10
# Tolerances wanted, and those that are accepted where rounding stops the solver short; unknowns err by the root of them.
_TOLERANCES = (1e-12, 1e-7)


class ConeLeastSquares:
    """argmin || F x - g || over x with every block positive semidefinite and lower <= x <= upper.

    Parameters
    ----------
    F : (m, n)
        In units of the noise per unit of x. It may lack rank: x is then one of the minimisers, small along what F does not see.
    blocks : sequence of (k, k) int
        Numbers of unknowns, -1 for a structural zero.
    lower, upper : (n,) or float, optional
        Bounds, infinite where there are none.
    equal : (k, n), optional
        Rows E of an equation E x = t, whose right-hand side `solve` is given.

    Attributes
    ----------
    B : (n, n)
        Steps of x: r along which the misfit grows, the rest without any influence on it.
    weight : (n,)
        By how much F x moves along the columns of B; zero from the r-th on.
    """

    def __init__(
        self,
        F: Array,
        blocks: Sequence[Block],
        lower: Array | float | None = None,
        upper: Array | float | None = None,
        equal: Array | None = None,
    ) -> None:
        from scipy.linalg import qr, solve_triangular

        n = F.shape[1]
        self.blocks = tuple(np.asarray(block) for block in blocks)
        self.lower = np.broadcast_to(-np.inf if lower is None else lower, n).astype(float)
        self.upper = np.broadcast_to(np.inf if upper is None else upper, n).astype(float)
        Q, R, order = qr(F, mode="economic", pivoting=True)
        diagonal = np.abs(np.diag(R))
        r = int((diagonal > _RANK * diagonal.max(initial=0.0)).sum())
        base, rest = order[:r], order[r:]
        self._along = Q[:, :r].T
        inverse = solve_triangular(R[:r, :r], np.eye(r))
        self.weight = np.zeros(n)
        self.weight[:r] = np.minimum(diagonal[:r], 1.0)
        merged = inverse @ R[:r, r:]
        self.B = np.zeros((n, n))
        self.B[base, :r] = inverse * self.weight[:r]
        self.B[base, r:] = -np.where(np.abs(merged) > _ROUNDING, merged, 0.0)
        self.B[rest, np.arange(r, n)] = 1.0
        blind = np.linalg.qr(self.B[:, r:])[0]
        least = np.zeros((n, r))
        least[base] = inverse
        self._least_norm = least - blind @ (blind.T @ least)
        self.G, self.h, self.cones = _cone_rows(n, self.blocks, self.lower, self.upper)
        # Half the squared residual over the steps; along what is hardly seen the price.
        self._P = self.weight**2 + np.where(self.weight < 1.0, _PRICE, 0.0)
        self._A = -(self.G @ self.B)
        self.E = np.zeros((0, n)) if equal is None else np.atleast_2d(equal)
        # Beside cones of the size of one an equation in small units would be met to the solver's tolerance by anything.
        self._size = np.maximum(np.linalg.norm(self.E @ self.B, axis=1), 1e-300)
        self._whole = np.vstack([self.E @ self.B / self._size[:, None], self._A])
        held = [("zero", self.E.shape[0])] if self.E.size else []
        self._fit = Solver(self._whole != 0, [*held, *self.cones], _TOLERANCES)

    @property
    def rank(self) -> int:
        return self._along.shape[0]

    def least_squares(self, g: Array) -> Array:
        """The unconstrained minimiser of least norm."""
        return np.asarray(self._least_norm @ (self._along @ g))

    def feasible(self, x: Array) -> bool:
        """Whether x is inside all cones and bounds."""
        if (x < self.lower).any() or (x > self.upper).any():
            return False
        return all(np.linalg.eigvalsh(block_matrix(block, x))[0] >= 0.0 for block in self.blocks)

    def solve(self, g: Array, at: Array | float | None = None) -> Array:
        """The minimiser for one right-hand side g (m,), and one (k,) of the equations where there are any.

        Raises
        ------
        UntrustworthyError
            If no x satisfies cones, bounds and equations, or the solver stops short of 1e-7.
        """
        x = self.least_squares(g)
        if not self.E.size and self.feasible(x):
            return x
        wanted = np.zeros(0) if at is None else np.atleast_1d(at)
        b = np.concatenate([(wanted - self.E @ x) / self._size, self.G @ x + self.h])
        p = self._fit.run(self._P, np.zeros(x.size), self._whole, b, "the semidefinite least squares")
        return np.asarray(x + self.B @ p)


def block_matrix(block: Block, x: Array) -> Array:
    """The matrix that a block picks out of x."""
    return np.where(block >= 0, x[np.maximum(block, 0)], 0.0)


def _cone_rows(
    n: int, blocks: Sequence[Block], lower: Array, upper: Array
) -> tuple[Array, Array, list[tuple[str, int]]]:
    """G (rows, n), h (rows,) and cones such that G x + h lies in their product; bounds first, then the blocks."""
    rows: list[Array] = []
    offset: list[float] = []
    larger: list[tuple[Array, tuple[str, int]]] = []
    unit = np.vstack([np.eye(n), np.zeros(n)])  # number -1 is the structural zero
    for block in blocks:
        k = block.shape[0]
        if k == 1:
            rows.append(unit[block[0, 0]])
            offset.append(0.0)
        elif k == 2:
            a, b, c = unit[block[0, 0]], unit[block[0, 1]], unit[block[1, 1]]
            larger.append((np.stack([a + c, a - c, 2.0 * b]), ("second-order", 3)))
        else:
            triangle = [unit[block[i, j]] * (1.0 if i == j else math.sqrt(2.0)) for j in range(k) for i in range(j + 1)]
            larger.append((np.stack(triangle), ("triangle", k)))
    for i in range(n):
        if np.isfinite(lower[i]):
            rows.append(unit[i])
            offset.append(-float(lower[i]))
        if np.isfinite(upper[i]):
            rows.append(-unit[i])
            offset.append(float(upper[i]))
    cones = [("nonnegative", len(rows))] if rows else []
    cones += [cone for _, cone in larger]
    G = np.vstack([np.zeros((0, n)), *rows, *(part for part, _ in larger)])
    h = np.zeros(G.shape[0])
    h[: len(offset)] = offset
    return G, h, cones


class Solver:
    """Clarabel for one pattern of A and one product of cones: set up at the first call, updated afterwards."""

    def __init__(
        self, pattern: NDArray[np.bool_], cones: Sequence[tuple[str, int]], tolerances: tuple[float, float]
    ) -> None:
        self.pattern, self.cones, self.tolerances = pattern, cones, tolerances
        self._warm: Any = None
        self._A: Array | None = None

    def run(self, P: Array, q: Array, A: Array, b: Array, what: str) -> Array:
        """argmin sum P p^2 / 2 + q^T p subject to b - A p in the cones; A has no entries outside the pattern."""
        if self._warm is None:
            self._warm = self._set_up(P, q, A, b, *_WAYS[0])
        elif A is self._A:
            self._warm.update(P=P, q=q, b=b)
        else:
            self._warm.update(P=P, q=q, b=b, A=A.T[self.pattern.T])
        self._A = A
        solution = self._warm.solve()
        for way in _WAYS[1:]:
            if str(solution.status) in _GOOD:
                break
            solution = self._set_up(P, q, A, b, *way).solve()
        if str(solution.status) not in _GOOD:
            raise UntrustworthyError(f"{what} ended as '{solution.status}' in Clarabel.")
        return np.array(solution.x)

    def _set_up(self, P: Array, q: Array, A: Array, b: Array, equilibrate: bool, step: float, slack: float) -> Any:
        try:
            import clarabel
        except ImportError:
            raise InputError(
                "clarabel is not installed here, and it is needed where a compliance matrix must be held positive semidefinite."
            ) from None
        from scipy.sparse import csc_matrix

        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.presolve_enable = False
        settings.chordal_decomposition_enable = False
        settings.equilibrate_enable, settings.max_step_fraction = equilibrate, step
        settings.iterative_refinement_max_iter, settings.iterative_refinement_stop_ratio = 50, 1.5
        wanted, accepted = self.tolerances
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = slack * wanted
        settings.reduced_tol_gap_abs = settings.reduced_tol_gap_rel = settings.reduced_tol_feas = accepted
        kinds = {
            "zero": clarabel.ZeroConeT,
            "nonnegative": clarabel.NonnegativeConeT,
            "second-order": clarabel.SecondOrderConeT,
            "triangle": clarabel.PSDTriangleConeT,
        }
        K = [kinds[kind](size) for kind, size in self.cones]
        sparse, diagonal = csc_matrix(self.pattern.astype(float)), csc_matrix(np.eye(P.size))
        sparse.data, diagonal.data = A.T[self.pattern.T], P  # zeros among them keep their place for later values
        return clarabel.DefaultSolver(diagonal, q, sparse, b, K, settings)
