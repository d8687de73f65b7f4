"""Solid shapes for 3-D scenes as triangle meshes: tubes, arrows, and an arm made of them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm, forward
from drake_stiffness.rotations import Array

_SIDES = 10

Mesh = tuple[Array, NDArray[np.int_]]


def tube(start: Array, end: Array, radius: float, end_radius: float | None = None, sides: int = _SIDES) -> Mesh:
    """A cylinder (or cone, with `end_radius` 0) between two points, its ends closed: vertices (3, V) and faces (3, F)."""
    along = end - start
    length = float(np.linalg.norm(along))
    if length < 1e-12:
        return np.zeros((3, 0)), np.zeros((3, 0), dtype=int)
    z = along / length
    x = np.cross(z, np.eye(3)[int(np.abs(z).argmin())])
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.outer(x, np.cos(angle)) + np.outer(y, np.sin(angle))
    far = radius if end_radius is None else end_radius
    vertices = np.hstack([start[:, None] + radius * ring, end[:, None] + far * ring, start[:, None], end[:, None]])
    k = np.arange(sides)
    after, first, last = (k + 1) % sides, np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    walls = np.hstack([[k, after, k + sides], [after, after + sides, k + sides]])
    ends = np.hstack([[first, after, k], [last, k + sides, after + sides]])
    return vertices, np.hstack([walls, ends])


def arrow(start: Array, along: Array, radius: float) -> Mesh:
    """A shaft and a head."""
    neck = start + 0.75 * along
    return together([tube(start, neck, radius), tube(neck, start + along, 2.5 * radius, 0.0)])


def together(meshes: list[Mesh]) -> Mesh:
    """One mesh of several."""
    starts = np.cumsum([0, *(vertices.shape[1] for vertices, _ in meshes)])
    faces = [f + start for (_, f), start in zip(meshes, starts, strict=False)]
    empty = (np.zeros((3, 0)), np.zeros((3, 0), dtype=int))
    return np.hstack([empty[0], *(v for v, _ in meshes)]), np.hstack([empty[1], *faces])


def arm_solids(arm: Arm, q: Array, p_ET: Array) -> tuple[dict[str, Mesh], Array, float]:
    """Links, tool and joints of an arm at joints `q (n, 1)`, its spring frames in a row (n + 2, 3), and its size, m.

    Parameters
    ----------
    p_ET : (3,)
        The tool centre point in the flange frame.
    """
    poses = forward(arm, q)
    chain = np.stack([np.zeros(3), *(p[:, 0] for p in poses.p_F)])
    tip = poses.points(p_ET)[0][:, 0]
    size = max(float(np.ptp(chain, axis=0).max()), 1e-3)
    joints = [(p[:, 0], np.broadcast_to(axis, (3, 1))[:, 0]) for p, axis in zip(poses.p_J, poses.axis, strict=True)]
    solids = {
        "links": together([tube(a, b, 0.018 * size) for a, b in pairwise(chain)]),
        "tool": tube(chain[-1], tip, 0.01 * size),
        "joints": together([tube(p - 0.04 * size * a, p + 0.04 * size * a, 0.026 * size) for p, a in joints]),
    }
    return solids, chain, size
