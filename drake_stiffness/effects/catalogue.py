"""The list of kinds. Users register theirs as entry points of the group `drake_stiffness.effects`."""

from __future__ import annotations

from functools import lru_cache
from importlib.metadata import entry_points

from drake_stiffness.effects.compliance import BaseCompliance, JointCompliance, LinkCompliance
from drake_stiffness.effects.effect import Effect
from drake_stiffness.effects.geometry import JointZeroOffset, LinkGeometry, Payload
from drake_stiffness.effects.instruments import ReflectorOffset, TrackerFrame
from drake_stiffness.errors import InputError

_BUILT_IN: tuple[type[Effect], ...] = (
    JointCompliance,
    LinkCompliance,
    BaseCompliance,
    JointZeroOffset,
    LinkGeometry,
    Payload,
    TrackerFrame,
    ReflectorOffset,
)


@lru_cache
def effect_kinds() -> dict[str, type[Effect]]:
    """All kinds by name: the built-in ones and those that installed packages register.

    Raises
    ------
    InputError
        If a registered class is not an Effect or takes the name of another.
    """
    kinds = {cls.kind: cls for cls in _BUILT_IN}
    for point in entry_points(group="drake_stiffness.effects"):
        cls = point.load()
        if not (isinstance(cls, type) and issubclass(cls, Effect)):
            raise InputError(f"entry point '{point.name}' of drake_stiffness.effects: {cls!r} is not an Effect class.")
        if cls.kind in kinds:
            raise InputError(f"entry point '{point.name}': the kind '{cls.kind}' exists already; choose another name.")
        kinds[cls.kind] = cls
    return kinds


def make_effect(kind: str, where: str, settings: dict[str, object] | None = None) -> Effect:
    """An effect by kind, place and settings.

    Raises
    ------
    InputError
        If the kind is unknown or the settings do not fit it.
    """
    kinds = effect_kinds()
    if kind not in kinds:
        raise InputError(f"unknown kind of effect '{kind}'; known kinds: {', '.join(sorted(kinds))}.")
    try:
        return kinds[kind](where, **(settings or {}))
    except TypeError as error:
        raise InputError(f"{kind} at '{where}': settings {settings} do not fit ({error}).") from None
