"""A reduced model with all its springs again: what a reduction took away stands in it as zeros."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.assembly import default_beam_axis, joint_spring, link_spring
from drake_stiffness.cell import Cell
from drake_stiffness.effects import Effect
from drake_stiffness.effects.compliance import LinkCompliance, Spring
from drake_stiffness.model import Model


def complete(model: Model) -> tuple[Model, NDArray[np.bool_]]:
    """The model with every spring its cell names and whole link matrices, and which of its parameters are new.

    A link with a mask gets the template of the cell back (beam where that is `full`; symmetric where the mask holds an entry that a
    beam has not); joints and links without a spring get one if the cell names them. A model that lacks nothing is handed back.

    Returns
    -------
    model : Model
        Without statistics where something is new.
    new : (n,) bool
    """
    springs = [effect for effect in model.effects if isinstance(effect, Spring)]
    others = [effect for effect in model.effects if not isinstance(effect, Spring)]
    links = {effect.link_name(): effect for effect in springs if isinstance(effect, LinkCompliance)}
    joints = {effect.where: effect for effect in springs if not isinstance(effect, LinkCompliance)}
    stated = Cell.model_validate(model.cell).springs

    def named(which: object, known: tuple[str, ...]) -> list[str]:
        return [name for name in known if which == "all" or (which != "none" and name in which)]  # type: ignore[operator]

    whole: list[Effect] = [
        joints.get(name) or joint_spring(model.arm, name)
        for name in model.arm.joint_names
        if name in joints or name in named(stated.joints, model.arm.joint_names)
    ]
    template = "symmetric" if stated.template == "symmetric" else "beam"
    for name in model.arm.link_names:
        own = links.get(name)
        if own is not None and own.template_name != "mask":
            whole.append(own)
        elif own is not None or name in named(stated.links, model.arm.link_names):
            axis = stated.beam_axes.get(name) or default_beam_axis(model.arm, name) or "x"
            made = link_spring(model.arm, name, template, axis)
            if own is not None and not set(own.names) <= set(made.names):
                made = link_spring(model.arm, name, "symmetric", axis)
            whole.append(made)
    effects = (*whole, *others)
    names = [name for effect in effects for name in effect.names]
    if set(names) == set(model.names):
        return model, np.zeros(model.x.size, dtype=bool)
    value = dict(zip(model.names, model.x, strict=True))
    x = np.array([value.get(name, 0.0) for name in names])
    new = np.array([name not in value for name in names])
    return replace(model, effects=effects, x=x, statistics=None), new
