"""The arm with its residuals as a scene to turn and zoom: Drake's Meshcat as one static page (about 2 MB)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import forward
from drake_stiffness.diagnosis.diagnosis import Diagnosis
from drake_stiffness.plant import start_viewer
from drake_stiffness.report.diagnosis_arm import residual_arrows
from drake_stiffness.rotations import Array

_SIDES = 10
_STEEL, _TOOL, _JOINT = (0.45, 0.5, 0.56), (0.9, 0.62, 0.0), (0.1, 0.12, 0.14)
_BEFORE, _AFTER = (0.84, 0.37, 0.0), (0.0, 0.45, 0.7)

Mesh = tuple[Array, NDArray[np.int_]]


def scene_html(d: Diagnosis) -> str:
    """The arm in the experiment that fits worst, residuals before (orange) and after (blue) as arrows; parts can be hidden.

    Returns
    -------
    str
        A self-contained page.
    """
    model = d.search.solution.model
    found = residual_arrows(d.search.base.model, model, d.observations)
    poses = forward(model.arm, found.q)
    chain = np.stack([np.zeros(3), *(p[:, 0] for p in poses.p_F)])
    tool = poses.points(model.tcp[0])[0][:, 0]
    size = max(float(np.ptp(chain, axis=0).max()), 1e-3)
    viewer = start_viewer()

    def add(name: str, meshes: list[Mesh], colour: tuple[float, float, float]) -> None:
        vertices, faces = _together(meshes)
        if faces.size:
            viewer.SetTriangleColorMesh(name, vertices, faces, np.tile(np.array(colour)[:, None], vertices.shape[1]))

    add("/arm/links", [_tube(a, b, 0.018 * size) for a, b in pairwise(chain)], _STEEL)
    add("/arm/tool", [_tube(chain[-1], tool, 0.01 * size)], _TOOL)
    joints = [(p[:, 0], np.broadcast_to(axis, (3, 1))[:, 0]) for p, axis in zip(poses.p_J, poses.axis, strict=True)]
    add("/arm/joints", [_tube(p - 0.04 * size * a, p + 0.04 * size * a, 0.026 * size) for p, a in joints], _JOINT)
    others = found.worst_steps & ~found.of_worst
    for name, arrows, colour in (("before", found.before, _BEFORE), ("after", found.after, _AFTER)):
        for place, mine in ((f"experiment {found.experiment}", found.of_worst), ("worst step of the others", others)):
            pairs = zip(found.p[:, mine].T, arrows[:, mine].T, strict=True)
            add(f"/{name}/{place}", [_arrow(p, v, 0.0035 * size) for p, v in pairs], colour)
    middle = (chain.max(axis=0) + chain.min(axis=0)) / 2
    viewer.SetCameraPose(middle + size * np.array([1.0, -1.8, 0.9]), middle)
    viewer.SetProperty("/Axes", "visible", False)
    for end in ("top_color", "bottom_color"):
        viewer.SetProperty("/Background", end, [0.96, 0.97, 0.98])
    title = f"Residuals {found.magnified:g} times magnified: orange before, blue after"
    return str(viewer.StaticHtml()).replace("<title>Drake MeshCat</title>", f"<title>{title}</title>")


def _arrow(start: Array, along: Array, radius: float) -> Mesh:
    """A shaft and a head."""
    neck = start + 0.75 * along
    return _together([_tube(start, neck, radius), _tube(neck, start + along, 2.5 * radius, 0.0)])


def _tube(start: Array, end: Array, radius: float, end_radius: float | None = None) -> Mesh:
    """A cylinder (or cone, with `end_radius` 0) between two points, its ends closed."""
    along = end - start
    length = float(np.linalg.norm(along))
    if length < 1e-12:
        return np.zeros((3, 0)), np.zeros((3, 0), dtype=int)
    z = along / length
    x = np.cross(z, np.eye(3)[int(np.abs(z).argmin())])
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    ring = np.outer(x, np.cos(angle)) + np.outer(y, np.sin(angle))
    far = radius if end_radius is None else end_radius
    vertices = np.hstack([start[:, None] + radius * ring, end[:, None] + far * ring, start[:, None], end[:, None]])
    k = np.arange(_SIDES)
    after, first, last = (k + 1) % _SIDES, np.full(_SIDES, 2 * _SIDES), np.full(_SIDES, 2 * _SIDES + 1)
    sides = np.hstack([[k, after, k + _SIDES], [after, after + _SIDES, k + _SIDES]])
    ends = np.hstack([[first, after, k], [last, k + _SIDES, after + _SIDES]])
    return vertices, np.hstack([sides, ends])


def _together(meshes: list[Mesh]) -> Mesh:
    """One mesh of several."""
    starts = np.cumsum([0, *(vertices.shape[1] for vertices, _ in meshes)])
    faces = [f + start for (_, f), start in zip(meshes, starts, strict=False)]
    empty = (np.zeros((3, 0)), np.zeros((3, 0), dtype=int))
    return np.hstack([empty[0], *(v for v, _ in meshes)]), np.hstack([empty[1], *faces])
