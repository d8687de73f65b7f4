"""The interface of an effect: what it is called, what its unknowns are, and where it acts on the way from load to reading.

The way has four stations, and an effect overrides the hook of the station where it acts:

1. `on_arm` - the arm itself: geometric errors, a payload;
2. `on_wrench` - the applied wrench: errors of the force sensor;
3. `compliance` (linear springs), `torque` (hardware that turns a joint by a torque of its own, a function of posture and
   deflection) or `deflection` (anything else: nonlinear, history-dependent) - what the carried torques do to the joints
   and links, inside the loaded equilibrium;
4. `on_reading` - what the tracker makes of it: its frame, the reflectors, drift.

Nothing else in the program knows an effect's physics. Identification needs derivatives: linear springs have analytic ones
(seed eq. 9), every other effect gets central differences of the loaded equilibrium unless it offers better.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.rotations import Array

if TYPE_CHECKING:
    from drake_stiffness.arm import Arm

Station = Literal["arm", "wrench", "spring", "reading"]
# What a campaign must have to show an effect: any load; three levels of it; loading and unloading; times; absolute positions;
# many different angles; compliances that are not fitted along.
Need = Literal["load", "levels", "unloading", "time", "positions", "angles", "known_springs"]


@dataclass(frozen=True)
class Parameter:
    """One unknown of an effect.

    Attributes
    ----------
    name : str
        Short name inside the effect, `k` or `k26` or `dx`.
    unit : str
        SI.
    scale : float
        A typical size in SI. Unknowns are solved for in this unit, so it decides what "minimum norm" means where data
        leave something open, and the step of finite differences.
    lower, upper : float
        Bounds in SI.
    """

    name: str
    unit: str
    scale: float
    lower: float = -np.inf
    upper: float = np.inf


@dataclass(frozen=True, eq=False)
class Cases:
    """N loaded states of the arm: every step of every experiment once.

    Attributes
    ----------
    q : (n, N)
        Commanded joints, rad or m.
    wrench : (6, N)
        Applied at the load point, world axes.
    p_ELoad : (3,) or (3, N)
        Load point in the flange frame.
    experiment, step : (N,)
        Which experiment, and the order inside it: load history starts afresh with every experiment.
    time_s : (N,)
        As the table says; NaN where unknown.
    """

    q: Array
    wrench: Array
    p_ELoad: Array
    experiment: NDArray[np.int_] = field(default_factory=lambda: np.zeros(0, dtype=int))
    step: NDArray[np.int_] = field(default_factory=lambda: np.zeros(0, dtype=int))
    time_s: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def number(self) -> int:
        return self.q.shape[1]

    def unloaded(self) -> Cases:
        """The same postures under weight alone."""
        return Cases(self.q, np.zeros_like(self.wrench), self.p_ELoad, self.experiment, self.step, self.time_s)

    def take(self, which: NDArray[np.int_] | slice) -> Cases:
        """Some of the cases."""
        load = self.p_ELoad if self.p_ELoad.ndim == 1 else self.p_ELoad[:, which]
        return Cases(
            self.q[:, which],
            self.wrench[:, which],
            load,
            self.experiment[which] if self.experiment.size else self.experiment,
            self.step[which] if self.step.size else self.step,
            self.time_s[which] if self.time_s.size else self.time_s,
        )


@dataclass(frozen=True, eq=False)
class Carried:
    """What the springs carry at the present iterate of the equilibrium, weight included.

    Attributes
    ----------
    tau_joint : (n, N)
    tau_link : n + 1 entries of (6, N) or None
    weight_joint : (n, N)
        What weight alone makes the joints carry at the undeflected posture: the state in which load history starts.
    """

    tau_joint: Array
    tau_link: list[Array | None]
    weight_joint: Array


@dataclass(frozen=True, eq=False)
class Reading:
    """What is read: positions of the reference points and the orientation of the flange, for M readings.

    Attributes
    ----------
    p : (3, M)
        Position in the world (or whatever frame an effect has turned it into), m.
    R : (3, 3, M)
        Orientation of the flange in that frame.
    point : (M,)
        Name of the reference point of every reading.
    case : (M,)
        Which of the cases it belongs to.
    """

    p: Array
    R: Array
    point: NDArray[np.str_]
    case: NDArray[np.int_]


class Effect(ABC):
    """Base of all effects. Subclasses set `kind` and `station`, list `parameters`, and override one hook.

    Parameters
    ----------
    where : str
        Joint, link, point or instrument (FORMATS: kinds and where).
    """

    kind: ClassVar[str]
    station: ClassVar[Station]
    needs: ClassVar[tuple[Need, ...]] = ()
    refines: ClassVar[str | None] = None  # a kind without which, at the same place, this one makes no sense

    def __init__(self, where: str) -> None:
        self.where = where

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The unknowns, in the order of the effect's slice of the parameter vector."""
        raise TypeError(f"{type(self).__name__} does not list its parameters")

    @property
    def cone_blocks(self) -> tuple[NDArray[np.int_], ...]:
        """Square arrays of numbers of own unknowns that must form positive-semidefinite matrices; -1 marks a zero."""
        return ()

    @property
    def names(self) -> tuple[str, ...]:
        """Full names of the unknowns in a model: `where.kind.name`, or `where.kind` when there is just one."""
        stem = f"{self.where}.{self.kind}"
        if len(self.parameters) == 1:
            return (stem,)
        return tuple(f"{stem}.{parameter.name}" for parameter in self.parameters)

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        """Every place this kind can be at, and every constant worth trying there: what diagnosis tries. None by default."""
        yield from ()

    def neighbours(self, step: float) -> Iterator[Effect]:
        """The same effect with its nonlinear constants a little changed, by about `step` of themselves. None by default."""
        yield from ()

    def idle(self, arm: Arm, carried: Carried) -> bool:
        """Whether what joints and links carry never reaches what makes this effect different: then no search tries it."""
        return False

    @property
    def bounded(self) -> bool:
        """Whether what it adds stays as it is beyond some load: of forms that fit within noise a search takes one that does."""
        return False

    @property
    def conventional(self) -> tuple[str, ...]:
        """Unknowns whose values are a matter of convention once a search chose the constants: they have no sigma of their own."""
        return ()

    def derived(self, x: Array) -> dict[str, tuple[float, str]]:
        """What the unknowns amount to whatever the convention: name to value and unit. None by default."""
        return {}

    def timed_from(self, start_s: float) -> Effect:
        """The same effect with its time counted from the first reading; itself where time is nothing to it."""
        return self

    def further(self) -> Iterator[Effect]:
        """What of the same kind may be at the same place besides, each alone: other harmonics. None by default."""
        yield from ()

    def joined(self, other: Effect) -> Effect:
        """One effect that is this one and one of `further`; its unknowns are those of this one, then of the other."""
        raise TypeError(f"{type(self).__name__} is one of a kind at its place")

    def settings(self) -> dict[str, object]:
        """What besides `kind` and `where` is needed to make this effect again (goes into `model.json`)."""
        return {}

    def initial(self) -> Array:
        """Where identification starts."""
        return np.zeros(len(self.parameters))

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        """Raise InputError if `where` does not exist on this arm."""

    def on_arm(self, arm: Arm, x: Array) -> Arm:
        """The arm as it really is."""
        return arm

    def on_wrench(self, wrench: Array, cases: Cases, R_E: Array, x: Array) -> Array:
        """The wrench `(6, N)` that really acts when `wrench` was stated; `R_E (3, 3, N)` turns with the tool."""
        return wrench

    def compliance(self, arm: Arm, x: Array, joint: Array, link: dict[int, Array]) -> None:
        """Add this spring to the compliances `joint (n,)` and `link[k] (6, 6)` (own arrays of the caller)."""

    def torque(self, arm: Arm, q: Array, theta: Array, x: Array) -> dict[int, Array]:
        """Further torque (force) `(N,)` on joints, by number, that they carry beside weight and wrench.

        A function of the commanded joints `q (n, N)` and their deflections `theta (n, N)` alone, smooth, and for each joint
        of its own deflection only. How it changes with the deflection enters stability and the springs' columns.
        """
        return {}

    def deflection(self, arm: Arm, carried: Carried, cases: Cases, x: Array) -> dict[int, Array]:
        """Further deflection `(N,)` of joints, by number, beyond the linear springs."""
        return {}

    def on_reading(self, reading: Reading, cases: Cases, x: Array) -> Reading:
        """What the instruments make of it."""
        return reading
