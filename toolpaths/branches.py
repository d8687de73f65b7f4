"""Which of the arm's branches a path runs on: the one it starts in, unless the program itself says that it changes.

Programs name branches by status bits (KRL S, RAPID confdata, Fanuc CONFIG): shoulder, elbow and wrist. What a bit means depends
on where a maker puts the zero of each joint, and the model file need not put it there. So only *changes* are read: the posture
that the user gives decides what the first bits mean, and where a bit changes the arm is on the other side.
"""

from __future__ import annotations

from bisect import bisect_left

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm, forward

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_TURN = 2 * np.pi
# Rows looked at together while a column goes on, and after it was left.
_BLOCK, _SHORT = 4000, 32


def continuous(
    branches: Floats,
    start: Floats,
    lower: Floats,
    upper: Floats,
    sides: Bools | None = None,
    flips: Bools | None = None,
) -> Floats:
    """Row after row the branch nearest to the one before, turns chosen inside the limits where possible.

    Parameters
    ----------
    branches : (6, B, N)
        All solutions, NaN where there are fewer.
    start, lower, upper : (6,)
        Posture that picks the first branch, and limits.
    sides : (3, B, N), optional
        Of which side of shoulder, elbow and wrist each solution is; needed with `flips`.
    flips : (3, N), optional
        Where the program says that shoulder, elbow or wrist change sides.

    Returns
    -------
    (6, N) joint positions, NaN where there is no solution.
    """
    N = branches.shape[2]
    out = np.full((6, N), np.nan)
    rows = np.flatnonzero(~np.isnan(branches[0]).all(axis=0))
    if not rows.size:
        return out
    # A flip that falls on a row without solution is one of the next row that has one.
    turned = np.zeros((3, rows.size), dtype=bool)
    if flips is not None and flips.any():
        for row in np.flatnonzero(flips[:, : rows[-1] + 1].any(axis=0)).tolist():
            turned[:, np.searchsorted(rows, row)] ^= flips[:, row]
    given = branches[:, :, rows]
    first = _first(given[:, :, 0], start, lower, upper)
    chosen = _follow(given, first, None if sides is None else sides[:, :, rows], turned)
    picked = given[:, chosen, np.arange(rows.size)]
    step = np.diff(picked, axis=1)
    step -= _TURN * np.round(step / _TURN)
    whole = _inside(start + _wrapped(picked[:, 0] - start), lower, upper)
    out[:, rows] = np.cumsum(np.column_stack([whole, step]), axis=1)
    return out


def _first(candidates: Floats, start: Floats, lower: Floats, upper: Floats) -> int:
    """The solution (column) nearest to the start once its turns lie inside the limits."""
    near = start[:, None] + _wrapped(candidates - start[:, None])
    near = np.stack([_inside(column, lower, upper) for column in near.T], axis=1)
    return int(np.nanargmin(np.abs(near - start[:, None]).sum(axis=0)))


def _inside(q: Floats, lower: Floats, upper: Floats) -> Floats:
    """Whole turns taken off where nobody would start: beyond a limit, if the same posture exists within."""
    low, high = lower - 1e-9, upper + 1e-9
    q = np.where(q > high, q - _TURN * np.ceil((q - high) / _TURN), q)
    return np.where(q < low, q + _TURN * np.ceil((low - q) / _TURN), q)


def _follow(branches: Floats, first: int, sides: Bools | None, flips: Bools) -> NDArray[np.int_]:
    """Column of every row: each the nearest to the one before, on the other side where the program says so."""
    N = branches.shape[2]
    changes = [*np.flatnonzero(flips.any(axis=0)).tolist(), N]
    column = first if changes[0] else _across(branches[:, :, 0], branches[:, first, 0], sides, flips, 0, first)
    chosen = np.full(N, column)
    row, ahead = 1, _BLOCK
    while row < N:
        # A path seldom leaves its column, because eaik returns its solutions in one order: look how far it stays.
        change = changes[bisect_left(changes, row)]
        stop = min(row + ahead, change + 1, N)
        nearest = _nearest(branches, column, row, stop)
        stays = nearest == column
        stays[change - row :] = False
        left = nearest.size if stays.all() else int(stays.argmin())
        chosen[row : row + left] = column
        row, ahead = row + left, min(2 * ahead, _BLOCK)
        if row == stop:
            continue
        same = int(nearest[left])
        if row == change:
            same = _across(branches[:, :, row], branches[:, column, row - 1], sides, flips, row, same)
        chosen[row] = column = same
        row, ahead = row + 1, _SHORT
    return chosen


def _nearest(branches: Floats, column: int, begin: int, end: int) -> NDArray[np.int_]:
    """Of rows `begin` to `end` the column that is nearest to a given one of the row before."""
    before = branches[:, column, None, begin - 1 : end - 1]
    apart = np.abs(_wrapped(branches[:, :, begin:end] - before)).sum(axis=0)
    return np.asarray(np.nan_to_num(apart, nan=np.inf).argmin(axis=0))


def _across(candidates: Floats, before: Floats, sides: Bools | None, flips: Bools, row: int, same: int) -> int:
    """The nearest solution whose sides differ from those of the continuing one (column `same`) by the flips."""
    if sides is None:
        return same
    wanted = sides[:, same, row] ^ flips[:, row]
    distance = np.abs(_wrapped(candidates - before[:, None])).sum(axis=0)
    distance = np.where((sides[:, :, row] == wanted[:, None]).all(axis=0), distance, np.nan)
    return same if np.isnan(distance).all() else int(np.nanargmin(distance))


def _wrapped(angle: Floats) -> Floats:
    wrapped: Floats = angle - _TURN * np.round(angle / _TURN)
    return wrapped


def sides_of(arm: Arm, free: list[int], q: Floats) -> Bools:
    """Sides (3, N) of shoulder, elbow and wrist of postures (n, N): geometric, whatever the zeros of the joints are.

    Shoulder: whether the wrist's centre lies on one side of the plane through axis 1 and the direction of axis 2. Elbow: which
    way the arm is bent there. Wrist: on which side of the plane of axes 4 and 6 axis 5 points.
    """
    poses = forward(arm, q)
    z = [poses.axis[j] for j in free]
    p = [poses.p_J[j] for j in free]
    centre = p[4]
    forward_1 = np.cross(z[1], z[0], axis=0)
    shoulder = ((centre - p[0]) * forward_1).sum(axis=0) > 0
    elbow = (np.cross(p[2] - p[1], centre - p[2], axis=0) * z[1]).sum(axis=0) > 0
    wrist = (np.cross(z[3], z[5], axis=0) * z[4]).sum(axis=0) > 0
    return np.stack([shoulder, elbow, wrist])


def flips_along(status: NDArray[np.int32], rows: NDArray[np.int_]) -> Bools:
    """(3, N) where the status of corrected rows differs from what was last said before; rows of motions between count too."""
    known = np.zeros((len(status) + 1, 3), dtype=np.int32)
    for bit in range(3):
        said = np.flatnonzero(status[:, bit] >= 0)
        if not said.size:
            continue
        last = np.searchsorted(said, np.arange(len(status)), side="right") - 1
        known[:-1, bit] = status[said[np.maximum(last, 0)], bit]
    at = known[rows]
    flips = np.zeros((3, rows.size), dtype=bool)
    flips[:, 1:] = (at[1:] != at[:-1]).T
    return flips
