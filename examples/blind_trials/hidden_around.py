"""Effects to hide around the arm: geometry, tool, force sensor, tracker, mishaps; and what the catalogue does not know."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
from plants import rotations
from plants.creep import Creep
from plants.dress_pack import DressPack
from plants.measured_world import MeasuredWorld
from plants.mishaps import Bump, Mishap, WrongLoad, WrongPosture
from plants.segments import cut
from plants.uneven_link import OpeningJoint
from plants.warm_link import WarmLink

from blind_trials.hidden import (
    Draw,
    Hidden,
    Rng,
    backlash,
    compensator,
    compliance_of,
    coupling,
    friction,
    hardening,
    in_joint,
    joint_compliance,
    link_compliance,
    mesh,
    transmission_error,
    unit,
    with_tool,
)
from blind_trials.setting import Setting
from blind_trials.stands import Array


def zero_offset(s: Setting, where: str, rng: Rng) -> Hidden:
    step = np.zeros(s.stand.chain.size)
    step[s.joint_names.index(where)] = 1e-3 * rng.choice([-1.0, 1.0])
    return Hidden("joint_zero_offset", where, {}, lambda w, size: replace(w, zero_offset=w.zero_offset + size * step))


def link_geometry(s: Setting, where: str, rng: Rng) -> Hidden:
    """A constant pose error of the frame before a joint; the joint's own motion is left out."""
    k, chain = s.joint_names.index(where), s.stand.chain
    shift, turn = 5e-4 * unit(rng), 5e-4 * unit(rng)
    axis = chain.axes[k]
    own = shift if chain.prismatic[k] else turn
    own -= axis * (axis @ own)

    def change(world: MeasuredWorld, size: float) -> MeasuredWorld:
        end_p, end_R = world.arm.chain.end_p.copy(), world.arm.chain.end_R.copy()
        angle = size * float(np.linalg.norm(turn))
        end_p[k] += end_R[k] @ (size * shift)
        end_R[k] = end_R[k] @ rotations.about_axis(turn / np.linalg.norm(turn), np.array([angle]))[0]
        moved = replace(world.arm.chain, end_p=end_p, end_R=end_R)
        return world.with_arm(chain=moved, segments=cut(moved, s.stand.truth))

    return Hidden("link_geometry", where, {"shift": shift.tolist(), "turn": turn.tolist()}, change)


def payload(s: Setting, where: str, rng: Rng) -> Hidden:
    mass, shift = 0.02 * s.stand.truth.tool.mass * rng.choice([-1.0, 1.0]), 2e-3 * unit(rng)
    return Hidden("payload", "tool", {"shift": shift.tolist()}, lambda w, size: with_tool(w, size * mass, size * shift))


def sensor_bias(s: Setting, where: str, rng: Rng) -> Hidden:
    frame, step = str(rng.choice(["world", "tool"])), 0.005 * s.stand.room.force * unit(rng)
    field = f"bias_{frame}"

    def change(world: MeasuredWorld, size: float) -> MeasuredWorld:
        return replace(world, sensor=replace(world.sensor, **{field: getattr(world.sensor, field) + size * step}))

    return Hidden("force_sensor_bias", "force_sensor", {"frame": frame, "step": step.tolist()}, change)


def sensor_turn(s: Setting, where: str, rng: Rng) -> Hidden:
    frame, step = str(rng.choice(["world", "tool"])), 1e-2 * unit(rng)
    field = f"turn_{frame}"

    def change(world: MeasuredWorld, size: float) -> MeasuredWorld:
        return replace(world, sensor=replace(world.sensor, **{field: getattr(world.sensor, field) + size * step}))

    return Hidden("force_sensor_misalignment", "force_sensor", {"frame": frame, "step": step.tolist()}, change)


def _tracker(kind: str, field: str, step: Array, more: dict[str, object]) -> Hidden:
    def change(world: MeasuredWorld, size: float) -> MeasuredWorld:
        moved = {field: getattr(world.tracker, field) + size * step}
        return replace(world, tracker=replace(world.tracker, **moved, **more))

    return Hidden(kind, "tracker", {"step": step.tolist(), **more}, change)


def drift(s: Setting, where: str, rng: Rng) -> Hidden:
    return _tracker("tracker_drift", "drift", 2e-4 * unit(rng), {"bend": float(rng.uniform(-0.2, 0.2))})


def frame(s: Setting, where: str, rng: Rng) -> Hidden:
    return _tracker("tracker_frame", "turn", 1e-3 * unit(rng), {})


def reflector(s: Setting, where: str, rng: Rng) -> Hidden:
    step = np.zeros((len(s.stand.points), 3))
    step[list(s.stand.points).index(where)] = 1e-4 * unit(rng)

    def change(world: MeasuredWorld, size: float) -> MeasuredWorld:
        return replace(world, reflector_offset=world.reflector_offset + size * step)

    return Hidden("reflector_offset", where, {"step": step.tolist()}, change)


def scale(s: Setting, where: str, rng: Rng) -> Hidden:
    """No campaign shows it: a factor on all compliances is the same. It must not be named."""
    return Hidden(
        "scale",
        "force_or_tracker",
        {},
        lambda w, size: replace(w, sensor=replace(w.sensor, scale=w.sensor.scale + 5e-3 * size)),
    )


def outlier(s: Setting, where: str, rng: Rng) -> Hidden:
    """A bumped reflector in a step, or the wrong posture or load in an experiment."""
    number = int(where[1:])
    if rng.random() < 0.5:
        step, shift = int(rng.integers(1, 17)), 1e-4 * unit(rng)
        return _mishap(f"{where}:{step}", "bump", lambda size: Bump(number, step, size * shift))
    if s.quantity == "position" and rng.random() < 0.5:
        error = 1e-4 * rng.normal(size=s.stand.chain.size)
        return _mishap(where, "posture", lambda size: WrongPosture(number, size * error))
    sign = rng.choice([-1.0, 1.0])
    return _mishap(where, "load", lambda size: WrongLoad(number, 1.0 + 0.05 * sign * size))


def _mishap(where: str, what: str, make: Callable[[float], Mishap]) -> Hidden:
    return Hidden("outliers", where, {"what": what}, lambda w, size: replace(w, mishaps=(*w.mishaps, make(size))))


def creep(s: Setting, where: str, rng: Rng) -> Hidden:
    i, c = s.joint_names.index(where), {"relaxation_s": float(np.exp(rng.uniform(np.log(20.0), np.log(200.0))))}
    make = lambda size: Creep(i, 0.1 * size * compliance_of(s, i), **c)  # noqa: E731
    return Hidden("creep", where, dict(c), in_joint(make), known=False)


def opening(s: Setting, where: str, rng: Rng) -> Hidden:
    link, axis = s.stand.chain.link_names.index(where), int(rng.choice([4, 5]))
    i = min(link, s.stand.chain.size - 1)

    def change(world: MeasuredWorld, size: float) -> MeasuredWorld:
        part = OpeningJoint(link, axis, 0.2 * size * compliance_of(s, i))
        return world.with_arm(link_physics=(*world.arm.link_physics, part))

    return Hidden("uneven_link", where, {"axis": axis}, change, known=False)


def warm(s: Setting, where: str, rng: Rng) -> Hidden:
    link, lasting = s.stand.chain.link_names.index(where), float(rng.uniform(2e3, 1e4))

    def change(world: MeasuredWorld, size: float) -> MeasuredWorld:
        part = WarmLink(link, 2e-5 * size, 2e-5 * size, lasting)
        return world.with_arm(link_physics=(*world.arm.link_physics, part))

    return Hidden("warm_link", where, {"warming_s": lasting}, change, known=False)


def dress_pack(s: Setting, where: str, rng: Rng) -> Hidden:
    last = s.stand.chain.size
    clamp, end = 0.25 * unit(rng), 0.15 * unit(rng)
    force = 0.02 * s.stand.room.force

    def change(world: MeasuredWorld, size: float) -> MeasuredWorld:
        return world.with_arm(pulls=(*world.arm.pulls, DressPack(last - 3, clamp, end, force * size, 0.8)))

    return Hidden("dress_pack", s.stand.chain.link_names[last - 3], {}, change, known=False)


#: What shows in displacements, and what takes absolute positions.
BY_LOAD: dict[str, Draw] = {
    "joint_backlash": backlash,
    "joint_hysteresis": friction,
    "joint_hardening": hardening,
    "joint_mesh_stiffness": mesh,
    "joint_coupling": coupling,
    "joint_compliance": joint_compliance,
    "link_compliance": link_compliance,
    "base_compliance": link_compliance,
    "gravity_compensator": compensator,
    "force_sensor_bias": sensor_bias,
    "force_sensor_misalignment": sensor_turn,
    "tracker_drift": drift,
    "tracker_frame": frame,
    "outliers": outlier,
}
BY_POSITION: dict[str, Draw] = {
    "joint_zero_offset": zero_offset,
    "joint_periodic_error": transmission_error,
    "link_geometry": link_geometry,
    "payload": payload,
    "reflector_offset": reflector,
}
UNKNOWN: dict[str, Draw] = {"creep": creep, "uneven_link": opening, "warm_link": warm}
UNKNOWN_BY_POSITION: dict[str, Draw] = {"dress_pack": dress_pack}
NEVER_SEEN: dict[str, Draw] = {"scale": scale}
DRAWS = {**BY_LOAD, **BY_POSITION, **UNKNOWN, **UNKNOWN_BY_POSITION, **NEVER_SEEN}


def places(s: Setting, kind: str) -> list[str]:
    """Where a kind may be hidden in a setting; empty if its base model has it already."""
    joints, links = list(s.joint_names), list(s.stand.chain.link_names)
    if kind == "joint_compliance":
        return [s.rigid_joint] if s.rigid_joint else []
    if kind in ("link_compliance", "base_compliance"):
        return [] if s.links else (links[1:] if kind == "link_compliance" else ["base"])
    if kind == "gravity_compensator":
        return list(s.stand.compensated)
    if kind == "joint_coupling":
        return [f"{a}+{b}" for a, b in pairwise(joints)]
    if kind in ("uneven_link", "warm_link"):
        return links[1:-1] if s.links else []
    if kind == "reflector_offset":
        return list(s.stand.points)
    if kind == "outliers":
        return [f"E{k:02d}" for k in range(int(s.experiment.course.experiment.max()) + 1)]
    if kind.startswith("joint_") or kind in ("creep", "link_geometry"):
        return joints
    return [""]


__all__ = ["DRAWS", "Hidden", "places"]
