"""How far a linear function may reach inside cones and bounds while the misfit stays near its least, by Clarabel directly.

min and max of c^T x    over all x in the cones with || F x - g ||^2 <= its minimum there + rise
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from drake_stiffness.intervals.cone_program import Block, ConeLeastSquares, Solver
from drake_stiffness.rotations import Array

# Tolerances wanted and accepted (see `cone_program`); extremes err by themselves, not by the root of them.
_TOLERANCES = (1e-9, 1e-6)
# Price of a squared unit along directions that F does not see, beside an objective of one: what is bounded moves by half of it
# times the squared departure.
_PRICE = 1e-7
# Clarabel balances gap and feasibility best where the objective is somewhat smaller than the unknowns.
_SIZE = 0.1
# Where that may matter the price is lowered by this factor; an extreme that then grows by more than this is none: nothing
# bounds it (it grows as the factor itself, or as its third root where only the rim of a cone curves away).
_CHEAPER, _GROWTH = 0.1, 1.5


class ConeRange(ConeLeastSquares):
    """Extremes of linear functions over { x in the cones and bounds : || F x - g ||^2 <= its minimum there + rise }.

    Parameters as of `ConeLeastSquares`. With x = x_min + B d the condition is || w d ||^2 + 2 a^T d <= rise, a the slope at the minimum: a
    second-order cone whose size does not grow with the misfit.
    """

    def __init__(
        self,
        F: Array,
        blocks: Sequence[Block],
        lower: Array | float | None = None,
        upper: Array | float | None = None,
    ) -> None:
        super().__init__(F, blocks, lower, upper)
        n, r = F.shape[1], self.rank
        # Directions that neither F nor any cone knows of: along them nothing has an extreme.
        self._loose = self.B[:, r:] @ _null_space(self._A[:, r:])
        self._misfit = self._along @ F
        one = np.ones((2, n))
        pattern, _, cones = self._with_ball(one, np.eye(r, n), np.zeros(r + 2))
        self._range = Solver(pattern != 0, cones, _TOLERANCES)

    def _with_ball(self, heads: Array, rest: Array, b: Array) -> tuple[Array, Array, list[tuple[str, int]]]:
        """Cones and the ball of the misfit together; the ball as a tower of small cones with unknowns of its own."""
        tower, offset, cones = _tower(np.vstack([heads, rest]), b)
        new = tower.shape[1] - self._A.shape[1]
        A = np.vstack([np.hstack([self._A, np.zeros((self._A.shape[0], new))]), tower])
        return A, offset, [*self.cones, *cones]

    def extreme(self, c: Array, g: Array, rise: float) -> tuple[float, float]:
        """Smallest and largest c^T x, infinite where nothing bounds it.

        Parameters
        ----------
        c : (n,)
        g : (m,)
        rise : float
            How far the squared residual may lie above its constrained minimum.
        """
        return self.extreme_from(self.solve(g), c, g, rise)

    def extreme_from(self, x: Array, c: Array, g: Array, rise: float) -> tuple[float, float]:
        """The same where x = solve(g) is at hand."""
        length = float(np.linalg.norm(c))
        if length == 0.0:
            return 0.0, 0.0
        if self._loose.size and np.abs(self._loose.T @ c).max() > 1e-9 * length:
            return -math.inf, math.inf
        r = self.rank
        departure = np.zeros(x.size)
        departure[:r] = self._misfit @ x - self._along @ g
        # || v ||^2 <= t  is  t + 1 >= |(t - 1, 2 v)|,  here with v = w d / sqrt(rise) and t = 1 - 2 a^T d / rise.
        slope = 2.0 * self.weight * departure / rise
        A, offset, _ = self._with_ball(
            np.stack([slope, slope]),
            -2.0 / math.sqrt(rise) * np.diag(self.weight)[:r],
            np.concatenate([[2.0, 0.0], np.zeros(r)]),
        )
        b = np.concatenate([self.G @ x + self.h, offset])
        along = self.B.T @ c
        # An objective of the size of one: what the ellipsoid alone would allow, or a unit of what is not seen.
        size = max(
            math.sqrt(rise) * float(np.linalg.norm(along[:r] / self.weight[:r])), float(np.linalg.norm(along[r:]))
        )
        along = along / size
        ends = []
        for sign in (1.0, -1.0):
            end = self._end(sign * along, A, b)
            ends.append(float(c @ x) + sign * end * size)
        return ends[0], ends[1]

    def _end(self, along: Array, A: Array, b: Array) -> float:
        """The least along^T d, minus infinity where nothing bounds it."""
        n, r = along.size, self.rank
        q, P = np.zeros(A.shape[1]), np.zeros(A.shape[1])
        q[:n] = _SIZE * along
        values = []
        for price in (_PRICE, _PRICE * _CHEAPER):
            P[r:n] = _SIZE * price
            d = self._range.run(P, q, A, b, "an extreme of a linear function")[:n]
            values.append(float(along @ d))
            if price * float(d[r:] @ d[r:]) <= 1e-5 * abs(values[-1]):
                return values[-1]
        return -math.inf if values[1] < _GROWTH * values[0] else values[1]


def _tower(A: Array, b: Array) -> tuple[Array, Array, list[tuple[str, int]]]:
    """One second-order cone s_0 >= |(s_1, s_2, ...)|, s = b - A x, as a chain of cones of at most four entries.

    Every link passes its length on, t_1 >= |(s_1, s_2)|, t_2 >= |(t_1, s_3, s_4)| and so on up to s_0. Clarabel keeps a large cone
    as a matrix of low rank, and rounding then stops it short far more often.

    Parameters
    ----------
    A, b : (m, n), (m,)

    Returns
    -------
    A, b, cones
        With one more column for every t.
    """
    m, n = A.shape
    pairs = [range(i, min(i + 2, m)) for i in range(1, m, 2)]
    new = len(pairs) - 1
    wide = np.hstack([A, np.zeros((m, new))])
    lengths = np.hstack([np.zeros((new, n)), -np.eye(new)])
    rows, offset, cones = [], [], []
    for i, pair in enumerate(pairs):
        head, start = (lengths[i], 0.0) if i < new else (wide[0], b[0])
        own = [head, *([lengths[i - 1]] if i else []), *(wide[j] for j in pair)]
        rows += own
        offset += [start, *([0.0] if i else []), *(b[j] for j in pair)]
        cones.append(("second-order", len(own)))
    return np.array(rows), np.array(offset), cones


def _null_space(M: Array) -> Array:
    """Orthonormal directions that M maps to nothing, (n, k); rows of M are scaled alike."""
    length = np.linalg.norm(M, axis=1)
    live = M[length > 0] / length[length > 0][:, None]
    if not live.size:
        return np.eye(M.shape[1])
    _, s, Vt = np.linalg.svd(live, full_matrices=True)
    return np.asarray(Vt[int((s > 1e-10).sum()) :].T)
