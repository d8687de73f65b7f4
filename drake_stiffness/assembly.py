"""From what the user asks for to a model with effects: the springs of the cell, the unknowns of the campaign."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from drake_stiffness.arm import Arm
from drake_stiffness.campaign import CampaignFile
from drake_stiffness.cell import Cell
from drake_stiffness.effects import Effect
from drake_stiffness.effects.compliance import (
    ROTATION_SCALE,
    BaseCompliance,
    JointCompliance,
    LinkCompliance,
    default_beam_axis,
)
from drake_stiffness.effects.geometry import JointZeroOffset, LinkGeometry, geometry_components
from drake_stiffness.effects.instruments import ReflectorOffset, TrackerFrame
from drake_stiffness.errors import InputError
from drake_stiffness.hardware import cell_effects
from drake_stiffness.model import Model
from drake_stiffness.rotations import Array

# Hardware on a joint acts on the joint's own spring, which may merge with the springs of the links beside it: that joint then
# takes nearly all of the sum, where least norm alone would leave it half or nothing, and hardware would have nothing to act on.
PREFERRED = 4.0


def joint_spring(arm: Arm, joint: str, softer: float = 1.0) -> JointCompliance:
    """The spring of a joint: rad/(N m) about a revolute, m/N along a prismatic axis.

    Parameters
    ----------
    softer : float
        Factor on its typical size, and so on its share wherever the data leave open which of several springs gives way.
    """
    if arm.prismatic[arm.joint_names.index(joint)]:
        return JointCompliance(joint, unit="m/N", scale=softer * ROTATION_SCALE * arm.length_m**2)
    return JointCompliance(joint, scale=softer * ROTATION_SCALE)


def link_spring(arm: Arm, link: str, template: Any, beam_axis: str) -> LinkCompliance:
    """The spring of a link; the base link's is a `base_compliance`."""
    if link == arm.link_names[0]:
        return BaseCompliance("base", template, beam_axis, arm.length_m, link)
    return LinkCompliance(link, template, beam_axis, arm.length_m)


def spring_effects(cell: Cell, arm: Arm) -> list[Effect]:
    """The springs that the cell names, joints first, then links from the base on.

    Raises
    ------
    InputError
        If a joint or link does not exist, or a beam has neither length nor a stated axis.
    """
    where = f"{cell.path}: springs"
    joints = _select(cell.springs.joints, arm.joint_names, f"{where}.joints")
    links = tuple(_select(cell.springs.links, arm.link_names, f"{where}.links"))
    axes = dict(cell.springs.beam_axes)
    for link in axes:
        if link not in arm.link_names:
            raise InputError(f"{where}.beam_axes: no link '{link}'; the arm has {', '.join(arm.link_names)}.")
    masks = cell.springs.masks
    for link in masks:
        if link not in links:
            kept = ", ".join(links) or "no link"
            raise InputError(
                f"{where}.masks: found '{link}'; springs.links has {kept}. Name a link that has a spring, or add it there."
            )
    hardware = {entry.where for entry in cell.effects}
    effects: list[Effect] = [joint_spring(arm, joint, PREFERRED if joint in hardware else 1.0) for joint in joints]
    for link in links:
        if link in masks:
            effects.append(link_spring(arm, link, "symmetric", "x").masked(masks[link]))
            continue
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
    """All unknowns beside springs: the cell's hardware, then what the campaign adds (tracker, reflectors, geometry)."""
    effects: list[Effect] = cell_effects(cell, arm)
    if "joint_zero_offsets" in campaign.estimate:
        effects += [JointZeroOffset(n, p) for n, p in zip(arm.joint_names, arm.prismatic, strict=True)]
    if "link_geometry" in campaign.estimate:
        effects += [LinkGeometry(name, geometry_components(arm, i)) for i, name in enumerate(arm.joint_names)]
    if campaign.tracker_frame == "unknown":
        effects.append(TrackerFrame())
    if campaign.reference_points == "unknown":
        effects += [ReflectorOffset(point) for point in cell.reference_points_m]
    places = [(e.kind, e.where) for e in effects]
    for twice in (place for i, place in enumerate(places) if place in places[:i]):
        raise InputError(
            f"{cell.path}: effects: {twice[0]} at '{twice[1]}' stands twice (or the campaign estimates it too); leave one out."
        )
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
