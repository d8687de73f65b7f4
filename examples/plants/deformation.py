"""What a deformed arm is: its shape in the world, and the deflections of its springs or what they carry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .beams import Array


@dataclass(frozen=True)
class Shape:
    """A deformed arm at N postures: everything that statics asks of the geometry. World axes, m.

    Flange pose `R`, `p`; per element (L, S) the node's displaced position `node_p`, the axes of its displacements
    `node_R` and of its rotations `node_A` as columns, its centre of mass `mass_p`; per joint (n) origin `joint_p` and
    axis `joint_a`.
    """

    R: Array
    p: Array
    node_p: Array
    node_R: Array
    node_A: Array
    mass_p: Array
    joint_p: Array
    joint_a: Array


@dataclass(frozen=True)
class Deformation:
    """Deflections at N postures: elements (L, S, N, 6) as (dx, dy, dz, rx, ry, rz), joints (n, N). m and rad."""

    elements: Array
    joints: Array


def sum_beyond(values: Array) -> Array:
    """Exclusive sums over all later entries of the first axis."""
    total = np.cumsum(values[::-1], axis=0)[::-1]
    return total - values


def turn_xyz(angles: Array) -> tuple[Array, Array]:
    """Rx(a) Ry(b) Rz(c) for angles (N, 3), and as columns the axes of a, b, c in the frame before the turn."""
    ca, cb, cc = np.cos(angles).T
    sa, sb, sc = np.sin(angles).T
    turn = np.empty((len(angles), 3, 3))
    turn[:, 0] = np.stack([cb * cc, -cb * sc, sb], -1)
    turn[:, 1] = np.stack([ca * sc + sa * sb * cc, ca * cc - sa * sb * sc, -sa * cb], -1)
    turn[:, 2] = np.stack([sa * sc - ca * sb * cc, sa * cc + ca * sb * sc, ca * cb], -1)
    axes = np.zeros((len(angles), 3, 3))
    axes[:, 0, 0] = 1.0
    axes[:, 1, 1], axes[:, 2, 1] = ca, sa
    axes[:, :, 2] = turn[:, :, 2]
    return turn, axes
