"""The residual against what explains it: what a joint, the tracker or a step seems to do beyond the model, before and after.

Per step the residual r (3 coordinates of every point, m) is projected on the column J of the named effect's joint, d = J.r / J.J:
the deflection of that joint that would explain the step. Before: what the base model leaves. After: what the model with all named
effects leaves. The effect itself is what it does in the final model, and its evidence is that plus the remainder (a
component-plus-residual plot): dots on the curve mean that its form is right.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from drake_stiffness.diagnosis.bench import Named
from drake_stiffness.diagnosis.diagnosis import Diagnosis
from drake_stiffness.diagnosis.generic import branch_of
from drake_stiffness.diagnosis.signatures import Scene
from drake_stiffness.effects import Effect
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations, residual_m
from drake_stiffness.rotations import Array

Projection = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Shape:
    """One quantity of every step against its driver.

    Attributes
    ----------
    quantity, driver : str
        Axis labels with units.
    x : (N,)
        The driver.
    before, after : (N,)
        What the model leaves without and with the named effects.
    itself : (N,)
        What the effect does in the final model.
    branch : (N,) of -1, 0, 1, or None
        Unloading, first step, loading; where the effect depends on it.
    """

    quantity: str
    driver: str
    x: Array
    before: Array
    after: Array
    itself: Array
    branch: Array | None


def shapes(d: Diagnosis, n: Named) -> list[Shape]:
    """The pictures that show one named effect of a diagnosis."""
    return shapes_between(d.observations, d.search.base.model, d.search.solution.model, n.effect)


def shapes_between(
    o: Observations, base: Model, final: Model, effect: Effect, then: Array | None = None
) -> list[Shape]:
    """The pictures that show what one effect takes away between two models: a joint each, or the three axes of the tracker, or the steps themselves.

    Parameters
    ----------
    base, final : Model
        Without and with the named effects.
    effect : Effect
        Of `final`.
    then : (p,), optional
        Its values in `base`, where it only changed: its change is shown.
    """
    scene = Scene(final, o)
    before, after = residual_m(o, base), residual_m(o, final)
    other = without_effect(final, effect) if then is None else with_values(final, effect, then)
    itself = residual_m(o, other) - after
    places = effect.where.split("+")
    joints = [i for i, name in enumerate(final.arm.joint_names) if name in places]
    if joints:
        return [_of_joint(scene, effect, i, joints, before, after, itself, then) for i in joints]
    if "time" in effect.needs:
        return [_of_axis(scene, axis, before, after, itself) for axis in range(3)]
    return [_of_steps(o, before, after, itself)]


def without_effect(model: Model, effect: Effect) -> Model:
    """The same values without one effect."""
    own = model.slices[_place(model, effect)]
    rest = tuple(e for e in model.effects if e is not effect)
    return replace(model, effects=rest, x=np.delete(model.x, own), statistics=None)


def with_values(model: Model, effect: Effect, values: Array) -> Model:
    """The same model with other values of one effect."""
    x = model.x.copy()
    x[model.slices[_place(model, effect)]] = values
    return replace(model, x=x, statistics=None)


def _place(model: Model, effect: Effect) -> int:
    return next(i for i, e in enumerate(model.effects) if e is effect)


def _of_joint(
    scene: Scene,
    effect: Effect,
    i: int,
    joints: list[int],
    before: Array,
    after: Array,
    itself: Array,
    then: Array | None,
) -> Shape:
    arm = scene.model.arm
    name, slides = arm.joint_names[i], bool(arm.prismatic[i])
    project = _on_joint(scene, i)
    partner = next((k for k in joints if k != i), i)
    driver, x, per = _driver(scene, effect, partner)
    # What runs with time has an offset of its own in every experiment, which displacements do not show.
    own = None if "time" in effect.needs else effect_deflection(scene, effect, i, then)
    parts = np.stack([project(before), project(after), project(itself) if own is None else own]) * 1e6
    unit, quantity = ("µm" if slides else "µrad"), f"deflection of {name}"
    branch = None
    if "unloading" in effect.needs:
        branch = branch_of(scene.carried.tau_joint[i] - scene.carried.weight_joint[i], scene)
    if per is not None:
        loaded = np.abs(per) > 0.2 * np.abs(per).max()
        parts = parts[:, loaded] / per[loaded]
        x, unit = x[loaded], f"{unit} per {'kN' if arm.prismatic[partner] else 'kN m'}"
        branch = None if branch is None else branch[loaded]
    return Shape(f"{quantity}, {unit}", driver, x, parts[0], parts[1], parts[2], branch)


def effect_deflection(scene: Scene, effect: Effect, i: int, then: Array | None = None) -> Array | None:
    """(N,) what an effect that deflects joints does to joint i in the model, beyond what it did with the values `then`; None for
    other effects."""
    if type(effect).deflection is Effect.deflection:
        return None
    arm, now = scene.model.structure.arm, scene.model.values[_place(scene.model, effect)]
    turned = effect.deflection(arm, scene.carried, scene.cases, now).get(i)
    if turned is None or then is None:
        return turned
    return turned - effect.deflection(arm, scene.carried, scene.cases, then)[i]


def _driver(scene: Scene, effect: Effect, i: int) -> tuple[str, Array, Array | None]:
    """What an effect in a joint goes by: a label, (N,) values, and the load that its deflection is divided by, if any."""
    arm, cases = scene.model.arm, scene.cases
    name, slides = arm.joint_names[i], bool(arm.prismatic[i])
    load = scene.carried.tau_joint[i] / 1e3
    harmonic = getattr(effect, "harmonic", None)
    if harmonic is not None:
        turns = cases.q[i] * (1.0 if slides else 0.5 / np.pi)
        phase = (float(harmonic) * turns) % 1.0 * 360
        by_load = load if "load" in effect.needs else None
        return f"{harmonic:g} times the position of {name}, deg of a period", phase, by_load
    if "time" in effect.needs:
        return "time since the first step, min", _since_first(scene) / 60, None
    if "positions" in effect.needs or effect.kind == "gravity_compensator":
        position = cases.q[i] * (1e3 if slides else 180 / np.pi)
        return f"position of {name}, {'mm' if slides else 'deg'}", position, None
    word, unit = ("force", "kN") if slides else ("torque", "kN m")
    if "unloading" in effect.needs:  # a loop opens at what weight alone does
        return f"{word} in {name} by the load, {unit}", load - scene.carried.weight_joint[i] / 1e3, None
    return f"{word} in {name}, weight included, {unit}", load, None


def _since_first(scene: Scene) -> Array:
    """(N,) time since the earliest step of the same experiment, s."""
    e, time = scene.cases.experiment, scene.cases.time_s
    first = np.full(int(e.max()) + 1, np.inf)
    np.minimum.at(first, e, time)
    return np.asarray(time - first[e])


def _on_joint(scene: Scene, i: int) -> Projection:
    """Readings (3, M) to the deflection (N,) of a joint that would explain each step; NaN where it moves no point."""
    m = scene.o.measurements
    J = scene.joint_columns[i][:3]
    size = np.bincount(m.case, (J**2).sum(axis=0), minlength=m.cases.number)

    def project(change: Array) -> Array:
        along = np.bincount(m.case, (J * change).sum(axis=0), minlength=m.cases.number)
        return np.asarray(np.where(size > 1e-12, along / np.maximum(size, 1e-12), np.nan))

    return project


def _of_axis(scene: Scene, axis: int, before: Array, after: Array, itself: Array) -> Shape:
    """One axis of all readings, the mean over the points of a step, against time; displacements know it inside an experiment only."""
    m = scene.o.measurements
    driver, x = "time, h", m.cases.time_s / 3600
    if scene.o.displacement:
        driver, x = "time since the first step, min", _since_first(scene) / 60
    count = np.maximum(np.bincount(m.case, minlength=m.cases.number), 1)
    parts = [np.bincount(m.case, v[axis], minlength=m.cases.number) / count * 1e6 for v in (before, after, itself)]
    return Shape(f"{'xyz'[axis]} of all points, µm", driver, x, parts[0], parts[1], parts[2], None)


def _of_steps(o: Observations, before: Array, after: Array, itself: Array) -> Shape:
    """Along what the effect does to each step: its own size against what is there."""
    m = o.measurements
    number = m.cases.number
    size = np.sqrt(np.bincount(m.case, (itself**2).sum(axis=0), minlength=number))
    points = np.sqrt(np.maximum(np.bincount(m.case, minlength=number), 1))

    def along(v: Array) -> Array:
        dot = np.bincount(m.case, (v * itself).sum(axis=0), minlength=number)
        return np.asarray(dot / np.maximum(size, 1e-15) / points * 1e6)

    return Shape(
        "residual along the effect, µm",
        "effect on the step, µm rms",
        size / points * 1e6,
        along(before),
        along(after),
        along(itself),
        None,
    )
