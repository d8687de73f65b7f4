"""A force log beside the plan: loaded where the plan loads, and of the planned force, or else what the map has wrong."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError
from drake_stiffness.importing.map_file import FORCES, Forces
from drake_stiffness.importing.matching import Steps
from drake_stiffness.rotations import Array
from drake_stiffness.tables import Table

# A force this share of itself away from the planned one is worth a warning.
_ROUGHLY = 0.2
# A factor common to all loaded steps is a wrong unit where it is this near to one (kgf and lbf are a factor of two apart).
_CLEARLY = 0.15


def compare_with_plan(
    table: Table,
    spec: Forces,
    steps: Steps,
    used: NDArray[np.int_],
    planned: Array,
    wrench: Array,
    small: NDArray[np.bool_],
    limit: float,
    gravity: float,
) -> list[str]:
    """Warnings about a log that says something else than the plan.

    Parameters
    ----------
    used : steps that were read
    planned, wrench : (6, N)
        By the plan and by the log, N and N m in world axes.
    small : (N,) bool
        Which steps the log calls unloaded: those below `limit`, N.
    gravity : float
        What a kilogram weighs, N.

    Raises
    ------
    InputError
        If all loaded steps are off by the factor of a unit or a sign, or unloaded and loaded steps are not those of the plan.
    """
    busy = used[np.abs(planned[:3, used]).max(axis=0) > 0]
    _refuse_unit(table, spec, planned[:3, busy], wrench[:3, busy], gravity)
    free = np.abs(planned).max(axis=0) == 0.0
    loaded = [c for c in used.tolist() if free[c] and not small[c]]
    if loaded:
        size = float(np.linalg.norm(wrench[:3, loaded[0]]))
        raise InputError(
            f"{table.path}: the plan calls {steps.names(loaded)} unloaded, but the log reads {size:.4g} N there "
            f"(limit {limit:.3g} N). If the sensor has a zero error, set forces.tare: true; else the rows are "
            "matched to the wrong steps, or forces.zero_below_N is too small."
        )
    empty = [c for c in busy.tolist() if small[c]]
    if empty:
        raise InputError(
            f"{table.path}: the plan loads {steps.names(empty)}, but the log reads no force there (below {limit:.3g} "
            "N); the rows are matched to the wrong steps, or forces.zero_below_N is too large."
        )
    size = np.linalg.norm(planned[:3, busy], axis=0)
    off = np.linalg.norm(wrench[:3, busy] - planned[:3, busy], axis=0) > _ROUGHLY * size
    if not off.any():
        return []
    against = float((np.einsum("cn,cn->n", wrench[:3, busy], planned[:3, busy]) / size**2).mean())
    what = " (it points the other way: set forces.sign or rpy_deg?)" if against < -0.5 else ""
    return [
        f"the log is more than 20 % off the planned force at {int(off.sum())} of {busy.size} loaded steps{what}, "
        f"first at {steps.name(int(busy[off][0]))}: along the plan it is {against:.3g} of it"
    ]


def _refuse_unit(table: Table, spec: Forces, planned: Array, logged: Array, gravity: float) -> None:
    """Raise InputError if one factor other than one carries the planned forces (3, K) to the logged ones, and a unit or sign explains it."""
    if not planned.size:
        return
    factor = np.median(np.einsum("cn,cn->n", logged, planned) / np.einsum("cn,cn->n", planned, planned))
    away = np.linalg.norm(logged - factor * planned, axis=0) > _ROUGHLY * np.linalg.norm(factor * planned, axis=0)
    if away.any() or abs(factor - 1) <= _ROUGHLY or factor == 0:
        return
    sizes = {**FORCES, "kg": gravity}
    explained = {unit: abs(abs(factor) * size / sizes[spec.unit] - 1) for unit, size in sizes.items()}
    unit = spec.unit if explained[spec.unit] <= _ROUGHLY else min(explained, key=lambda name: explained[name])
    if explained[unit] > (_ROUGHLY if unit == spec.unit else _CLEARLY):
        return
    remedy = [f"unit: {unit} (found: {spec.unit})"] if unit != spec.unit else []
    remedy += [f"sign: {-spec.sign} (found: {spec.sign})"] if factor < 0 else []
    raise InputError(
        f"{table.path}: at every loaded step the log reads {factor:.4g} times the planned force. Write {' and '.join(remedy)} under "
        "forces in the map, or mend the plan if that is what is wrong."
    )
