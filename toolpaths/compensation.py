"""Pre-deforming a path: the mirror iteration on the loaded equilibrium.

Wanted is that the loaded tool follows the path of the unloaded one. With g(t) where the tool really is when t is commanded,

    t_{k+1} = t_k + (t_0 - g(t_k))

whose fixed point is g(t) = t_0. For `reference: unloaded` the tool's deflection is loaded minus unloaded-with-weight at the
same commanded joints, so g(t) = t (+) [loaded(q) - unloaded(q)]; for `rigid` sag counts too, g(t) = loaded(q). The
iteration contracts when the deflection changes little over a correction; that is observed point by point, and a point where
it does not contract is refused.

All rows are worked on as arrays, in chunks, on joint positions: a step in the tool's pose is a step J^-1 of the rigid arm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm, Poses, forward, joint_jacobian
from drake_stiffness.effects.effect import Cases
from drake_stiffness.equilibrium import Equilibrium, solve_equilibrium
from drake_stiffness.errors import NoEquilibriumError
from drake_stiffness.model import Model
from drake_stiffness.rotations import logarithm, multiply, rotate_fixed
from drake_stiffness.structure import Structure, build_structure
from toolpaths.damped import damped_step
from toolpaths.history import PathOrder, remembers
from toolpaths.linear import linear_deflection, moved

Floats = NDArray[np.float64]
Reference = Literal["unloaded", "rigid"]
# Loaded and (where the reference needs it) unloaded equilibria.
States = tuple[Equilibrium, Equilibrium | None]

# Which points, and where their tools are less where they are wanted (3, n), m, world: to their wrench (6, n).
Follows = Callable[[slice, Floats], Floats]

CHUNK, _MAX_STEPS = 5000, 20
# Rounds in which force and depth of cut settle, and the change of the tool's place, m, at which they have.
_ROUNDS, _SETTLED = 30, 1e-8
# Converged when no pose moves by more than this (m and rad): a thousandth of the last digit programs print.
_TOLERANCE = 1e-9
# A step that leaves less than the tolerance, shrinking as it did before, is taken without looking again.
_SMOOTH = 0.1
# Deflections (rad and m) are found to this: what is said of a tool that is metres away is then right to a hundredth of a nanometre.
_DEFLECTION_TOLERANCE = 3e-12


@dataclass(frozen=True, eq=False)
class Bench:
    """What is needed to say where the tool really is.

    Attributes
    ----------
    arm : Arm
        The rigid arm that the controller inverts.
    loaded : Structure
        The arm with its springs (and its geometric errors, if those are corrected too).
    R_ET, p_ET : (3, 3), (3,)
        The tool centre point in the flange frame.
    reference : 'unloaded' or 'rigid'
    order : PathOrder or None
        The path as one history, for effects that remember; None: every point comes straight from weight alone.
    linear : bool
        Whether deflections are superposed on the undeflected arm (`toolpaths.linear`) instead of found in equilibrium.
    """

    arm: Arm
    loaded: Structure
    R_ET: Floats
    p_ET: Floats
    reference: Reference
    order: PathOrder | None = None
    linear: bool = False

    @property
    def remembers(self) -> bool:
        """Whether the equilibria of a path must be found in its order and as a whole."""
        return remembers(self.loaded)

    def on_path(self, order: PathOrder) -> Bench:
        """The same bench for one path; its order matters only where something remembers."""
        return replace(self, order=order) if self.remembers else self

    def commanded(self, q: Floats) -> tuple[Floats, Floats]:
        """Pose (3, 3, N), (3, N) of the rigid arm's TCP: what the program says."""
        poses = forward(self.arm, q)
        return self.tool(poses.R_E, poses.p_E)

    def actual(self, q: Floats, wrench: Floats, start: States | None = None) -> tuple[Floats, Floats, States | None]:
        """Pose (3, 3, N), (3, N) at which the tool is under load, in the sense of the reference, and the states behind it.

        Parameters
        ----------
        start : the states of nearly the same joints, from which the equilibria start
        """
        if self.linear:
            poses = forward(self.loaded.arm, q)
            twist = linear_deflection(self.loaded, poses, wrench, self.p_ET, weight=self.reference == "rigid")
            return *moved(twist, *self.tool(poses.R_E, poses.p_E)), start
        in_order = self.order.cases(q, wrench, self.p_ET) if self.order else None
        cases = in_order or Cases(q, wrench, self.p_ET)
        loaded = solve_equilibrium(self.loaded, cases, start[0] if start else None, _DEFLECTION_TOLERANCE)
        R, p = self.tool(*self._at_points(loaded))
        if self.reference == "rigid":
            return R, p, (loaded, None)
        unloaded = solve_equilibrium(self.loaded, cases.unloaded(), start[1] if start else None, _DEFLECTION_TOLERANCE)
        R_u, p_u = self.tool(*self._at_points(unloaded))
        rigid = forward(self.loaded.arm, q)  # with its geometric errors, if those are corrected too
        R_c, p_c = self.tool(rigid.R_E, rigid.p_E)
        return multiply(multiply(R, R_u.transpose(1, 0, 2)), R_c), p_c + p - p_u, (loaded, unloaded)

    def _at_points(self, found: Equilibrium) -> tuple[Floats, Floats]:
        """The flange at the path's own points, without the states between its cuts."""
        if self.order is None:
            return found.R_E, found.p_E
        return found.R_E[:, :, self.order.loaded], found.p_E[:, self.order.loaded]

    def tool(self, R_E: Floats, p_E: Floats) -> tuple[Floats, Floats]:
        """The TCP's pose from the flange's."""
        return multiply(R_E, self.R_ET[:, :, None]), p_E + rotate_fixed(R_E, self.p_ET)


def bench_of(model: Model, reference: Reference, geometry: bool) -> Bench:
    """The bench of a model; without `geometry` its geometric effects bend nothing."""
    pairs = list(zip(model.effects, model.values, strict=True))
    if not geometry:
        pairs = [(e, x) for e, x in pairs if e.kind not in ("joint_zero_offset", "link_geometry")]
    structure = build_structure(model.arm, [e for e, _ in pairs], [x for _, x in pairs])
    # The force of the process is what it is: errors of a campaign's force sensor have no part in it.
    return Bench(model.arm, replace(structure, wrench_effects=()), *model.tcp, reference)


@dataclass(frozen=True, eq=False)
class Corrected:
    """The outcome for N points of a path.

    Attributes
    ----------
    q : (n, N)
        Joint positions to command, rad and m.
    R, p : (3, 3, N), (3, N)
        TCP poses to command, world.
    deflection : (3, N)
        Where the uncorrected tool is less where it is wanted, m, world.
    before, one_shot, after : (N,)
        Distance of the tool from where it is wanted, m: uncorrected, after one step, converged (a bound where the last step,
        of nanometres, was taken without looking again).
    contraction : (N,)
        Ratio of the last two steps' sizes; 0 where the first step was enough.
    converged : (N,) bool
    steps : int
    """

    q: Floats
    R: Floats
    p: Floats
    deflection: Floats
    before: Floats
    one_shot: Floats
    after: Floats
    contraction: Floats
    converged: NDArray[np.bool_]
    steps: int


def mirror(
    bench: Bench,
    q0: Floats,
    wrench: Floats,
    position_only: NDArray[np.bool_],
    free: list[int],
    progress: Callable[[int], None] = lambda done: None,
    aim: Floats | None = None,
    follows: Follows | None = None,
) -> Corrected:
    """Pre-deform N points.

    Parameters
    ----------
    q0 : (n, N)
        Joints of the program as it is.
    wrench : (6, N)
        On the tool at the TCP, world axes.
    position_only : (N,)
        Points whose orientation the program does not write: only positions are corrected there.
    free : joints that may move; others are driven by the program itself.
    progress : called with the number of points done.
    aim : (3, N), optional
        Where the tool is to go instead of where the program says, less that, m, world: what a probe has measured, mirrored.
    follows : optional
        How the wrench follows the place of the tool (the depth of cut); without it the wrench stays what it is.

    Raises
    ------
    UntrustworthyError
        If a point has no stable loaded equilibrium.
    """
    parts = []
    size = q0.shape[1] if bench.order else CHUNK  # what remembers must see the whole path
    for start in range(0, q0.shape[1], size):
        chunk = slice(start, start + size)
        try:
            shift = None if aim is None else aim[:, chunk]
            follow = None if follows is None else partial(follows, chunk)
            parts.append(
                _mirror_chunk(bench, q0[:, chunk], wrench[:, chunk], position_only[chunk], free, shift, follow)
            )
        except NoEquilibriumError as error:
            case = int(bench.order.point[error.case]) if bench.order else start + error.case
            raise NoEquilibriumError(case, error.what) from None
        progress(min(start + size, q0.shape[1]))
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in _ARRAYS
    }
    return Corrected(**joined, steps=max(part.steps for part in parts))


_ARRAYS = ("q", "R", "p", "deflection", "before", "one_shot", "after", "contraction", "converged")


def deviation(
    bench: Bench,
    q: Floats,
    wrench: Floats,
    R0: Floats,
    p0: Floats,
    position_only: NDArray[np.bool_],
    start: States | None = None,
) -> tuple[Floats, States | None]:
    """Twist (6, N) from where the tool is to where it is wanted (poses `R0`, `p0`), and the states behind it."""
    R, p, states = bench.actual(q, wrench, start)
    if position_only.any():
        # Where the program writes no angles the commanded orientation stays, and nothing is asked of the real one.
        R = np.where(position_only, bench.commanded(q)[0], R)
    return np.concatenate([p0 - p, logarithm(multiply(R0, R.transpose(1, 0, 2)))]), states


def _settled(
    bench: Bench,
    q: Floats,
    follow: Callable[[Floats], Floats],
    R0: Floats,
    p0: Floats,
    position_only: NDArray[np.bool_],
    off: Floats,
    states: States | None,
) -> Floats:
    """Twist (6, N) as `deviation`, from that at the wrench of the stated depth, once force and depth of cut agree.

    Rounds of place, depth, force, place; every second one is extrapolated along its change (Aitken), because one direction dominates.
    """
    place, before = -off[:3], None
    for _ in range(_ROUNDS):
        off, states = deviation(bench, q, follow(place), R0, p0, position_only, states)
        change = -off[:3] - place
        if np.abs(change).max(initial=0.0) < _SETTLED:
            break
        place = -off[:3]
        if before is None:
            before = change
            continue
        size = (before * before).sum(axis=0)
        ratio = np.clip((change * before).sum(axis=0) / np.where(size > 0, size, 1.0), -0.9, 0.9)
        place, before = place + change * ratio / (1 - ratio), None
    return off


def _mirror_chunk(
    bench: Bench,
    q0: Floats,
    wrench: Floats,
    position_only: NDArray[np.bool_],
    free: list[int],
    aim: Floats | None,
    follow: Callable[[Floats], Floats] | None,
) -> Corrected:
    """One chunk of `mirror`.

    Where the force follows the depth of cut the first step answers to the depth that the uncorrected tool really cuts. The fixed point has
    the stated depth and with it the stated force, so further steps are taken with that; whether the loop contracts is `depth_gain`.
    """
    R0, p0 = bench.commanded(q0)
    p0 = p0 if aim is None else p0 + aim
    q = q0.copy()
    off, states = deviation(bench, q, wrench, R0, p0, position_only)
    if follow is not None:
        off = _settled(bench, q, follow, R0, p0, position_only, off, states)
    before = one_shot = _length(off)
    deflection = -off[:3]
    last, contraction = np.full(q.shape[1], np.inf), np.zeros(q.shape[1])
    steps = 0
    smooth = bench.order is None and follow is None  # nothing jumps
    while True:
        size = np.abs(off).max(axis=0)
        seen = (last < np.inf) & (last > 100 * _TOLERANCE)
        contraction = np.where(seen, np.maximum(contraction, size / np.where(seen, last, 1.0)), contraction)
        last = size
        # A point whose steps grow is left where it is; it is refused in the end, its neighbours are not.
        alive = contraction <= 1.0
        sure = smooth & (contraction > 0) & (contraction < _SMOOTH) & (contraction * size <= _TOLERANCE)
        converged = (size <= _TOLERANCE) | sure
        if steps == _MAX_STEPS or not (alive & ~converged).any():
            break
        # The first step is that of the one-shot correction and is made exactly; the others are micrometres.
        q = np.where(alive, command(bench, q, off, free, 1 if steps else 2), q)
        off, states = deviation(bench, q, wrench, R0, p0, position_only, states)
        steps += 1
        if steps == 1:
            real = off if follow is None else _settled(bench, q, follow, R0, p0, position_only, off, states)
            one_shot = _length(real)
    if sure.any():
        q = np.where(sure, command(bench, q, off, free, 1), q)
        off = np.where(sure, contraction * off, off)
    R, p = bench.commanded(q)
    return Corrected(q, R, p, deflection, before, one_shot, _length(off), contraction, converged, steps)


def command(bench: Bench, q: Floats, twist: Floats, free: list[int], newton_steps: int = 2) -> Floats:
    """Joints whose rigid TCP is moved by a small twist (6, N) in the world: Newton on the rigid arm."""
    poses = forward(bench.arm, q)
    R, p = bench.tool(poses.R_E, poses.p_E)
    return reach(bench, _stepped(bench, poses, q, p, twist, free), *moved(twist, R, p), free, newton_steps - 1)


def reach(bench: Bench, q: Floats, R_goal: Floats, p_goal: Floats, free: list[int], newton_steps: int = 2) -> Floats:
    """Joints near `q` whose rigid TCP stands at a goal pose; two Newton steps square away millimetres, one micrometres."""
    for _ in range(newton_steps):
        poses = forward(bench.arm, q)
        R, p = bench.tool(poses.R_E, poses.p_E)
        off = np.concatenate([p_goal - p, logarithm(multiply(R_goal, R.transpose(1, 0, 2)))])
        q = _stepped(bench, poses, q, p, off, free)
    return q


def _stepped(bench: Bench, poses: Poses, q: Floats, p: Floats, twist: Floats, free: list[int]) -> Floats:
    """One Newton step from joints `q` with `poses` and TCP `p`."""
    q = q.copy()
    q[free] += damped_step(joint_jacobian(bench.arm, poses, p)[free], twist)
    return q


def _length(twist: Floats) -> Floats:
    return np.sqrt((twist[:3] ** 2).sum(axis=0))
