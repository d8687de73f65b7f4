"""The information matrices of many candidates, packed: sums over plans and inner products with a dual are one product each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.rotations import Array

# Candidates whose full matrices are held at once while packing.
_CHUNK = 500


@dataclass(frozen=True, eq=False)
class Information:
    """Symmetric matrices F_i (r, r) of N candidates, and M_0 of what is measured already.

    Attributes
    ----------
    packed : (N, r (r + 1) / 2)
        Upper triangles, row by row.
    start : (r, r)
        M_0; zeros where nothing is measured.
    """

    packed: Array
    start: Array

    @property
    def number(self) -> int:
        return self.packed.shape[0]

    @property
    def size(self) -> int:
        return self.start.shape[0]

    def of(self, which: NDArray[np.int_] | int) -> Array:
        """F of one candidate (r, r) or of several (k, r, r)."""
        return _unpacked(self.packed[which], self.size)

    def total(self, x: Array) -> Array:
        """M_0 + sum x_i F_i."""
        return self.start + _unpacked(x @ self.packed, self.size)

    def plan(self, chosen: NDArray[np.int_] | list[int]) -> Array:
        """M_0 plus the F of the chosen candidates."""
        return self.start + _unpacked(self.packed[chosen].sum(axis=0), self.size)

    def ridge(self, n: int) -> Array:
        """A trace of the mean plan of n, so that plans of too few postures are nearly singular instead of singular."""
        return 1e-9 * (self.total(np.full(self.number, n / self.number)))

    def inner(self, Z: Array) -> Array:
        """<Z, F_i> of all candidates, (N,), for a symmetric Z."""
        i, j = np.triu_indices(self.size)
        return np.asarray(self.packed @ np.where(i == j, Z[i, j], 2 * Z[i, j]))


def gather(rows: Array, basis: Array, start: Array) -> Information:
    """Information along some directions from whitened rows.

    Parameters
    ----------
    rows : (N, m, n)
    basis : (n, r)
        Directions in the space of parameters.
    start : (r, r)
    """
    i, j = np.triu_indices(basis.shape[1])
    packed = np.empty((rows.shape[0], i.size))
    for first in range(0, rows.shape[0], _CHUNK):
        B = rows[first : first + _CHUNK] @ basis
        packed[first : first + _CHUNK] = (B.transpose(0, 2, 1) @ B)[:, i, j]
    return Information(packed, start)


def _unpacked(packed: Array, size: int) -> Array:
    i, j = np.triu_indices(size)
    full = np.empty((*packed.shape[:-1], size, size))
    full[..., i, j] = packed
    full[..., j, i] = packed
    return full
