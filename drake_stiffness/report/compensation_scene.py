"""A corrected program as a scene to turn and zoom: the arm over its path, Drake's Meshcat as one static page (2 to 3 MB)."""

from __future__ import annotations

import json
from html import escape
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError
from drake_stiffness.report.solids import Mesh, arm_solids, arrow, together, tube
from drake_stiffness.rotations import Array

if TYPE_CHECKING:
    from drake_stiffness.model import Model
    from toolpaths.result import Compensation

_STEEL, _TOOL, _JOINT, _ARROW = (0.45, 0.5, 0.56), (0.9, 0.62, 0.0), (0.1, 0.12, 0.14), (0.55, 0.15, 0.5)
_WANTED = (0.55, 0.6, 0.66)
# From nothing (blue) to the largest deviation (red): Okabe and Ito's colours.
_SCALE = np.array([[0.0, 0.45, 0.7], [0.0, 0.62, 0.45], [0.94, 0.89, 0.26], [0.84, 0.37, 0.0]])
_STEPS, _ARROWS = 800, 60
# Where the viewer stands, seen from what is looked at.
_FROM = np.array([0.6, -0.9, 0.6])
# Meshcat's camera lives in a frame whose y points up.
_LOOK = """<script>
function look(at) {
  const up = (p) => [p[0], p[2], -p[1]];
  const path = "/Cameras/default/rotated/<object>";
  viewer.handle_command({type: "set_property", path: path, property: "position", value: up(views[at][0])});
  viewer.handle_command({type: "set_target", value: up(views[at][1])});
  // From near by the arm, drawn for its own size, would hide the path.
  viewer.handle_command({type: "set_property", path: "/arm", property: "visible", value: at == "arm"});
}
// The scene itself arrives a little after the page, and places the viewer anew.
addEventListener("load", () => setTimeout(() => { if (location.hash.slice(1) in views) look(location.hash.slice(1)); }, 1000));
</script>"""


def scene_html(result: Compensation, model: Model) -> str:
    """The arm at the point of largest deflection; the path as it would be cut without and with correction, deviations magnified and
    coloured by their size; the corrections as arrows.

    Returns
    -------
    str
        A self-contained page.

    Raises
    ------
    InputError
        If Drake is not installed: its Meshcat makes the page.
    """
    try:
        from drake_stiffness.plant import start_viewer

        viewer = start_viewer()
    except ImportError:
        raise InputError(
            "--scene: Drake is not installed here, and its Meshcat makes the scene. Leave --scene out; everything else needs no Drake."
        ) from None
    path, R_WB = result.path, result.process.base[0]
    wanted, worst = path.p, int(result.before_mm.argmax())
    before = result.deflection_mm * 1e-3
    after = result.account.interval.residual_mm * 1e-3
    correction = result.correction_mm * 1e-3 @ R_WB.T
    extent = max(float(np.ptp(wanted, axis=0).max()), 0.05)
    largest = float(result.before_mm.max(initial=0.0)) * 1e-3
    factor = _round_down(0.1 * extent / largest) if largest > 0 else 1.0
    solids, chain, size = arm_solids(model.arm, path.postures.q[:, [worst]], model.tcp[1])
    for part, colour in (("links", _STEEL), ("tool", _TOOL), ("joints", _JOINT)):
        _plain(viewer, f"/arm/{part}", solids[part], colour)
    new_cut = np.isnan(result.account.evenness.spacing_mm)
    radius = min(0.002 * size, 0.004 * extent)
    _plain(viewer, "/path/wanted", _line(wanted, new_cut, 0.5 * radius)[0], _WANTED)
    for name, moved, value in (("uncorrected", before, result.before_mm), ("corrected", after, result.after_mm)):
        mesh, point = _line(wanted + factor * moved, new_cut, radius)
        colours = _colours(value[point] / max(largest * 1e3, 1e-12))
        viewer.SetTriangleColorMesh(f"/path/{name}", *mesh, colours)
    some = np.unique(np.linspace(0, wanted.shape[0] - 1, min(_ARROWS, wanted.shape[0])).astype(int))
    arrows = [arrow(wanted[i], factor * correction[i], radius) for i in some if np.linalg.norm(correction[i]) > 0]
    _plain(viewer, "/correction", together(arrows), _ARROW)
    # Near enough to see the path, far enough to see the arm over it.
    centre = (wanted.max(axis=0) + wanted.min(axis=0)) / 2
    middle = 0.5 * wanted.mean(axis=0) + 0.5 * (chain.max(axis=0) + chain.min(axis=0)) / 2
    views = {"arm": (middle + (0.65 * size + extent) * _FROM, middle), "path": (centre + 1.1 * extent * _FROM, centre)}
    viewer.SetCameraPose(*views["arm"])
    viewer.SetProperty("/Axes", "visible", False)
    for end in ("top_color", "bottom_color"):
        viewer.SetProperty("/Background", end, [0.96, 0.97, 0.98])
    return _with_legend(str(viewer.StaticHtml()), result, factor, views)


def _plain(viewer: object, name: str, mesh: Mesh, colour: tuple[float, float, float]) -> None:
    vertices, faces = mesh
    if faces.size:
        colours = np.tile(np.array(colour)[:, None], vertices.shape[1])
        viewer.SetTriangleColorMesh(name, vertices, faces, colours)  # type: ignore[attr-defined]


def _line(p: Array, new_cut: NDArray[np.bool_], radius: float) -> tuple[Mesh, NDArray[np.int_]]:
    """Tubes from point to point, thinned where there are very many, and the point that every vertex belongs to."""
    stride = max(1, -(-p.shape[0] // _STEPS))
    cut = np.cumsum(new_cut)
    kept = np.unique(np.append(np.arange(0, p.shape[0], stride), np.flatnonzero(new_cut)))
    meshes, points = [], []
    for a, b in zip(kept[:-1].tolist(), kept[1:].tolist(), strict=True):
        if cut[a] != cut[b]:
            continue
        mesh = tube(p[a], p[b], radius, sides=6)
        meshes.append(mesh)
        points += [np.array([a] * 6 + [b] * 6 + [a, b])] if mesh[0].shape[1] else []
    return together(meshes), np.concatenate(points) if points else np.zeros(0, dtype=int)


def _colours(share: Array) -> Array:
    """(3, V) colours of shares of the largest deviation."""
    at = np.linspace(0, 1, len(_SCALE))
    return np.stack([np.interp(np.clip(share, 0, 1), at, _SCALE[:, c]) for c in range(3)])


def _round_down(factor: float) -> float:
    power = 10.0 ** np.floor(np.log10(factor))
    return float(power * max(k for k in (1.0, 2.0, 5.0) if k * power <= factor * (1 + 1e-9)))


def _with_legend(page: str, result: Compensation, factor: float, views: dict[str, tuple[Array, Array]]) -> str:
    """The page with a title, a legend over the picture, and buttons to look at arm or path (also ``#path`` behind its address)."""
    name = escape(PurePath(result.program.path).name)
    stops = ", ".join(f"rgb({', '.join(f'{255 * v:.0f}' for v in colour)})" for colour in _SCALE)
    largest = float(result.before_mm.max(initial=0.0))
    legend = (
        '<div style="position:fixed;left:14px;top:12px;font:14px/1.45 system-ui,sans-serif;color:#1b1f24;background:#ffffffd8;'
        'padding:10px 14px;border-radius:6px;max-width:330px;z-index:9"><b>'
        f"{name}</b><br>Deviations and corrections {factor:g} times as large as they are. Grey: wanted. Coloured tubes: cut without and "
        "with correction. Arrows: what the program is moved by."
        f'<div style="height:12px;margin:6px 0 2px;background:linear-gradient(90deg,{stops})"></div>'
        f'<span>0</span><span style="float:right">{largest:.3g} mm</span><br>predicted deviation: mean {result.before_mm.mean():.3g} mm '
        f"without, {result.after_mm.mean():.2g} mm with correction<br>Look at "
        + " ".join(f"<button onclick=\"look('{name}')\">the {name}</button>" for name in views)
        + ", drag to turn, wheel to zoom</div>"
    )
    places = {name: [np.round(end, 4).tolist() for end in ends] for name, ends in views.items()}
    legend += f"<script>const views = {json.dumps(places)};</script>{_LOOK}"
    page = page.replace("<title>Drake MeshCat</title>", f"<title>Compensation of {name}</title>")
    return page.replace("<body>", f"<body>{legend}", 1)
