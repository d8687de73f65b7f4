r"""The arm does not come back exactly: what that does to the readings, and how they are whitened with it.

A robot that is driven to a posture stands there with small random joint errors :math:`\delta`, alike in all joints,
:math:`\delta \sim N(0, s^2 I)`. All points of a step then share one small rigid motion of the flange, so their
readings are not independent:

.. math:: V = \sigma^2 I + s^2 J J^T

with J the Jacobian of all readings of one approach in the joints. Users state not s but what it does on average, the
standard deviation of one coordinate of a reflector over the campaign's postures. (A data sheet's repeatability is a
three-dimensional length: divide by the square root of three.)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm, forward, joint_jacobian
from drake_stiffness.campaign import Measurements
from drake_stiffness.cell import Vector3
from drake_stiffness.rotations import Array, rotate

Approach = Literal["per_experiment", "per_step"]


@dataclass(frozen=True, eq=False)
class PostureNoise:
    """Random joint errors, drawn anew for every experiment or for every step.

    Attributes
    ----------
    joint_sigma : float
        Standard deviation of every joint, rad (m if prismatic).
    approach : 'per_experiment' or 'per_step'
        Whether the arm stands still between the load steps of an experiment or is driven there again for each.
    arm : Arm
    points : reference points in the flange frame, m
    """

    joint_sigma: float
    approach: Approach
    arm: Arm
    points: Mapping[str, Vector3]

    def spread(self, m: Measurements) -> Array:
        """(M, 6, n) motion of every reading's point and of the flange for one standard deviation of every joint."""
        return motions(self.arm, self.points, m) * self.joint_sigma

    def blocks(self, m: Measurements) -> NDArray[np.int_]:
        """(M,) readings of one number share their joint errors."""
        return m.case if self.approach == "per_step" else m.cases.experiment[m.case]


def posture_noise(
    sigma_m: float, approach: Approach, arm: Arm, points: Mapping[str, Vector3], m: Measurements
) -> PostureNoise:
    """From the standard deviation of a coordinate, averaged over a campaign's readings, to that of the joints."""
    return PostureNoise(sigma_m / lever(arm, points, m), approach, arm, points)


def lever(arm: Arm, points: Mapping[str, Vector3], m: Measurements) -> float:
    """Root mean square over readings and coordinates of what a unit of every joint's error does, m/rad."""
    J = motions(arm, points, m)[:, :3]
    return float(np.sqrt((J**2).sum() / (3 * len(J))))


def motions(arm: Arm, points: Mapping[str, Vector3], m: Measurements) -> Array:
    """(M, 6, n) Jacobian of every reading's point (rows 0-2) and of the flange's orientation (3-5) in the joints."""
    poses = forward(arm, m.cases.q[:, m.case])
    p_EP = np.array([points[str(name)] for name in m.point], dtype=float).T
    return joint_jacobian(arm, poses, poses.p_E + rotate(poses.R_E, p_EP)).transpose(2, 1, 0)


@dataclass(frozen=True, eq=False)
class Whitening:
    r"""Rows made independent, then freed of their references.

    Rows of one block get :math:`V^{-1/2} = I - U (1 - (1 + s^2)^{-1/2}) U^T` with U s the singular vectors and values
    of the block's common motion in units of the rows' own noise. Free references (the unloaded position of a point)
    are constant columns before this, and are eliminated after it by projection; both never mix experiments.

    Attributes
    ----------
    blocks : list of (rows (B, m), U (B, m, k), factor (B, k)), blocks of one size together
    references : list of (rows (E, m), Q (E, m, r)), experiments of one size together
    """

    blocks: list[tuple[NDArray[np.int_], Array, Array]]
    references: list[tuple[NDArray[np.int_], Array]]

    def apply(self, columns: Array) -> Array:
        """Whitened and freed of references: (rows, n)."""
        out = self.white(columns)
        for rows, Q in self.references:
            part = out[rows]
            out[rows] = part - Q @ (Q.transpose(0, 2, 1) @ part)
        return out

    def white(self, columns: Array) -> Array:
        """Whitened only."""
        out = columns.copy()
        for rows, U, factor in self.blocks:
            part = columns[rows]
            out[rows] = part - U @ (factor[:, :, None] * (U.transpose(0, 2, 1) @ part))
        return out

    def reference_share(self, own: NDArray[np.int_]) -> Array:
        """What eliminating references takes off the identity between some rows, (len(own), len(own))."""
        share = np.zeros((own.size, own.size))
        for rows, Q in self.references:
            place = {int(row): (e, i) for e, line in enumerate(rows) for i, row in enumerate(line)}
            inside = [k for k, row in enumerate(own.tolist()) if row in place]
            for e in {place[int(own[k])][0] for k in inside}:
                mine = [k for k in inside if place[int(own[k])][0] == e]
                part = Q[e, [place[int(own[k])][1] for k in mine]]
                share[np.ix_(mine, mine)] = part @ part.T
        return share


def make_whitening(
    spread: Array, block: NDArray[np.int_], experiment: NDArray[np.int_], reference: NDArray[np.int_]
) -> Whitening:
    """Factors of every block and reference.

    Parameters
    ----------
    spread : (rows, n)
        Common motion of every scalar row for one standard deviation of every joint, in units of the row's own noise.
    block, experiment : (rows,) numbers
    reference : (rows,)
        Number of the free reference a row is measured from; -1 for none.
    """
    blocks = []
    for rows in _same_size(block):
        U, s, _ = np.linalg.svd(spread[rows], full_matrices=False)
        blocks.append((rows, U, 1.0 - 1.0 / np.sqrt(1.0 + s**2)))
    whitening = Whitening(blocks, [])
    if (reference < 0).all():
        return whitening
    references = []
    for rows in _same_size(experiment, tie=_count_of_references(experiment, reference)):
        local = np.array([_numbered(reference[line]) for line in rows])
        if local.max() < 0:
            continue
        indicator = np.zeros((reference.size, int(local.max()) + 1))
        used = local >= 0
        indicator[rows[used], local[used]] = 1.0
        references.append((rows, np.linalg.qr(whitening.white(indicator)[rows])[0]))
    return Whitening(blocks, references)


def _numbered(reference: NDArray[np.int_]) -> NDArray[np.int_]:
    """References of one experiment counted from 0; -1 stays."""
    present = np.unique(reference[reference >= 0])
    return np.where(reference >= 0, np.searchsorted(present, reference), -1)


def _count_of_references(experiment: NDArray[np.int_], reference: NDArray[np.int_]) -> NDArray[np.int_]:
    """(rows,) how many references the row's experiment has."""
    pairs = np.unique(np.column_stack([experiment, reference])[reference >= 0], axis=0)
    return np.bincount(pairs[:, 0], minlength=int(experiment.max()) + 1)[experiment]


def _same_size(block: NDArray[np.int_], tie: NDArray[np.int_] | None = None) -> list[NDArray[np.int_]]:
    """Rows of every block, blocks of one size (and one `tie`) stacked: list of (B, m)."""
    order = np.argsort(block, kind="stable")
    starts = np.flatnonzero(np.diff(block[order], prepend=-1))
    groups: dict[tuple[int, int], list[NDArray[np.int_]]] = {}
    for rows in np.split(order, starts[1:]):
        groups.setdefault((rows.size, 0 if tie is None else int(tie[rows[0]])), []).append(rows)
    return [np.array(members) for members in groups.values()]
