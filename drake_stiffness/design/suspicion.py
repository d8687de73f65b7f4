"""The effect that a plan by criterion ds shall show: KIND:WHERE on the command line, with settings where it has any."""

from __future__ import annotations

from typing import Any

import yaml

from drake_stiffness.cell import Cell
from drake_stiffness.effects import Effect, make_effect
from drake_stiffness.effects.catalogue import effect_kinds
from drake_stiffness.errors import InputError
from drake_stiffness.model import Model


def suspected_effect(text: str, model: Model, cell: Cell) -> Effect:
    """The effect that `KIND:WHERE` or `KIND:WHERE:key=value,key=[value,value]` names.

    What the words leave out is that of the first which diagnosis would try at that place.

    Raises
    ------
    InputError
        If the words do not name a kind, a place of this arm or its settings, or the model holds the effect already.
    """
    kind, where, words = _parts(text)
    kinds = effect_kinds()
    if not where or kind not in kinds:
        raise InputError(
            f"--suspect: found '{text}'; expected KIND:WHERE, such as joint_zero_offset:{model.arm.joint_names[0]}. Kinds: "
            f"{', '.join(sorted(kinds))}."
        )
    own = next((effect for effect in model.effects if (effect.kind, effect.where) == (kind, where)), None)
    if own is not None:
        raise InputError(
            f"--suspect: {kind} at '{where}' is part of the cell's own model ({cell.path}), so every plan is made to show it already. To aim "
            f"at it alone, use --criterion ratio, with parameters in DESIGN.yaml naming some of {', '.join(own.names)}, and with assumed values "
            "for them (compliances)."
        )
    stated, everywhere = _settings(text, words), list(kinds[kind].candidates(model.arm, model.points))
    first = next((effect.settings() for effect in everywhere if effect.where == where), None)
    keys = tuple(everywhere[0].settings()) if everywhere else tuple(stated)
    for key in stated:
        if key not in keys:
            known = f"its settings are {', '.join(keys)}" if keys else "it has no settings"
            raise InputError(f"--suspect {text}: {kind} has no setting '{key}'; {known}.")
    try:
        effect = make_effect(kind, where, (first or {}) | stated)
        effect.check(model.arm, model.points)
    except InputError as error:
        # Where diagnosis tries nothing there is nothing to fill in from either, so say what could be written.
        places = ", ".join(dict.fromkeys(effect.where for effect in everywhere)) or "none"
        reason = (
            str(error) if stated or first is not None else "this is no place of this kind, or one that needs settings."
        )
        also = f" Settings are written as KIND:WHERE:key=value,..., with the keys {', '.join(keys)}." if keys else ""
        raise InputError(
            f"--suspect {text}: {reason} Places where diagnosis would try {kind} on this arm: {places}.{also}"
        ) from None
    return effect


def taken_for_granted(text: str, effect: Effect, model: Model) -> str | None:
    """Which of several settings that diagnosis would try a plan was made for, unless the words state some; None if there is one."""
    kind, where, words = _parts(text)
    number = sum(e.where == where for e in effect_kinds()[kind].candidates(model.arm, model.points))
    if words or number < 2:
        return None
    listed = ",".join(f"{key}={_plain(value)}" for key, value in effect.settings().items())
    return (
        f"of {kind} at '{where}' diagnosis would try {number} settings, and the plan is made to show the first, {listed}; if you know better, "
        f"state them: --suspect {kind}:{where}:key=value,..."
    )


def _parts(text: str) -> tuple[str, str, str]:
    kind, _, rest = text.partition(":")
    where, _, words = rest.partition(":")
    return kind, where, words


def _settings(text: str, words: str) -> dict[str, Any]:
    """`key=value,key=[value,value]` as YAML reads the values."""
    try:
        found = yaml.safe_load("{" + words.replace("=", ": ") + "}")
    except yaml.YAMLError:
        found = {"": None}
    if any(not isinstance(key, str) or value is None for key, value in found.items()):
        raise InputError(
            f"--suspect {text}: found settings '{words}'; expected key=value,key=[value,value] without spaces, such as "
            "anchor_m=[0.3,0.1],lever_m=0.2,lever_deg=180."
        )
    return dict(found)


def _plain(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return f"[{','.join(map(_plain, value))}]" if isinstance(value, list | tuple) else str(value)
