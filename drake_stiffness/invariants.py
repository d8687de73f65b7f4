"""How many combinations of compliances any measurement can show, from algebra alone: no posture, no robot (seed 3.3, 4.1).

The springs of two links that a joint connects act in the same place, and differ only in that one of them turns with the joint. A
compliance matrix X that the joint's motion does not change, Ad X Ad^T = X, may therefore stand on either side. Such X form a
linear space: the null space of the Lie derivative

    ad X + X ad^T = 0,      ad = the joint's own motion as a 6x6 matrix on (translation, rotation).

(Stiffness matrices obey ad^T X + X ad = 0, a space of the same dimension.) The joint's own spring is one of these X.

Let links 0 .. n with matrices X_0 .. X_n show nothing in any posture. Only X_0 does not move with joint 1, so X_0 must be unchanged by
it; it may then be added to X_1, and the sum must be unchanged by joint 2; and so on to the flange. So what cannot be told apart has
one dimension for every invariant matrix of every joint, whatever the lengths and angles between them, and

    rank = links * unknowns of a link - sum over joints of the dimension of their invariant matrices

for full wrenches and readings of the whole motion of the flange. For six revolute joints 7 * 21 - 6 * 7 = 105 and
7 * 36 - 6 * 12 = 180. For the beam template the same conditions have to be written down for the arm's own axes and lengths
(`chain_rank`): still no posture takes part.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm
from drake_stiffness.identifiability import numerical_rank
from drake_stiffness.right_angles import with_right_angles
from drake_stiffness.rotations import Array
from drake_stiffness.springs import Template, spring_template

Integers = NDArray[np.int_]


def motion(prismatic: bool, axis: NDArray[np.generic] | tuple[int, int, int] = (0, 0, 1)) -> NDArray[np.generic]:
    """The matrix ad of a unit motion about (revolute) or along (prismatic) an axis through the origin, (6, 6).

    It acts on (dx, dy, dz, rx, ry, rz). A rotation turns translations and rotations alike; a shift of the origin turns a rotation
    into a translation. Any other axis gives a similar matrix, hence the same dimensions.
    """
    turn = _cross_matrix(np.asarray(axis))
    nothing = np.zeros_like(turn)
    return np.block([[nothing, turn], [nothing, nothing]] if prismatic else [[turn, nothing], [nothing, turn]])


def _cross_matrix(a: NDArray[np.generic]) -> NDArray[np.generic]:
    """The matrix of a x ..., whole numbers staying whole."""
    return np.cross(np.eye(3, dtype=a.dtype), a)


@lru_cache
def _invariant_forms(prismatic: bool, template: Template) -> Integers:
    ad = motion(prismatic).astype(int)
    basis = spring_template(template).basis.astype(int)
    derivative = np.array([(ad @ X + X @ ad.T).ravel() for X in basis]).T
    return np.array([np.tensordot(values, basis, axes=1) for values in null_space(derivative)])


def invariant_forms(prismatic: bool, template: Template) -> Integers:
    """A basis of the 6x6 matrices that a joint's motion leaves unchanged, (dimension, 6, 6), exact.

    Parameters
    ----------
    prismatic : bool
        The joint moves along, not about, its axis.
    template : 'full' or 'symmetric'
        Which matrices are looked at: dimension 12 or 7 for a revolute joint, 20 or 11 for a prismatic one.
    """
    return _invariant_forms(bool(prismatic), template).copy()


def algebraic_rank(prismatic: Sequence[bool] | NDArray[np.bool_], template: Template) -> int | None:
    """Rank of the observation matrix under full wrenches, with the whole motion of the flange read, over all postures.

    Parameters
    ----------
    prismatic : (n,) bool
        One entry a joint.
    template : str
        None for 'beam': that rank depends on beam axes and lengths.

    Returns
    -------
    int or None
    """
    if template == "beam":
        return None
    unknowns = len(spring_template(template).entries)
    shared = sum(len(_invariant_forms(bool(kind), template)) for kind in prismatic)
    return (len(prismatic) + 1) * unknowns - shared


def unseen_conditions(arm: Arm, bases: Sequence[Array]) -> Array:
    """What compliances must satisfy to show nothing under any wrench in any posture, (conditions, unknowns).

    The conditions of the module's text for the arm's own axes and lengths: with Y_0 = X_0 + k_1 s_1 s_1^T, every joint must leave
    Y_i unchanged, Y_i moves on to the next link as Y_{i+1} = Ad Y_i Ad^T + X_{i+1} + k s s^T, and nothing is left at the flange.

    Parameters
    ----------
    arm : Arm
    bases : n + 1 arrays (unknowns, 6, 6)
        d compliance / d unknown of every link spring, base to flange, in its own frame (`SpringTemplate.basis`). Unknowns are
        counted joints first.
    """
    n = arm.num_joints
    sizes = [n, *(len(basis) for basis in bases)]
    starts = np.cumsum(sizes)
    Y = np.zeros((starts[-1], 6, 6))
    conditions = []
    for i, basis in enumerate(bases):
        if i:
            # A twist in the frame of the spring before, in that of this one (the joint at zero: any other place gives the same).
            R = arm.R_PF[i].T
            Ad = np.block([[R, -R @ _cross_matrix(arm.p_PF[i])], [np.zeros((3, 3)), R]])
            Y = Ad @ Y @ Ad.T
        Y[starts[i] : starts[i + 1]] += basis
        if i < n:
            axis = np.zeros(6)
            axis[:3] = arm.axis_F[i] if arm.prismatic[i] else 0.0
            axis[3:] = 0.0 if arm.prismatic[i] else arm.axis_F[i]
            Y[i] += np.outer(axis, axis)
            ad = motion(bool(arm.prismatic[i]), arm.axis_F[i])
            conditions.append((ad @ Y + Y @ ad.T).reshape(len(Y), 36))
    return np.hstack([*conditions, Y.reshape(len(Y), 36)]).T


def chain_rank(arm: Arm, bases: Sequence[Array]) -> tuple[int, float]:
    """Rank of the observation matrix under full wrenches, the whole motion of the flange read, without any posture.

    What satisfies all conditions is never seen, so their rank is that of the observation matrix.

    Parameters
    ----------
    arm, bases : see `unseen_conditions`

    Returns
    -------
    rank, gap
        The gap is that of the singular values around the rank.
    """
    conditions = unseen_conditions(with_right_angles(arm), bases)
    singular = np.linalg.svd(conditions / np.linalg.norm(conditions, axis=0), compute_uv=False)
    return numerical_rank(np.asarray(singular, dtype=float), coarse=False)


def blind_to_forces(template: Template) -> int:
    """How many unknowns of the last link no force through one point shows: its answers to moments about that point.

    The rank under pure forces is lower than `algebraic_rank` by at least as much (18 for 'full', 6 for 'symmetric'), by exactly as
    much at points in general position. Reading one place alone, instead of loading one alone, costs the same.
    """
    return int((spring_template(template).basis[:, :, :3] == 0).all(axis=(1, 2)).sum())


def null_space(matrix: Integers) -> Integers:
    """A basis of the null space of an integer matrix, (dimension, columns), in whole numbers: no rounding takes part."""
    rows = [[Fraction(int(entry)) for entry in row] for row in matrix]
    columns = matrix.shape[1]
    pivots: list[int] = []
    for column in range(columns):
        place = next((i for i in range(len(pivots), len(rows)) if rows[i][column]), None)
        if place is None:
            continue
        top = len(pivots)
        rows[top], rows[place] = rows[place], rows[top]
        lead = rows[top][column]
        rows[top] = [entry / lead for entry in rows[top]]
        for i, row in enumerate(rows):
            if i != top and row[column]:
                factor = row[column]
                rows[i] = [entry - factor * above for entry, above in zip(row, rows[top], strict=True)]
        pivots.append(column)
    basis = []
    for free in sorted(set(range(columns)) - set(pivots)):
        vector = [Fraction(0)] * columns
        vector[free] = Fraction(1)
        for i, pivot in enumerate(pivots):
            vector[pivot] = -rows[i][free]
        common = int(np.lcm.reduce([entry.denominator for entry in vector]))
        basis.append([int(entry * common) for entry in vector])
    return np.array(basis, dtype=int).reshape(len(basis), columns)
