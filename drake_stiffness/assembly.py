"""From what the user asks for to a model with effects: the springs of the cell, the unknowns of the campaign."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from drake_stiffness.arm import Arm
from drake_stiffness.campaign import CampaignFile
from drake_stiffness.cell import Cell
from drake_stiffness.effects import Effect
from drake_stiffness.effects.compliance import ROTATION_SCALE, BaseCompliance, JointCompliance, LinkCompliance
from drake_stiffness.effects.geometry import JointZeroOffset, LinkGeometry, geometry_components
from drake_stiffness.effects.instruments import ReflectorOffset, TrackerFrame
from drake_stiffness.errors import InputError
from drake_stiffness.model import Model
from drake_stiffness.rotations import Array


def joint_spring(arm: Arm, joint: str) -> JointCompliance:
    """The spring of a joint: rad/(N m) about a revolute, m/N along a prismatic axis."""
    if arm.prismatic[arm.joint_names.index(joint)]:
        return JointCompliance(joint, unit="m/N", scale=ROTATION_SCALE * arm.length_m**2)
    return JointCompliance(joint)


def link_spring(arm: Arm, link: str, template: Any, beam_axis: str) -> LinkCompliance:
    """The spring of a link; the base link's is a `base_compliance`."""
    if link == arm.link_names[0]:
        return BaseCompliance("base", template, beam_axis, arm.length_m, link)
    return LinkCompliance(link, template, beam_axis, arm.length_m)


def default_beam_axis(arm: Arm, link: str) -> str | None:
    """The spring-frame axis nearest to the vector from the link's own joint to its spring; None for zero length."""
    k = arm.link_names.index(link)
    along = np.abs(arm.R_PF[k].T @ arm.p_PF[k])
    return "xyz"[int(along.argmax())] if along.max() > 1e-9 else None


def spring_effects(cell: Cell, arm: Arm) -> list[Effect]:
    """The springs that the cell names, joints first, then links from the base on.

    Raises
    ------
    InputError
        If a joint or link does not exist, or a beam has neither length nor a stated axis.
    """
    where = f"{cell.path}: springs"
    joints = _select(cell.springs.joints, arm.joint_names, f"{where}.joints")
    links = _select(cell.springs.links, arm.link_names, f"{where}.links")
    axes = dict(cell.springs.beam_axes)
    for link in axes:
        if link not in arm.link_names:
            raise InputError(f"{where}.beam_axes: no link '{link}'; the arm has {', '.join(arm.link_names)}.")
    effects: list[Effect] = [joint_spring(arm, joint) for joint in joints]
    for link in links:
        axis = axes.get(link) or default_beam_axis(arm, link)
        if axis is None and cell.springs.template == "beam":
            raise InputError(
                f"{where}: link '{link}' has zero length between its joint and its spring, so its long axis is unknown; "
                f"write springs.beam_axes: {{{link}: x}} (x, y or z of its spring frame)."
            )
        effects.append(link_spring(arm, link, cell.springs.template, axis or "x"))
    return effects


def _select(selection: Any, known: tuple[str, ...], where: str) -> Iterable[str]:
    if selection == "all":
        return known
    if selection == "none":
        return ()
    for name in selection:
        if name not in known:
            near = [k for k in known if k.casefold() == name.casefold()]
            hint = f" Did you mean '{near[0]}'?" if near else ""
            raise InputError(f"{where}: found '{name}'; expected all, none or names among {', '.join(known)}.{hint}")
    return [name for name in known if name in selection]


def campaign_effects(campaign: CampaignFile, cell: Cell, arm: Arm) -> list[Effect]:
    """The unknowns that the campaign adds: tracker frame, reflectors, geometric errors."""
    effects: list[Effect] = []
    if "joint_zero_offsets" in campaign.estimate:
        effects += [JointZeroOffset(n, p) for n, p in zip(arm.joint_names, arm.prismatic, strict=True)]
    if "link_geometry" in campaign.estimate:
        effects += [LinkGeometry(name, geometry_components(arm, i)) for i, name in enumerate(arm.joint_names)]
    if campaign.tracker_frame == "unknown":
        effects.append(TrackerFrame())
    if campaign.reference_points == "unknown":
        effects += [ReflectorOffset(point) for point in cell.reference_points_m]
    return effects


def make_model(cell: Cell, arm: Arm, effects: Iterable[Effect], x: Array | None = None) -> Model:
    """A model of this cell; without values every effect stands at its start."""
    effects = tuple(effects)
    points = {name: np.array(p) for name, p in cell.reference_points_m.items()}
    for effect in effects:
        effect.check(arm, points)
    if x is None:
        x = np.concatenate([np.zeros(0), *(effect.initial() for effect in effects)])
    return Model(
        cell=cell.model_dump(mode="json"),
        arm=arm,
        points=points,
        load_point=np.array(cell.load_point_m),
        effects=effects,
        x=x,
    )
