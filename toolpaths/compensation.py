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
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm, forward, joint_jacobian
from drake_stiffness.effects.effect import Cases
from drake_stiffness.equilibrium import Equilibrium, solve_equilibrium
from drake_stiffness.errors import NoEquilibriumError
from drake_stiffness.model import Model
from drake_stiffness.rotations import exponential, logarithm, multiply, rotate
from drake_stiffness.structure import Structure, build_structure
from toolpaths.postures import solve_damped

Floats = NDArray[np.float64]
Reference = Literal["unloaded", "rigid"]
# Loaded and (where the reference needs it) unloaded equilibria.
States = tuple[Equilibrium, Equilibrium | None]

CHUNK = 4096
_MAX_STEPS = 20
# Converged when no pose moves by more than this (m and rad): a thousandth of the last digit programs print.
_TOLERANCE = 1e-9


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
    """

    arm: Arm
    loaded: Structure
    R_ET: Floats
    p_ET: Floats
    reference: Reference

    def commanded(self, q: Floats) -> tuple[Floats, Floats]:
        """Pose (3, 3, N), (3, N) of the rigid arm's TCP: what the program says."""
        poses = forward(self.arm, q)
        return self._tool(poses.R_E, poses.p_E)

    def actual(self, q: Floats, wrench: Floats, start: States | None = None) -> tuple[Floats, Floats, States]:
        """Pose (3, 3, N), (3, N) at which the tool is under load, in the sense of the reference, and the states behind it.

        Parameters
        ----------
        start : the states of nearly the same joints, from which the equilibria start
        """
        cases = Cases(q, wrench, self.p_ET)
        loaded = solve_equilibrium(self.loaded, cases, start[0] if start else None)
        R, p = self._tool(loaded.R_E, loaded.p_E)
        if self.reference == "rigid":
            return R, p, (loaded, None)
        unloaded = solve_equilibrium(self.loaded, cases.unloaded(), start[1] if start else None)
        R_u, p_u = self._tool(unloaded.R_E, unloaded.p_E)
        rigid = forward(self.loaded.arm, q)  # with its geometric errors, if those are corrected too
        R_c, p_c = self._tool(rigid.R_E, rigid.p_E)
        return multiply(multiply(R, R_u.transpose(1, 0, 2)), R_c), p_c + p - p_u, (loaded, unloaded)

    def _tool(self, R_E: Floats, p_E: Floats) -> tuple[Floats, Floats]:
        return multiply(R_E, self.R_ET[:, :, None]), p_E + rotate(R_E, self.p_ET[:, None])


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
    before, one_shot, after : (N,)
        Distance of the tool from where it is wanted, m: uncorrected, after one step, converged.
    contraction : (N,)
        Ratio of the last two steps' sizes; 0 where the first step was enough.
    converged : (N,) bool
    steps : int
    """

    q: Floats
    R: Floats
    p: Floats
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

    Raises
    ------
    UntrustworthyError
        If a point has no stable loaded equilibrium.
    """
    parts = []
    for start in range(0, q0.shape[1], CHUNK):
        chunk = slice(start, start + CHUNK)
        try:
            parts.append(_mirror_chunk(bench, q0[:, chunk], wrench[:, chunk], position_only[chunk], free))
        except NoEquilibriumError as error:
            raise NoEquilibriumError(start + error.case, error.what) from None
        progress(min(start + CHUNK, q0.shape[1]))
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in _ARRAYS
    }
    return Corrected(**joined, steps=max(part.steps for part in parts))


_ARRAYS = ("q", "R", "p", "before", "one_shot", "after", "contraction", "converged")


def deviation(
    bench: Bench,
    q: Floats,
    wrench: Floats,
    R0: Floats,
    p0: Floats,
    position_only: NDArray[np.bool_],
    start: States | None = None,
) -> tuple[Floats, States]:
    """Twist (6, N) from where the tool is to where it is wanted (poses `R0`, `p0`), and the states behind it."""
    R, p, states = bench.actual(q, wrench, start)
    # Where the program writes no angles the commanded orientation stays, and nothing is asked of the real one.
    R_seen = np.where(position_only, bench.commanded(q)[0], R)
    return np.concatenate([p0 - p, logarithm(multiply(R0, R_seen.transpose(1, 0, 2)))]), states


def _mirror_chunk(
    bench: Bench, q0: Floats, wrench: Floats, position_only: NDArray[np.bool_], free: list[int]
) -> Corrected:
    R0, p0 = bench.commanded(q0)
    q = q0.copy()
    off, states = deviation(bench, q, wrench, R0, p0, position_only)
    before = one_shot = _length(off)
    last, contraction = np.full(q.shape[1], np.inf), np.zeros(q.shape[1])
    steps = 0
    while steps < _MAX_STEPS:
        size = np.abs(off).max(axis=0)
        seen = (last < np.inf) & (last > 100 * _TOLERANCE)
        contraction = np.where(seen, np.maximum(contraction, size / np.where(seen, last, 1.0)), contraction)
        last = size
        # A point whose steps grow is left where it is; it is refused in the end, its neighbours are not.
        alive = contraction <= 1.0
        if not (alive & (size > _TOLERANCE)).any():
            break
        q = np.where(alive, command(bench, q, off, free), q)
        off, states = deviation(bench, q, wrench, R0, p0, position_only, states)
        steps += 1
        if steps == 1:
            one_shot = _length(off)
    R, p = bench.commanded(q)
    converged = np.abs(off).max(axis=0) <= _TOLERANCE
    return Corrected(q, R, p, before, one_shot, _length(off), contraction, converged, steps)


def command(bench: Bench, q: Floats, twist: Floats, free: list[int]) -> Floats:
    """Joints whose rigid TCP is moved by a small twist (6, N) in the world: Newton on the rigid arm."""
    R, p = bench.commanded(q)
    return reach(bench, q, multiply(exponential(twist[3:]), R), p + twist[:3], free)


def reach(bench: Bench, q: Floats, R_goal: Floats, p_goal: Floats, free: list[int]) -> Floats:
    """Joints near `q` whose rigid TCP stands at a goal pose; two Newton steps square away millimetres."""
    q = q.copy()
    for _ in range(2):
        R, p = bench.commanded(q)
        off = np.concatenate([p_goal - p, logarithm(multiply(R_goal, R.transpose(1, 0, 2)))])
        poses = forward(bench.arm, q)
        tcp = poses.p_E + rotate(poses.R_E, bench.p_ET[:, None])
        J = joint_jacobian(bench.arm, poses, tcp)[free].transpose(2, 1, 0)
        q[free] += solve_damped(J, off.T).T
    return q


def _length(twist: Floats) -> Floats:
    return np.sqrt((twist[:3] ** 2).sum(axis=0))
