"""Where identification starts: rigid springs, nominal geometry, and a tracker frame found from the positions themselves."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from drake_stiffness.arm import forward
from drake_stiffness.campaign import Measurements
from drake_stiffness.effects.compliance import JointCompliance
from drake_stiffness.effects.instruments import TrackerFrame
from drake_stiffness.model import Model
from drake_stiffness.rotations import Array, logarithm, rotate
from drake_stiffness.structure import acts_on_joints

log = logging.getLogger("drake_stiffness")

# An arm bends by millimetres; readings farther off than this are in another frame or of another arm.
_PLAUSIBLE_M = 0.1
# Share of its scale at which such a joint starts: an industrial joint's compliance, where hardware raised the scale.
_TYPICAL = 0.1
_KEPT = 0.5


def starting_model(model: Model, measurements: Measurements) -> Model:
    """The model with its tracker frame, if it has one, placed so that nominal points fall on measured ones.

    Displacements alone show no position; the frame then starts parallel to the world.
    """
    places = [i for i, effect in enumerate(model.effects) if isinstance(effect, TrackerFrame)]
    if not places:
        return model
    if measurements.relative or measurements.position is None:
        log.info("the tracker frame starts parallel to the world: displacements do not show where it stands")
        return model
    m, position = measurements, measurements.position
    poses = forward(model.arm, m.cases.q)
    p_W = poses.p_E[:, m.case] + rotate(poses.R_E[:, :, m.case], model.point_positions(m.point))
    x = model.x.copy()
    x[model.slices[places[0]]] = fitted_frame(p_W, position.T)
    return model.with_x(x)


def with_something_to_turn(model: Model, bent: Model) -> Model:
    """The model with every joint that hardware acts on started at its value in `bent`, or at a typical one.

    A torque on a rigid joint moves nothing, so a gravity compensator would not be seen from there; on a joint far too stiff it
    would seem to be far too strong. What readings of weight alone say of the joint is in the model's own start, if it has one.
    """
    share, x = _shares(bent), model.x.copy()
    for effect, own in _turned(model):
        x[own] = max(share[effect.where] or float(x[own][0]), _TYPICAL * effect.scale)
    return model.with_x(x)


def with_joints_held(model: Model, bent: Model) -> Model:
    """The model with every joint that hardware acts on started at its value in `bent`, and kept above half of it.

    Which of a joint and its neighbours gives way is open in the linear theory, and a semidefinite program that follows that may
    leave the joint rigid, with its hardware nothing to act on. Least squares, which has no cone, has found the joint's share.
    """
    share, effects, x = _shares(bent), list(model.effects), model.x.copy()
    for effect, own in _turned(model):
        if share[effect.where] > 0.0:
            effects[effects.index(effect)] = effect.kept_above(_KEPT * share[effect.where])
            x[own] = share[effect.where]
    return replace(model, effects=tuple(effects), x=x, statistics=None)


def _turned(model: Model) -> list[tuple[JointCompliance, slice]]:
    """The springs of joints that hardware acts on."""
    hardware = {effect.where for effect in model.effects if acts_on_joints(effect)}
    both = zip(model.effects, model.slices, strict=True)
    return [(e, own) for e, own in both if isinstance(e, JointCompliance) and e.where in hardware]


def _shares(model: Model) -> dict[str, float]:
    """Compliance of every joint that has a spring."""
    both = zip(model.effects, model.values, strict=True)
    return {e.where: float(x[0]) for e, x in both if isinstance(e, JointCompliance)}


def fitted_frame(p_W: Array, p_T: Array) -> Array:
    """Pose (dx, dy, dz, rx, ry, rz) of frame T in W that carries points `p_T (3, M)` onto `p_W (3, M)` (Kabsch)."""
    center_W, center_T = p_W.mean(axis=1), p_T.mean(axis=1)
    U, _, Vt = np.linalg.svd((p_W - center_W[:, None]) @ (p_T - center_T[:, None]).T)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    r = logarithm(R[:, :, None])[:, 0]
    if np.trace(R) < -1 + 1e-6:
        # Half a turn: the logarithm's axis is the eigenvector of eigenvalue one.
        values, vectors = np.linalg.eigh((R + R.T) / 2)
        r = np.pi * vectors[:, int(values.argmax())]
    return np.concatenate([center_W - R @ center_T, r])


def hint_of_frame(model: Model, measurements: Measurements) -> None:
    """Warn if measured positions lie where no arm in the world frame puts them, and no tracker frame is estimated."""
    m = measurements
    if m.relative or m.position is None or any(isinstance(effect, TrackerFrame) for effect in model.effects):
        return
    poses = forward(model.arm, m.cases.q)
    p_W = poses.p_E[:, m.case] + rotate(poses.R_E[:, :, m.case], model.point_positions(m.point))
    off = float(np.sqrt(((m.position.T - p_W) ** 2).sum(axis=0).mean()))
    if off < _PLAUSIBLE_M:
        return
    turn = float(np.degrees(np.linalg.norm(fitted_frame(p_W, m.position.T)[3:]))) if m.case.size >= 3 else float("nan")
    log.warning(
        "%s: the readings lie %.0f mm (rms) from where the undeflected arm puts the points, and are turned by about %.1f deg. Are they "
        "in the tracker's frame? Then set tracker_frame: unknown. Otherwise check joints, units and reference points.",
        m.table.path, off * 1e3, turn,
    )  # fmt: skip
