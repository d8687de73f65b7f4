"""What the arm has besides springs: key `effects` of cell.yaml, a gravity compensator for one."""

from __future__ import annotations

from typing import Any

from drake_stiffness.arm import Arm
from drake_stiffness.cell import Cell
from drake_stiffness.effects import Effect, make_effect
from drake_stiffness.effects.compliance import Spring
from drake_stiffness.errors import InputError


def cell_effects(cell: Cell, arm: Arm) -> list[Effect]:
    """The hardware that the cell has besides springs (key `effects`).

    Raises
    ------
    InputError
        If a kind, place or setting does not exist, or a spring stands here.
    """
    effects: list[Effect] = []
    for number, entry in enumerate(cell.effects):
        try:
            effect = make_effect(entry.kind, entry.where, entry.settings)
            if isinstance(effect, Spring):
                raise InputError(f"{entry.kind} at '{entry.where}': springs stand under the key springs.")
            effect.check(arm, cell.reference_points_m)
        except InputError as error:
            raise InputError(f"{cell.path}: effects.{number}: {error}") from None
        effects.append(effect)
    return effects


def hardware_entries(cell: Cell, arm: Arm) -> list[dict[str, Any]]:
    """The same as `inspect` lists it: kind, place, settings, and the names and units of the unknowns."""
    return [
        {
            "kind": effect.kind,
            "where": effect.where,
            "settings": effect.settings(),
            "unknowns": len(effect.parameters),
            "parameters": [
                {"name": name, "unit": p.unit} for name, p in zip(effect.names, effect.parameters, strict=True)
            ],
        }
        for effect in cell_effects(cell, arm)
    ]
