"""Effects to hide: kind, place and constants drawn at random, each a change of the true world that grows with a size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from plants.compensator import PinSpring
from plants.friction import DahlFriction
from plants.gear_coupling import SharedShaft
from plants.gear_mesh import Backlash, MeshStiffness, TransmissionError
from plants.measured_world import MeasuredWorld
from plants.segmented_arm import SegmentedArm
from plants.windup import HertzContact, SoftStart

from blind_trials.setting import Setting
from blind_trials.stands import Array

Rng = np.random.Generator
Change = Callable[[MeasuredWorld, float], MeasuredWorld]


@dataclass(frozen=True)
class Hidden:
    """One effect.

    Attributes
    ----------
    kind, where
        As FORMATS names them; effects outside the catalogue have a kind of their own.
    constants
        What was drawn.
    change
        (world, size) to the world with the effect; size 1 is a typical one, size 0 none.
    known
        Whether the catalogue has the kind.
    """

    kind: str
    where: str
    constants: dict[str, object]
    change: Change
    known: bool = True

    @property
    def name(self) -> str:
        return f"{self.kind} at {self.where}"


Draw = Callable[[Setting, str, Rng], Hidden]


def in_joint(make: Callable[[float], object]) -> Change:
    """A change that puts physics into a joint."""

    def change(world: MeasuredWorld, size: float) -> MeasuredWorld:
        return world.with_arm(joint_physics=(*world.arm.joint_physics, make(size)))

    return change


def unit(rng: Rng) -> Array:
    """A random direction (3,)."""
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def compliance_of(s: Setting, i: int) -> float:
    """The joint's true compliance, whatever the base model makes of it."""
    return s.stand.truth.joint_compliance[s.joint_names[i]]


def backlash(s: Setting, where: str, rng: Rng) -> Hidden:
    i = s.joint_names.index(where)
    # Gears of a slide: a tenth of a millimetre as well, and drag of a fiftieth of what the load brings.
    drag = float(s.swing[i] * rng.uniform(0.005, 0.03))
    make = lambda size: Backlash(i, 1e-4 * size, drag, 0.05, float(s.swing[i]))  # noqa: E731
    return Hidden("joint_backlash", where, {"drag": drag}, in_joint(make))


def friction(s: Setting, where: str, rng: Rng) -> Hidden:
    i, c = s.joint_names.index(where), {}
    c["breakaway"] = float(s.swing[i] * np.exp(rng.uniform(np.log(0.04), np.log(0.4))))
    c["steepness"] = float(np.exp(rng.uniform(np.log(5.0), np.log(40.0))))
    c["exponent"] = float(rng.choice([0.5, 1.0, 2.0]))
    make = lambda size: DahlFriction(i, 0.3 * size * compliance_of(s, i), **c)  # noqa: E731
    return Hidden("joint_hysteresis", where, dict(c), in_joint(make))


def hardening(s: Setting, where: str, rng: Rng) -> Hidden:
    i = s.joint_names.index(where)
    top, c = float(np.abs(s.torque[i]).max()), compliance_of(s, i)
    if rng.random() < 0.6:
        knee = top * rng.uniform(0.25, 0.75)
        return Hidden(
            "joint_hardening",
            where,
            {"form": "two slopes", "knee": knee},
            in_joint(lambda size: SoftStart(i, 0.2 * size * c, knee)),
        )
    return Hidden(
        "joint_hardening",
        where,
        {"form": "Hertz", "reference": top},
        in_joint(lambda size: HertzContact(i, 0.1 * size * c * top, top)),
    )


def mesh(s: Setting, where: str, rng: Rng) -> Hidden:
    i = s.joint_names.index(where)
    c = {"harmonic": float(_harmonic(rng)), "phase": rng.uniform(0, 2 * np.pi)}
    # Depth 0.15 at most bends the sine; beyond it more of the joint's compliance varies.
    make = lambda size: MeshStiffness(i, 0.5 * size * compliance_of(s, i), 0.15, prismatic=_slides(s, i), **c)  # noqa: E731
    return Hidden("joint_mesh_stiffness", where, dict(c), in_joint(make))


def transmission_error(s: Setting, where: str, rng: Rng) -> Hidden:
    i = s.joint_names.index(where)
    c = {"harmonic": float(_harmonic(rng)), "phase": rng.uniform(0, 2 * np.pi)}
    make = lambda size: TransmissionError(i, 1e-4 * size, prismatic=_slides(s, i), **c)  # noqa: E731
    return Hidden("joint_periodic_error", where, dict(c), in_joint(make))


def coupling(s: Setting, where: str, rng: Rng) -> Hidden:
    i = s.joint_names.index(where.split("+")[0])
    one, other = compliance_of(s, i), compliance_of(s, i + 1)
    ratio = float(np.sqrt(other / one) * rng.uniform(0.5, 1.0) * rng.choice([-1.0, 1.0]))
    make = lambda size: SharedShaft(i, 0.1 * size * one, ratio)  # noqa: E731
    return Hidden("joint_coupling", where, {"ratio": ratio}, in_joint(make))


def joint_compliance(s: Setting, where: str, rng: Rng) -> Hidden:
    i = s.joint_names.index(where)

    def change(world: MeasuredWorld, size: float) -> MeasuredWorld:
        compliance = world.arm.joint_compliance.copy()
        compliance[i] += 0.1 * size * compliance_of(s, i)
        return world.with_arm(joint_compliance=compliance)

    return Hidden("joint_compliance", where, {}, change)


def link_compliance(s: Setting, where: str, rng: Rng) -> Hidden:
    link = 0 if where == "base" else s.stand.chain.link_names.index(where)

    def change(world: MeasuredWorld, size: float) -> MeasuredWorld:
        factors = world.arm.link_factors.copy()
        factors[link] = 1.0 / (1.0 / factors[link] + 0.1 * size)
        return world.with_arm(link_factors=factors)

    return Hidden("base_compliance" if where == "base" else "link_compliance", where, {}, change)


def compensator(s: Setting, where: str, rng: Rng) -> Hidden:
    i, chain = s.joint_names.index(where), s.stand.chain
    axis, reach = chain.axes[i], float(np.linalg.norm(chain.end_p[i + 1]))
    # A pin behind and below the joint and one on the arm at its side, both in a plane across the axis.
    back = np.array([-1.0, 0.0, 0.0]) * rng.uniform(0.35, 0.65) * reach
    before = back + np.array([0.0, 0.0, -1.0]) * rng.uniform(0.0, 0.25) * reach
    along = chain.end_p[i + 1] / reach
    side = np.cross(axis, along) * rng.uniform(-0.3, 0.3) + along
    after = (side - axis * (axis @ side)) * rng.uniform(0.12, 0.22) * reach
    length = float(rng.uniform(0.5, 1.0) * np.linalg.norm(before))
    make = lambda size: PinSpring(i, before, after, 1e5 * size, length)  # noqa: E731

    def change(world: MeasuredWorld, size: float) -> MeasuredWorld:
        return world.with_arm(pulls=(*world.arm.pulls, make(size)))

    constants = {"before": before.tolist(), "after": after.tolist(), "free_length": length}
    return Hidden("gravity_compensator", where, constants, change)


def arm_of(s: Setting) -> SegmentedArm:
    """The arm of the setting's world."""
    return s.world.arm


def _harmonic(rng: Rng) -> int:
    return int(np.round(np.exp(rng.uniform(np.log(1.0), np.log(60.0)))))


def _slides(s: Setting, i: int) -> bool:
    return bool(s.stand.chain.prismatic[i])


def with_tool(world: MeasuredWorld, mass: float, shift: Array) -> MeasuredWorld:
    """The world with more on the flange."""
    tool = world.arm.tool
    return world.with_arm(tool=replace(tool, mass=tool.mass + mass, center_of_mass=tool.center_of_mass + shift))
