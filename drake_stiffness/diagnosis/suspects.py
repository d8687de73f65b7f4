"""What may be missing: every kind of the catalogue at every place it can be, and what this campaign could not show."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drake_stiffness.campaign import Measurements
from drake_stiffness.effects import Effect, effect_kinds
from drake_stiffness.effects.compliance import Spring
from drake_stiffness.effects.effect import Need, Parameter
from drake_stiffness.model import Model
from drake_stiffness.rotations import Array
from drake_stiffness.structure import acts_on_joints

# Two loads are along one line when the sine of the angle between them is below this.
_ALONG = 0.02
# Postures whose angle of a joint differs by less than this (rad or m) count as one angle.
_SAME_ANGLE = 0.02
_MANY_ANGLES = 6


@dataclass(frozen=True)
class Suspect:
    """One kind at one place, with every variant of its nonlinear constants.

    Attributes
    ----------
    kind, where : str
    variants : tuple of Effect
    """

    kind: str
    where: str
    variants: tuple[Effect, ...]

    @property
    def name(self) -> str:
        return f"{self.kind} at {self.where}"

    def makes_sense_beside(self, present: set[tuple[str, str]]) -> bool:
        """Whether what it refines is there: a tooth mesh that modulates no compliance is none."""
        if acts_on_joints(self.variants[0]) and not any(kind.endswith("_compliance") for kind, _ in present):
            return False  # a torque on an arm that nowhere bends moves nothing
        refined = self.variants[0].refines
        return refined is None or (refined, self.where) in present


@dataclass(frozen=True)
class Untestable:
    """What this campaign could not have shown, and what it lacks for it."""

    kind: str
    where: str
    lacks: str


def suspects(model: Model) -> list[Suspect]:
    """Every kind at every place that the model does not have already."""
    present = {(effect.kind, effect.where) for effect in model.effects}
    found: dict[tuple[str, str], list[Effect]] = {}
    for cls in effect_kinds().values():
        for effect in _candidates(cls, model):
            if (effect.kind, effect.where) not in present:
                found.setdefault((effect.kind, effect.where), []).append(effect)
    return [Suspect(kind, where, tuple(variants)) for (kind, where), variants in found.items()]


class Unlisted(Effect):
    """Stands for a kind that fails to list its places; it fails again when it is tried, and the report says so."""

    def __init__(self, cls: type[Effect], error: Exception) -> None:
        super().__init__("all its places")
        self.kind, self.error = cls.kind, error  # type: ignore[misc]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        raise self.error


def _candidates(cls: type[Effect], model: Model) -> list[Effect]:
    try:
        return list(cls.candidates(model.arm, model.points))
    except Exception as error:
        # A kind is anybody's code: it fails alone.
        return [Unlisted(cls, error)]


def lacking(m: Measurements, displacement: bool) -> dict[Need, str]:
    """What effects may need and this campaign does not have, in words."""
    out: dict[Need, str] = {}
    loaded = ~m.unloaded
    if displacement and not loaded.any():
        out["load"] = "loaded steps"  # positions show what weight does, displacements do not
    if _most_levels(m) < 2:
        out["levels"] = "loads of one line at several levels (at least two, better three)"
    if not _unloads(m):
        out["unloading"] = "a step with less load than the one before it"
    if displacement:
        out["positions"] = "absolute positions (quantity: position)"
    time = m.cases.time_s
    if not np.isfinite(time).all():
        out["time"] = "times (column time_s)"
    elif np.ptp(time) == 0:
        out["time"] = "times that differ (column time_s is constant)"
    return out


def few_angles(q: Array) -> bool:
    """Whether a joint stood at too few different angles to show what repeats with its angle."""
    return np.unique(np.round(q / _SAME_ANGLE)).size < _MANY_ANGLES


def _most_levels(m: Measurements) -> int:
    """The most distinct levels that loads along one line had in any experiment."""
    most = 0
    for e in np.unique(m.cases.experiment):
        wrench = m.cases.wrench[:, (m.cases.experiment == e) & ~m.unloaded]
        size = np.linalg.norm(wrench, axis=0)
        lines = wrench / np.where(size > 0, size, 1.0)
        for i in range(size.size):
            along = np.abs(lines.T @ lines[:, i]) > 1 - _ALONG**2
            most = max(most, np.unique(np.round(size[along] / size.max(), 2)).size)
    return most


def _unloads(m: Measurements) -> bool:
    """Whether any step carries less than the step before it, of what that step carried."""
    c = m.cases
    order = np.lexsort((c.step, c.experiment))
    wrench, experiment = c.wrench[:, order], c.experiment[order]
    before, after = wrench[:, :-1], wrench[:, 1:]
    size = (before**2).sum(axis=0)
    less = (before * after).sum(axis=0) < (1 - 1e-6) * size
    return bool((less & (size > 0) & (experiment[1:] == experiment[:-1])).any())


def timed(suspect: Suspect, m: Measurements) -> Suspect:
    """The same with times counted from the first reading."""
    known = m.cases.time_s[np.isfinite(m.cases.time_s)]
    if not known.size:
        return suspect
    return replace(suspect, variants=tuple(effect.timed_from(float(known.min())) for effect in suspect.variants))


def separate_untestable(
    found: list[Suspect], model: Model, m: Measurements, displacement: bool
) -> tuple[list[Suspect], list[Untestable]]:
    """Suspects that the campaign can show, and the others with what it lacks for them."""
    missing = lacking(m, displacement)
    if displacement and any(isinstance(effect, Spring) for effect in model.effects):
        missing["known_springs"] = "compliances known from elsewhere: a common factor on all of them does the same"
    testable, untestable = [], []
    for suspect in (timed(s, m) for s in found):
        needs = suspect.variants[0].needs
        lacks = [missing[need] for need in needs if need in missing]
        if not lacks and "angles" in needs and suspect.where in model.arm.joint_names:
            i = model.arm.joint_names.index(suspect.where)
            if few_angles(m.cases.q[i]):
                lacks = [f"different angles of {suspect.where} (at least {_MANY_ANGLES})"]
        if lacks:
            untestable.append(Untestable(suspect.kind, suspect.where, "; ".join(lacks)))
        else:
            testable.append(suspect)
    return testable, untestable
