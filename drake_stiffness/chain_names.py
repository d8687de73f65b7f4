"""The joints a user names against the joints a model has."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from drake_stiffness.errors import InputError


def check_names(wanted: list[str], movable: list[Any], joints: list[Any], where: Path) -> None:
    """Raise InputError unless every wanted joint is one of the movable ones, once, in the order of the chain.

    Parameters
    ----------
    wanted : names from robot.joints
    movable, joints : joints between base and flange that move, and all joints of the model
    """
    names = [joint.name() for joint in movable]
    folded: dict[str, str] = {}
    for name in names:
        twin = folded.setdefault(name.casefold(), name)
        if twin != name:
            raise InputError(
                f"{where}: the joints '{twin}' and '{name}' differ only in upper and lower case; columns of measurements "
                "could not be told apart. Rename one."
            )
    for name in wanted:
        if name in names:
            continue
        near = [known for known in names if known.casefold() == name.casefold()]
        hint = f" Did you mean '{near[0]}'?" if near else ""
        exists = any(joint.name() == name for joint in joints)
        what = "is not a movable joint between base and flange" if exists else "does not exist in the model"
        raise InputError(f"{where}: robot.joints names '{name}', which {what}.{hint} The arm has: {', '.join(names)}.")
    if len(set(wanted)) != len(wanted):
        raise InputError(f"{where}: robot.joints names a joint twice: {', '.join(wanted)}.")
    order = [name for name in names if name in wanted]
    if order != wanted:
        raise InputError(
            f"{where}: robot.joints must be listed from base to flange: expected [{', '.join(order)}], found "
            f"[{', '.join(wanted)}]."
        )
