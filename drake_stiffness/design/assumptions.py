"""What a plan takes for granted before anything is measured: the model, sizes of its parameters, which of them count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drake_stiffness.arm import Arm
from drake_stiffness.assembly import make_model, spring_effects
from drake_stiffness.base_parameters import BaseMap
from drake_stiffness.cell import Cell
from drake_stiffness.design.settings import Design
from drake_stiffness.effects.compliance import JointCompliance, Spring
from drake_stiffness.errors import InputError
from drake_stiffness.hardware import cell_effects
from drake_stiffness.model import Model, load_model
from drake_stiffness.rotations import Array
from drake_stiffness.truth import read_truth

# A typical link spring beside a joint's, both in units of scale (1e-6 rad/(N m)): links of machined castings are stiffer.
_TYPICAL_LINK = 0.03


def assumed_model(cell: Cell, arm: Arm, settings: Design) -> Model:
    """The cell's springs and hardware at the values the plan assumes.

    `typical` is 1e-6 rad/(N m) a joint and 3 % of that a link; a model.json or TRUTH.yaml says better.

    Raises
    ------
    InputError
        If the cell has no springs, or the file has none of its parameters.
    """
    effects = spring_effects(cell, arm)
    if not effects:
        raise InputError(
            f"{cell.path}: springs: the cell has none, so there is nothing that a plan could show. Set springs.joints or springs.links."
        )
    model = make_model(cell, arm, [*effects, *cell_effects(cell, arm)])
    if settings.compliances == "typical":
        return model.with_x(typical_values(model))
    path = settings.path.parent / settings.compliances
    known = load_model(path) if path.suffix == ".json" else read_truth(path, cell, arm)
    values = dict(zip(known.names, known.x.tolist(), strict=True))
    if not any(name in values for name in model.names):
        raise InputError(
            f"{settings.path}: compliances: {path} has none of the parameters of {cell.path} ({', '.join(model.names[:3])}, ...). Give "
            "a model.json or TRUTH.yaml of this arm, or write typical."
        )
    return model.with_x(np.array([values.get(name, 0.0) for name in model.names]))


def typical_values(model: Model) -> Array:
    """Joints at their scale, diagonals of links at a few percent of theirs, everything else at its start."""
    parts = []
    for effect in model.effects:
        if isinstance(effect, JointCompliance):
            parts.append(np.array([p.scale for p in effect.parameters]))
        elif isinstance(effect, Spring):
            diagonal = np.einsum("uii->u", effect.basis) > 0
            parts.append(_TYPICAL_LINK * diagonal * np.array([p.scale for p in effect.parameters]))
        else:
            parts.append(effect.initial())
    return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class Interest:
    """Base parameters whose ratios count.

    Attributes
    ----------
    names : tuple of K names
        Of the parameter that stands for each combination.
    c : (K, n)
        The combinations, per unit of scale.
    value : (K,)
        Assumed, in units of scale.
    """

    names: tuple[str, ...]
    c: Array
    value: Array


def parameters_of_interest(model: Model, base: BaseMap, settings: Design) -> Interest:
    """Base parameters by the setting `parameters`: joints, all, or names.

    Raises
    ------
    InputError
        If a name is no base parameter, or an assumed value is zero, which no ratio can exceed.
    """
    names = [model.names[i] for i in base.base.tolist()]
    if settings.parameters == "joints":
        joints = {name for e in model.effects if isinstance(e, JointCompliance) for name in e.names}
        wanted = [k for k, name in enumerate(names) if name in joints]
    elif settings.parameters == "all":
        wanted = list(range(len(names)))
    else:
        unknown = [name for name in settings.parameters if name not in names]
        if unknown:
            raise InputError(
                f"{settings.path}: parameters: found '{unknown[0]}'; expected base parameters of this arm under these loads: "
                f"{', '.join(names)}. Others are determined only together with these."
            )
        wanted = [names.index(name) for name in settings.parameters]
    if not wanted:
        raise InputError(
            f"{settings.path}: parameters: no joint of this cell can be determined; write all, or some of {', '.join(names)}."
        )
    L = base.matrix[wanted]
    value = L @ (model.x / model.scales)
    zero = np.flatnonzero(np.abs(value) < 1e-9)
    chosen = [names[k] for k in wanted]
    if zero.size and settings.parameters != "all":
        raise InputError(
            f"{settings.path}: parameters: '{chosen[zero[0]]}' is assumed to be zero (compliances: {settings.compliances}), and no "
            "measurement tells zero from zero. Leave it out, or assume a value by a model.json or TRUTH.yaml."
        )
    keep = np.setdiff1d(np.arange(value.size), zero)
    return Interest(tuple(chosen[k] for k in keep), L[keep], value[keep])
