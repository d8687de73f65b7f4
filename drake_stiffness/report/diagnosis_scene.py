"""The arm with its residuals as a scene to turn and zoom: Drake's Meshcat as one static page (about 2 MB)."""

from __future__ import annotations

import numpy as np

from drake_stiffness.diagnosis.diagnosis import Diagnosis
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations
from drake_stiffness.plant import start_viewer
from drake_stiffness.report.diagnosis_arm import residual_arrows
from drake_stiffness.report.solids import Mesh, arm_solids, arrow, together

_STEEL, _TOOL, _JOINT = (0.45, 0.5, 0.56), (0.9, 0.62, 0.0), (0.1, 0.12, 0.14)
_BEFORE, _AFTER = (0.84, 0.37, 0.0), (0.0, 0.45, 0.7)


def scene_html(d: Diagnosis) -> str:
    """The scene of a diagnosis, see `scene_between`."""
    return scene_between(d.search.base.model, d.search.solution.model, d.observations)


def scene_between(before: Model, after: Model, o: Observations) -> str:
    """The arm in the experiment that fits worst, residuals before (orange) and after (blue) as arrows; parts can be hidden.

    Returns
    -------
    str
        A self-contained page.
    """
    found = residual_arrows(before, after, o)
    solids, chain, size = arm_solids(after.arm, found.q, after.tcp[1])
    viewer = start_viewer()

    def add(name: str, meshes: list[Mesh], colour: tuple[float, float, float]) -> None:
        vertices, faces = together(meshes)
        if faces.size:
            viewer.SetTriangleColorMesh(name, vertices, faces, np.tile(np.array(colour)[:, None], vertices.shape[1]))

    for part, colour in (("links", _STEEL), ("tool", _TOOL), ("joints", _JOINT)):
        add(f"/arm/{part}", [solids[part]], colour)
    others = found.worst_steps & ~found.of_worst
    for name, arrows, colour in (("before", found.before, _BEFORE), ("after", found.after, _AFTER)):
        for place, mine in ((f"experiment {found.experiment}", found.of_worst), ("worst step of the others", others)):
            pairs = zip(found.p[:, mine].T, arrows[:, mine].T, strict=True)
            add(f"/{name}/{place}", [arrow(p, v, 0.0035 * size) for p, v in pairs], colour)
    middle = (chain.max(axis=0) + chain.min(axis=0)) / 2
    viewer.SetCameraPose(middle + size * np.array([1.0, -1.8, 0.9]), middle)
    viewer.SetProperty("/Axes", "visible", False)
    for end in ("top_color", "bottom_color"):
        viewer.SetProperty("/Background", end, [0.96, 0.97, 0.98])
    title = f"Residuals {found.magnified:g} times magnified: orange before, blue after"
    return str(viewer.StaticHtml()).replace("<title>Drake MeshCat</title>", f"<title>{title}</title>")
