"""The turn of the tool about its own axis, chosen so that the arm bends least along the path.

Five-axis work on a six-axis arm leaves one freedom: how the tool is turned about its axis. It decides where the elbow and the
wrist are, and with them the stiffness against the cutting force. Knots along the path get a grid of turns; of all smooth
sequences of turns that keep the arm inside limits, off singularities and on its branch, dynamic programming finds the one with
the least sum of squared predicted deflections. Between knots the turn is interpolated without overshoot, and the whole path is
then checked row by row.

The deflection that chooses is the linear one, J k J^T W (seed eq. 8): it ranks turns; what the correction uses is the loaded
equilibrium as everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm
from drake_stiffness.rotations import exponential
from drake_stiffness.simulation import linear_displacement
from toolpaths.analytic import SixAxes, six_axes
from toolpaths.branches import sides_of
from toolpaths.compensation import Bench
from toolpaths.postures import along_path, driven, outside_limits, singularity_margin
from toolpaths.program import Program

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_GRID = np.radians(np.arange(-180.0, 180.0, 10.0))
_MOST_KNOTS = 200
# Knots nearer than this would let the tool turn faster than a cut should see.
_LEAST_SPACING_M = 5e-3
# Grid steps that the turn may change by from knot to knot, and joint motion that still is the same branch, rad.
_REACH, _SAME_BRANCH = 2, 1.2
# Turning by one grid step costs this share of the mean squared deflection: where nothing is gained the tool does not turn.
_RESTLESS = 1e-2
# The margin kept from singularities is wider than what a path as programmed is held to.
_MARGIN = 0.02
# The turn keeps so far from joint limits: the correction that follows moves joints too.
_LIMIT_MARGIN = np.radians(1.0)
# Less than this share of the mean deflection is not worth another orientation.
_WORTH = 0.01
_ATTEMPTS = 6


@dataclass(frozen=True, eq=False)
class Spin:
    """Turns of the tool about its axis.

    Attributes
    ----------
    angle_rad : (N,)
        Turn at every row, from the orientation of the program; all zero where turning gains nothing.
    kept_mm, chosen_mm : (N,)
        Predicted deflection (linear) as programmed and as turned.
    why : str
        What was done and why, for the report.
    """

    angle_rad: Floats
    kept_mm: Floats
    chosen_mm: Floats
    why: str

    def notes(self, program: Program) -> list[str]:
        """What was done, and where the turns are if the program does not print them."""
        hidden = program.convention.axis_only and bool(self.angle_rad.any())
        where = (
            ". This program does not say how the tool is turned: whoever makes joint angles of it must turn it so "
            "(tool_turn_deg of --points, from the least turn that posture_deg begins with)"
        )
        return [f"--spin stiffest: {self.why}{where if hidden else ''}"]

    def to_dict(self) -> dict[str, object]:
        """For `--json`."""
        return {
            "largest_turn_deg": float(np.degrees(np.abs(self.angle_rad).max(initial=0.0))),
            "kept_mm": {"mean": float(self.kept_mm.mean()), "max": float(self.kept_mm.max())},
            "chosen_mm": {"mean": float(self.chosen_mm.mean()), "max": float(self.chosen_mm.max())},
            "why": self.why,
        }


@dataclass(frozen=True, eq=False)
class Ride:
    """A path the tool could be turned along.

    Attributes
    ----------
    bench : Bench
    R, p : (N, 3, 3), (N, 3)
        TCP poses as programmed, world, m.
    axis : (3,)
        The tool's axis in the TCP frame.
    wrench, wrench_turned : (6, N)
        At the TCP in world axes, as programmed and with the tool turned by half a turn (to see what turns with it).
    start : (n,)
        Posture that picks the branch.
    given : dict of joint number to (N,)
        Joints that the program drives.
    flips : (3, N)
        Where the program changes branches.
    """

    bench: Bench
    R: Floats
    p: Floats
    axis: Floats
    wrench: Floats
    wrench_turned: Floats
    start: Floats
    given: dict[int, Floats]
    flips: Bools

    @property
    def arm(self) -> Arm:
        """The arm that the controller inverts."""
        return self.bench.arm

    def turned(self, angle: Floats, rows: NDArray[np.int_] | slice = slice(None)) -> Floats:
        """Orientations (N, 3, 3) with the tool turned."""
        turn = exponential(self.axis[:, None] * angle).transpose(2, 0, 1)
        return np.asarray(self.R[rows] @ turn)

    def flange(self, R: Floats, rows: NDArray[np.int_] | slice = slice(None)) -> tuple[Floats, Floats]:
        """Flange poses of TCP orientations at the positions of the path."""
        R_WE = R @ self.bench.R_ET.T
        return R_WE, self.p[rows] - np.einsum("nij,j->ni", R_WE, self.bench.p_ET)

    def stays(self) -> Bools:
        """(N,) loads that do not turn with the tool."""
        change = np.abs(self.wrench - self.wrench_turned).max(axis=0)
        return np.asarray(change <= 1e-9 * (1 + np.abs(self.wrench).max(axis=0)))

    def load(self, angle: Floats, rows: NDArray[np.int_] | slice = slice(None)) -> Floats:
        """Wrench (6, N) with the tool turned: forces stated in the tool's axes turn with it, others stay."""
        w = self.wrench[:, rows]
        about = exponential((self.R[rows] @ self.axis).T * np.where(self.stays()[rows], 0.0, angle))
        return np.concatenate([np.einsum("ijn,jn->in", about, w[:3]), np.einsum("ijn,jn->in", about, w[3:])])

    def deflection_mm(self, q: Floats, wrench: Floats) -> Floats:
        """Predicted (linear) deflection of the TCP."""
        b = self.bench
        out = np.zeros(q.shape[1])
        for begin in range(0, out.size, 4096):
            part = slice(begin, begin + 4096)
            move = linear_displacement(b.loaded, q[:, part].T, wrench[:, part].T, b.p_ET, b.p_ET)
            out[part] = 1e3 * np.linalg.norm(move[:, :3], axis=1)
        return out

    def postures(self, angle: Floats, margin: float = 0.0) -> tuple[Floats, Bools]:
        """Joints (n, N) with the tool turned, and where they are sound: reached, inside limits by a margin, off singularities."""
        found = along_path(self.arm, *self.flange(self.turned(angle)), self.start, self.given, self.flips)
        sound = found.reached.copy()
        q = np.where(found.reached, found.q, 0.0)
        keep = np.zeros(self.arm.num_joints)
        keep[found.free] = margin
        narrow = replace(self.arm, lower=self.arm.lower + keep, upper=self.arm.upper - keep)
        sound[[row for row, _ in outside_limits(narrow, q)]] = False
        sound &= singularity_margin(self.arm, q) > _MARGIN
        return found.q, sound


def stiffest(ride: Ride) -> Spin:
    """The turn about the tool's axis that bends the arm least along a path.

    Returns
    -------
    Spin
        All zero, with the reason, where the arm has no analytic inverse or nothing is gained.
    """
    N = len(ride.p)
    none = np.zeros(N)
    q, sound = ride.postures(none)
    q = np.where(np.isfinite(q), q, 0.0)
    kept = ride.deflection_mm(q, ride.wrench)
    _, free = driven(ride.arm, ride.start, ride.given, N)
    solver = six_axes(ride.arm, [j for j in range(ride.arm.num_joints) if j not in free], free)
    if solver is None:
        return Spin(
            none,
            kept,
            kept,
            "the tool was not turned: all branches of this arm's inverse are needed, and are not known",
        )
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ride.p, axis=0), axis=1))])
    knots = _knots(s)
    able, q_node, cost = _nodes(ride, solver, q, knots)
    for _ in range(_ATTEMPTS):
        steps = _best(able, q_node, cost, free)
        if steps is None:
            return Spin(
                none, kept, kept, "the tool was not turned: no smooth sequence of turns keeps the arm inside its limits"
            )
        angle = _between(s, knots, _GRID[steps])
        q_turned, good = ride.postures(angle, _LIMIT_MARGIN)
        if good.all():
            chosen = ride.deflection_mm(q_turned, ride.load(angle))
            if chosen.mean() >= (1 - _WORTH) * kept.mean():
                return Spin(none, kept, kept, "the tool was not turned: it would gain less than one percent")
            gain = 100 * (1 - chosen.mean() / kept.mean())
            why = f"the tool was turned by up to {np.degrees(np.abs(angle).max()):.0f} deg: {gain:.0f} % less predicted deflection on average"
            if not ride.stays().all():
                why += (
                    "; the force is stated in the tool's axes and was turned with the tool, so part of the gain may be that it points elsewhere: "
                    "state a force that comes from the cut in path or workpiece axes"
                )
            return Spin(
                angle, kept, chosen, why if sound.all() else f"{why}; as programmed the path leaves limits or reach"
            )
        # Between knots something is wrong: bar the nodes next to it and plan anew.
        bad = np.unique(np.clip(np.searchsorted(knots, np.flatnonzero(~good)), 0, knots.size - 1))
        for k in {*bad.tolist(), *np.maximum(bad - 1, 0).tolist()}:
            able[k, steps[k]] = False
    return Spin(
        none,
        kept,
        kept,
        f"the tool was not turned: {_ATTEMPTS} plans left limits or came near a singularity between knots",
    )


def _knots(s: Floats) -> NDArray[np.int_]:
    """Rows at about equal distances along the path, first and last among them."""
    spacing = max(_LEAST_SPACING_M, s[-1] / _MOST_KNOTS)
    wanted = np.arange(0.0, s[-1], spacing)
    return np.unique(np.append(np.searchsorted(s, wanted), len(s) - 1)).astype(np.int_)


def _nodes(ride: Ride, solver: SixAxes, q: Floats, knots: NDArray[np.int_]) -> tuple[Bools, Floats, Floats]:
    """For knots and turns: whether the arm can stand there on the path's branch (K, S), its joints (6, K, S), squared mm (K, S)."""
    arm, free = ride.arm, solver.free
    K, S = knots.size, _GRID.size
    rows = np.repeat(knots, S)
    angle = np.tile(_GRID, K)
    given = {joint: values[rows] for joint, values in ride.given.items()}
    base, _ = driven(arm, ride.start, given, rows.size)
    branches = solver.branches(*ride.flange(ride.turned(angle, rows), rows), base)
    side = np.repeat(sides_of(arm, free, q[:, knots]), S, axis=1)
    lower, upper = arm.lower[free, None] + _LIMIT_MARGIN, arm.upper[free, None] - _LIMIT_MARGIN
    able = np.zeros(rows.size, dtype=bool)
    joints = base.copy()
    for b in range(branches.shape[1]):
        trial = base.copy()
        trial[free] = np.nan_to_num(branches[:, b])
        turns = 2 * np.pi
        # A turn more or less that lies inside the limits is found by the path's own continuity; here one must exist.
        inside = trial[free] + turns * np.ceil((lower - trial[free]) / turns - 1e-12) <= upper
        mine = ~np.isnan(branches[0, b]) & inside.all(axis=0) & (sides_of(arm, free, trial) == side).all(axis=0) & ~able
        joints[:, mine] = trial[:, mine]
        able |= mine
    able[able] &= singularity_margin(arm, joints[:, able]) > _MARGIN
    cost = np.full(rows.size, np.inf)
    cost[able] = ride.deflection_mm(joints[:, able], ride.load(angle, rows)[:, able]) ** 2
    return able.reshape(K, S), joints[free].reshape(6, K, S), cost.reshape(K, S)


def _best(able: Bools, q: Floats, cost: Floats, free: list[int]) -> NDArray[np.int_] | None:
    """Grid step of every knot: least cost of all sequences that start in the programmed turn's reach; None if there is none."""
    K, S = able.shape
    price = _RESTLESS * float(np.mean(cost[able])) if able.any() else 0.0
    cost = np.where(able, cost, np.inf)
    total = np.where(_reached_at_start(able[0], q[:, 0]), cost[0], np.inf)
    came = np.zeros((K, S), dtype=np.int_)
    for k in range(1, K):
        best, source = np.full(S, np.inf), np.zeros(S, dtype=np.int_)
        for step in range(-_REACH, _REACH + 1):
            to = np.arange(max(0, step), min(S, S + step))
            at = to - step
            jump = np.abs(_wrapped(q[:, k, to] - q[:, k - 1, at])).max(axis=0)
            value = np.where(jump < _SAME_BRANCH, total[at], np.inf) + price * step**2
            better = value < best[to]
            best[to] = np.where(better, value, best[to])
            source[to] = np.where(better, at, source[to])
        total, came[k] = best + cost[k], source
    if not np.isfinite(total).any():
        return None
    steps = np.zeros(K, dtype=np.int_)
    steps[-1] = int(np.argmin(total))
    for k in range(K - 1, 0, -1):
        steps[k - 1] = came[k, steps[k]]
    return steps


def _reached_at_start(able: Bools, q: Floats) -> Bools:
    """Turns that the arm can go to from the programmed one before the cut begins, step by step on one branch."""
    reached = np.zeros_like(able)
    zero = int(np.argmin(np.abs(_GRID)))
    for order in (range(zero, able.size), range(zero, -1, -1)):
        last = None
        for step in order:
            if not able[step] or (last is not None and np.abs(_wrapped(q[:, step] - q[:, last])).max() > _SAME_BRANCH):
                if last is not None:
                    break
                continue  # as programmed the arm cannot stand there; the nearest turn where it can begins
            reached[step], last = True, step
    return reached


def _between(s: Floats, knots: NDArray[np.int_], angle: Floats) -> Floats:
    """Turn of every row: monotone between knots, continuous slope (no overshoot, no kinks)."""
    if knots.size < 2:
        return np.full(s.size, angle[0])
    from scipy.interpolate import PchipInterpolator

    places, first = np.unique(s[knots], return_index=True)
    if places.size < 2:
        return np.full(s.size, angle[0])
    return np.asarray(PchipInterpolator(places, angle[first])(s))


def _wrapped(angle: Floats) -> Floats:
    wrapped: Floats = angle - 2 * np.pi * np.round(angle / (2 * np.pi))
    return wrapped
