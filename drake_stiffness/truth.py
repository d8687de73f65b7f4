"""TRUTH.yaml: effects with known values, for virtual campaigns."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from drake_stiffness.arm import Arm
from drake_stiffness.assembly import joint_spring, link_spring, make_model
from drake_stiffness.cell import Cell
from drake_stiffness.effects import Effect, make_effect
from drake_stiffness.effects.compliance import Spring, default_beam_axis
from drake_stiffness.effects.geometry import JointZeroOffset
from drake_stiffness.errors import InputError
from drake_stiffness.files import Document, read_yaml
from drake_stiffness.model import Model
from drake_stiffness.rotations import Array


class TruthEntry(Document):
    """One effect: `parameters` in SI by name; what is not written is zero."""

    kind: str
    where: str
    parameters: dict[str, float]
    settings: dict[str, Any] = Field(default_factory=dict)


class Truth(Document):
    """The content of TRUTH.yaml (FORMATS: plan, truth, prediction)."""

    effects: tuple[TruthEntry, ...]


def read_truth(path: Path | str, cell: Cell, arm: Arm) -> Model:
    """A model with the effects and values of a TRUTH.yaml.

    Raises
    ------
    InputError
        If a kind, place or parameter does not exist, or a compliance matrix is not positive semidefinite.
    """
    path = Path(path)
    truth = read_yaml(path, Truth, "known effects (TRUTH.yaml)")
    effects: list[Effect] = []
    values: list[Array] = []
    for number, entry in enumerate(truth.effects):
        place = f"{path}: effects.{number}"
        effect = effect_of(entry, cell, arm, place)
        effects.append(effect)
        values.append(_values(entry, effect, place))
    try:
        return make_model(cell, arm, effects, np.concatenate([np.zeros(0), *values]))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def effect_of(entry: TruthEntry, cell: Cell, arm: Arm, place: str) -> Effect:
    """The effect of an entry; springs take their units and lengths from the arm."""
    if entry.kind == "joint_compliance" and entry.where in arm.joint_names:
        return joint_spring(arm, entry.where)
    if entry.kind == "joint_zero_offset" and entry.where in arm.joint_names:
        return JointZeroOffset(entry.where, arm.prismatic[arm.joint_names.index(entry.where)])
    if entry.kind in ("link_compliance", "base_compliance"):
        link = arm.link_names[0] if entry.kind == "base_compliance" and entry.where == "base" else entry.where
        base = link == arm.link_names[0]
        if link in arm.link_names and base == (entry.kind == "base_compliance"):
            return link_spring(arm, link, "symmetric", default_beam_axis(arm, link) or "x")
    try:
        return make_effect(entry.kind, entry.where, entry.settings or _settings_of_cell(entry, cell))
    except InputError as error:
        raise InputError(f"{place}: {error}") from None


def _settings_of_cell(entry: TruthEntry, cell: Cell) -> dict[str, Any]:
    """What cell.yaml says of the same hardware, so that a truth need not repeat it."""
    return next((e.settings for e in cell.effects if (e.kind, e.where) == (entry.kind, entry.where)), {})


def _values(entry: TruthEntry, effect: Effect, place: str) -> Array:
    """Values in the order of the effect's parameters; names may be short (`k26`) or full (`link_2.k26`)."""
    short = {p.name: i for i, p in enumerate(effect.parameters)}
    names = short | {full: i for i, full in enumerate(effect.names)}
    if len(effect.parameters) == 1:
        names |= {"value": 0, "compliance": 0}
    x = np.zeros(len(effect.parameters))
    for name, value in entry.parameters.items():
        turned = f"k{name[2]}{name[1]}" if len(name) == 3 and name[0] == "k" else name
        if name not in names and turned not in names:
            raise InputError(
                f"{place} ({effect.kind} at '{effect.where}'): unknown parameter '{name}'; expected some of "
                f"{', '.join(f'{p.name} ({p.unit})' for p in effect.parameters)}."
            )
        x[names[name] if name in names else names[turned]] = value
    if isinstance(effect, Spring):
        matrix = effect.matrix(x)
        d = np.sqrt(np.maximum(np.abs(np.diag(matrix)), 1e-300))
        if np.linalg.eigvalsh(matrix / np.outer(d, d))[0] < -1e-9:
            raise InputError(
                f"{place} ({effect.kind} at '{effect.where}'): the compliance matrix is not positive semidefinite; a passive "
                "structure has no other. Check signs and units (SI: m/N, rad/N, rad/(N m))."
            )
    return x
