"""DESIGN.yaml: what a measurement plan may use - postures, space, loads - and what it takes for granted."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from drake_stiffness.arm import Arm
from drake_stiffness.cell import Vector3
from drake_stiffness.errors import InputError
from drake_stiffness.files import Document, read_yaml
from drake_stiffness.rotations import Array

Positive = Annotated[float, Field(gt=0.0)]

# Payload over moving mass: 0.31 for a KR 270, 0.35 for a UR10. Loads of a quarter leave room for the tool.
PAYLOAD_SHARE = 0.25


class Box(Document):
    """A box in the world that no part of the arm may enter."""

    min_m: Vector3
    max_m: Vector3

    @model_validator(mode="after")
    def _has_room(self) -> Box:
        if any(high <= low for low, high in zip(self.min_m, self.max_m, strict=True)):
            raise ValueError(f"max_m {self.max_m} must lie beyond min_m {self.min_m} in all three coordinates (m)")
        return self


class LoadVector(Document):
    """An explicit load at the load point, world axes."""

    force_N: Vector3 = (0.0, 0.0, 0.0)
    moment_Nm: Vector3 = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _is_a_load(self) -> LoadVector:
        if not any((*self.force_N, *self.moment_Nm)):
            raise ValueError("force_N and moment_Nm are all zero: no load; write at least one number that is not")
        return self


class Loads(Document):
    """What can be hung on or pulled at the load point. Forces not given are a quarter of the moving mass's weight."""

    down_N: Annotated[float, Field(ge=0.0)] | None = None
    horizontal_N: Annotated[float, Field(ge=0.0)] | None = None
    horizontal_directions: int = Field(default=8, ge=1, le=72)
    up_N: float = Field(default=0.0, ge=0.0)
    vectors: tuple[LoadVector, ...] = ()
    per_posture: int = Field(default=2, ge=1, le=12)
    levels: tuple[Positive, ...] = (0.5, 1.0)

    @model_validator(mode="after")
    def _levels_are_steps(self) -> Loads:
        if not self.levels or list(self.levels) != sorted(set(self.levels)) or self.levels[-1] > 1.0:
            raise ValueError(f"levels {list(self.levels)}: expected rising shares of the full load, such as [0.5, 1.0]")
        return self


class DesignNoise(Document):
    """One standard deviation of one coordinate: of the tracker, and of how the arm settles from step to step."""

    position_sigma_mm: float = Field(default=0.015, gt=0.0)
    settling_sigma_mm: float = Field(default=0.0, ge=0.0)


class SightCone(Document):
    """A tracker that must see every reference point inside a cone from its place."""

    position_m: Vector3
    towards_m: Vector3
    half_angle_deg: float = Field(gt=0.0, lt=180.0)

    @model_validator(mode="after")
    def _looks_somewhere(self) -> SightCone:
        if self.position_m == self.towards_m:
            raise ValueError("towards_m is the tracker's own place; write a point in front of it (m)")
        return self


class Design(Document):
    """The content of DESIGN.yaml; every key has a default that suits any arm."""

    candidates: int = Field(default=3000, ge=10, le=100_000)
    seed: int = Field(default=0, ge=0)
    loads: Loads = Loads()
    keep_out_boxes: tuple[Box, ...] = ()
    floor_m: float | None = None
    joint_ranges: dict[str, tuple[float, float]] = Field(default_factory=dict)
    clearance_m: float | None = Field(default=None, ge=0.0)
    singular_margin: float = Field(default=0.0, ge=0.0, lt=1.0)
    tracker: SightCone | None = None
    compliances: str = "typical"
    noise: DesignNoise = DesignNoise()
    parameters: Literal["joints", "all"] | tuple[str, ...] = "joints"
    threshold: float = Field(default=5.0, gt=0.0)
    random_plans: int = Field(default=100, ge=0, le=10_000)

    _path: Path = PrivateAttr(default=Path("DESIGN.yaml (defaults)"))

    @property
    def path(self) -> Path:
        """The file it was read from."""
        return self._path


def read_design(path: Path | str | None) -> Design:
    """Read a DESIGN.yaml; without one, all defaults."""
    if path is None:
        return Design()
    settings = read_yaml(Path(path), Design, "settings of a measurement plan (DESIGN.yaml)")
    settings._path = Path(path)
    return settings


def posture_ranges(settings: Design, arm: Arm) -> tuple[Array, Array]:
    """Lower and upper ends (n,) of the joints, rad or m: limits, at most one turn, narrowed by `joint_ranges`.

    Raises
    ------
    InputError
        If a joint or unit does not exist, or a range is empty or leaves the limits.
    """
    span = np.where(arm.prismatic, 0.5, np.pi)
    lower = np.where(np.isfinite(arm.lower), arm.lower, -span)
    upper = np.where(np.isfinite(arm.upper), arm.upper, span)
    turns = ~np.array(arm.prismatic) & (lower <= -np.pi) & (upper >= np.pi)  # a second turn shows nothing new
    lower[turns], upper[turns] = -np.pi, np.pi
    for key, (low, high) in settings.joint_ranges.items():
        i, scale, unit = _joint_of(key, arm, settings.path)
        where = f"{settings.path}: joint_ranges.{key}"
        if not low < high:
            raise InputError(f"{where}: found [{low:g}, {high:g}]; expected the smaller end first ({unit}).")
        if low * scale < arm.lower[i] - 1e-9 or high * scale > arm.upper[i] + 1e-9:
            raise InputError(
                f"{where}: found [{low:g}, {high:g}] {unit}; the joint's limits are {arm.lower[i] / scale:.6g} .. "
                f"{arm.upper[i] / scale:.6g} {unit}. A plan stays inside them; narrow the range."
            )
        lower[i], upper[i] = low * scale, high * scale
    return lower, upper


def _joint_of(key: str, arm: Arm, path: Path) -> tuple[int, float, str]:
    """Number, unit in SI and unit's name of a key such as `joint_1_deg`."""
    units = {"deg": np.pi / 180, "rad": 1.0, "mm": 1e-3, "m": 1.0}
    found = re.fullmatch(r"(.+)_(deg|rad|mm|m)", key)
    if found and found[1] in arm.joint_names:
        i = arm.joint_names.index(found[1])
        if (found[2] in ("mm", "m")) == arm.prismatic[i]:
            return i, units[found[2]], found[2]
    known = ", ".join(f"{n}_{'mm' if p else 'deg'}" for n, p in zip(arm.joint_names, arm.prismatic, strict=True))
    raise InputError(f"{path}: joint_ranges.{key}: no such joint with such a unit; expected some of {known}.")


def payload_force(arm: Arm) -> float:
    """A load that suits the arm, N: a quarter of the weight of all links that move, to two digits.

    An arm without masses gets what moves its tip by about a millimetre at typical compliances (1e-6 rad/(N m) a joint).
    """
    weight = float(arm.mass_kg[1:].sum() * max(np.linalg.norm(arm.gravity), 9.81))
    reach = float(np.linalg.norm(arm.p_PF, axis=1).sum())
    force = PAYLOAD_SHARE * weight if weight > 1.0 else 1e3 / max(reach, 0.1) ** 2
    return float(f"{force:.1e}")


def load_options(settings: Design, arm: Arm) -> tuple[Array, Array]:
    """The loads a posture always gets and those it gets some of: (6, A), (6, B), N and N m in world axes.

    Down (if there is any) is hung on every posture; of the rest, each candidate draws what is left of `per_posture`.
    """
    loads, own = settings.loads, payload_force(arm)
    down = own if loads.down_N is None else loads.down_N
    across = own if loads.horizontal_N is None else loads.horizontal_N
    size = float(np.linalg.norm(arm.gravity))
    up = -arm.gravity / size if size > 0 else np.array([0.0, 0.0, 1.0])
    x = np.cross(np.eye(3)[1], up) if abs(up[1]) < 0.9 else np.cross(up, np.eye(3)[0])
    x /= np.linalg.norm(x)
    y = np.cross(up, x)
    turn = 2 * np.pi * np.arange(loads.horizontal_directions) / loads.horizontal_directions
    fixed, chosen = [], []
    if down > 0:
        fixed.append(np.append(-down * up, np.zeros(3)))
    if across > 0:
        chosen += [np.append(across * (np.cos(t) * x + np.sin(t) * y), np.zeros(3)) for t in turn]
    if loads.up_N > 0:
        chosen.append(np.append(loads.up_N * up, np.zeros(3)))
    chosen += [np.array([*v.force_N, *v.moment_Nm]) for v in loads.vectors]
    if not fixed and not chosen:
        raise InputError(
            f"{settings.path}: loads: all of them are zero; give down_N, horizontal_N, up_N (N) or vectors."
        )
    always, rest = np.array(fixed).reshape(-1, 6).T, np.array(chosen).reshape(-1, 6).T
    return np.round(always, 3) + 0.0, np.round(rest, 3) + 0.0  # as plans print them
