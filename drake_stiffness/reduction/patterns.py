"""Models with other patterns of free compliances: symmetrisation M1, sparsing M2 (seed 4.2), masks, joints alone.

Values are carried over through the matrices. A pattern that a reduction leaves is a mask: the entries that are free, the rest zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np

from drake_stiffness.assembly import default_beam_axis
from drake_stiffness.effects import Effect
from drake_stiffness.effects.compliance import JointCompliance, LinkCompliance
from drake_stiffness.model import Model
from drake_stiffness.rotations import Array
from drake_stiffness.springs import masked_template


def symmetrised(model: Model) -> Model:
    """M1 (seed eq. 21): full templates become symmetric; pairs k_ij, k_ji become their mean."""

    def one(effect: Effect) -> Effect:
        if isinstance(effect, LinkCompliance) and effect.template_name == "full":
            return type(effect)(effect.where, **{**effect.settings(), "template": "symmetric"})  # type: ignore[arg-type]
        return effect

    return _with_effects(model, one)


def widened(model: Model) -> Model:
    """M1 alone: every link has all 21 entries of a symmetric matrix."""

    def one(effect: Effect) -> Effect:
        if isinstance(effect, LinkCompliance) and effect.template_name in ("full", "beam"):
            return type(effect)(effect.where, **{**effect.settings(), "template": "symmetric"})  # type: ignore[arg-type]
        return effect

    return _with_effects(model, one)


def sparsed(model: Model, axes: Mapping[str, str] | None = None) -> Model:
    """M2 (seed eq. 24): full and symmetric templates become those of beams.

    Parameters
    ----------
    axes : mapping of link to 'x', 'y' or 'z', optional
        Long axes; by default the frame axis nearest to the link. A link of zero length without one keeps its template.
    """

    def one(effect: Effect) -> Effect:
        if not isinstance(effect, LinkCompliance) or effect.template_name not in ("full", "symmetric"):
            return effect
        axis = (axes or {}).get(effect.link_name()) or default_beam_axis(
            model.arm, model.arm.link_names[effect.site(model.arm)[1]]
        )
        if axis is None:
            return effect
        return type(effect)(effect.where, **{**effect.settings(), "template": "beam", "beam_axis": axis})  # type: ignore[arg-type]

    return _with_effects(symmetrised(model), one)


def _with_effects(model: Model, change: Callable[[Effect], Effect]) -> Model:
    """Other templates, values carried over through the matrices."""
    effects, values = [], []
    for effect, x in zip(model.effects, model.values, strict=True):
        other = change(effect)
        if other is not effect and isinstance(effect, LinkCompliance) and isinstance(other, LinkCompliance):
            matrix = effect.matrix(x)
            x = other.template.values((matrix + matrix.T) / 2)
        effects.append(other)
        values.append(x)
    return replace(model, effects=tuple(effects), x=np.concatenate([np.zeros(0), *values]), statistics=None)


def keep_only(
    model: Model, names: Iterable[str], *, closed: bool = False, combined: bool = False
) -> tuple[Model, tuple[str, ...]]:
    """The model in which only the named compliances are free; other elastic effects stay if named by `where.kind`.

    Parameters
    ----------
    closed : bool
        Give every kept entry off the diagonal its diagonal ones.
    combined : bool
        Kept entries stand for others that are redundant beside them.

    Returns
    -------
    Model, and the names of what was given back.
    """
    wanted, added = set(names), []
    effects: list[Effect] = []
    values: list[Array] = []
    for effect, x in zip(model.effects, model.values, strict=True):
        if isinstance(effect, LinkCompliance):
            own = [p.name for p, name in zip(effect.parameters, effect.names, strict=True) if name in wanted]
            if not own:
                continue
            if closed:
                more = [name for name in masked_template(tuple(own)).unsupported if name not in own]
                added += [f"{effect.link_name()}.{name}" for name in more]
                own += more
            other = effect.masked(own, combined=combined)
            x = other.template.values(effect.matrix(x))
            effect = other
        elif effect.station == "spring" and not {*effect.names, f"{effect.where}.{effect.kind}"} & wanted:
            continue
        effects.append(effect)
        values.append(x)
    x = np.concatenate([np.zeros(0), *values])
    return replace(model, effects=tuple(effects), x=x, statistics=None), tuple(added)


def joints_only(model: Model) -> Model:
    """Rigid links, no other elastic effect: the model most robots are calibrated with."""
    return model.subset([isinstance(e, JointCompliance) or e.station != "spring" for e in model.effects])


def rigid(model: Model) -> Model:
    """No spring at all; frames and geometry as they are."""
    return model.subset([e.station != "spring" for e in model.effects])
