"""How stiff the cell is over the area where workpieces may lie: deflection per 100 N place by place, and the best place.

Without a program every place is one tool point in the orientation of `posture_deg`. With one, the program's base frame is put at
every place in turn and the predicted deflection along its path under its own force decides. Deflections are linear, J k J^T W
(seed eq. 8), without weight: a map compares places, it does not correct.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError
from drake_stiffness.model import Model
from drake_stiffness.simulation import cartesian_compliance
from toolpaths.analytic import six_axes
from toolpaths.branches import continuous, sides_of
from toolpaths.compensation import Bench, bench_of
from toolpaths.forces import wrenches
from toolpaths.loaded_path import SINGULAR_BELOW, targets
from toolpaths.postures import along_path, driven, outside_limits, singularity_margin
from toolpaths.process import Process, external_positions, posture
from toolpaths.program import Program

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

SOUND, OUT_OF_REACH, OUTSIDE_LIMITS, SINGULAR = "ok", "out of reach", "outside limits", "singular"
_NEWTONS = 100.0
_CHUNK = 4096
# Rows of a program that stand for it at every place.
_MOST_ROWS = 40
COLUMNS = (
    "x_m", "y_m", "z_m", "state", "worst_um_per_100N", "along_x_um_per_100N", "along_y_um_per_100N", "along_z_um_per_100N",
    "program_mean_mm", "program_max_mm",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class StiffnessMap:
    """P places; the last is where process.yaml puts the workpiece (without a program: where the posture puts the tool).

    Attributes
    ----------
    place_m : (P, 3)
        World; of the tool point, or of the program's base frame.
    state : (P,)
        'ok', 'out of reach', 'outside limits' or 'singular': the worst along the program.
    worst_um : (P,)
        Deflection under 100 N in the direction that bends most (with a program: at its worst row); NaN where not ok.
    along_um : (P, 3)
        Length of the deflection under 100 N along x, y and z of the world.
    mean_mm, max_mm : (P,)
        Predicted deflection along the program under its own force; NaN without a program.
    """

    place_m: Floats
    state: NDArray[np.str_]
    worst_um: Floats
    along_um: Floats
    mean_mm: Floats
    max_mm: Floats

    @property
    def by_program(self) -> bool:
        """Whether a program decided."""
        return bool(np.isfinite(self.mean_mm).any())

    @property
    def measure(self) -> Floats:
        """(P,) what places are compared by: mean deflection along the program, mm, or the worst per 100 N, micrometres."""
        return self.mean_mm if self.by_program else self.worst_um

    @property
    def here(self) -> int:
        """The place as it is now."""
        return len(self.state) - 1

    @property
    def best(self) -> int:
        """The place with the least measure.

        Raises
        ------
        InputError
            No place can be reached.
        """
        if not np.isfinite(self.measure).any():
            kinds = ", ".join(sorted(set(self.state.tolist())))
            raise InputError(
                f"no place of the area can be machined ({kinds}); give another --area, posture_deg or orientation."
            )
        return int(np.nanargmin(self.measure))

    def to_dict(self) -> dict[str, Any]:
        """For `--json`."""
        rows = [dict(zip(COLUMNS, row, strict=True)) for row in self.rows()]
        return {"best": rows[self.best], "here": rows[self.here], "places": rows[:-1]}

    def rows(self) -> list[tuple[Any, ...]]:
        """Cells of a table with `COLUMNS`."""
        cells = np.column_stack([self.worst_um, self.along_um, self.mean_mm, self.max_mm]).tolist()
        return [
            (*place, state, *row)
            for place, state, row in zip(self.place_m.tolist(), self.state.tolist(), cells, strict=True)
        ]

    def csv(self) -> str:
        """The table, empty cells where nothing is known."""
        lines = [",".join(COLUMNS)]
        for row in self.rows()[:-1]:
            cells = (cell if isinstance(cell, str) else f"{cell:.6g}" if np.isfinite(cell) else "" for cell in row)
            lines.append(",".join(cells))
        return "\n".join(lines) + "\n"


def grid(low_m: Sequence[float], high_m: Sequence[float], step_m: float) -> Floats:
    """Places (P, 3) of a box, ends included, neighbours in sequence (back and forth)."""
    counts = [max(1, round((b - a) / step_m) + 1) for a, b in zip(low_m, high_m, strict=True)]
    x, y, z = (np.linspace(a, b, n) for a, b, n in zip(low_m, high_m, counts, strict=True))
    places = []
    for k in range(z.size):
        for j in range(y.size):
            row = x if (j + k * y.size) % 2 == 0 else x[::-1]
            places.append(np.column_stack([row, np.full(x.size, y[j]), np.full(x.size, z[k])]))
    return np.concatenate(places)


def stiffness_map(model: Model, process: Process, place_m: Floats, program: Program | None = None) -> StiffnessMap:
    """Deflection per 100 N, and under a program's own force, place by place.

    Parameters
    ----------
    place_m : (P, 3)
        World.
    program : Program, optional
        Its base frame is put at every place with the orientation of `process.workpiece`.

    Raises
    ------
    InputError
        The program has no motion with a pose, or its forces do not fit it.
    """
    start = posture(process, model)
    bench = bench_of(model, process.reference, process.geometry)
    here = np.array(process.workpiece.position_m) if program is not None else bench.commanded(start[:, None])[1][:, 0]
    place_m = np.vstack([place_m, here])
    R, offset, wrench, given = _tool_points(model, process, bench, start, program)
    M = len(R)
    at = np.repeat(place_m, M, axis=0) + np.tile(offset, (len(place_m), 1))
    R_all = np.tile(R, (len(place_m), 1, 1))
    everywhere = {joint: np.tile(values, len(place_m)) for joint, values in given.items()}
    q, state = _stand(bench, R_all, at, start, everywhere)
    worst, along, move = _bend(bench, q, state == SOUND, np.tile(wrench, (1, len(place_m))))
    shape = (len(place_m), M)
    sound = (state == SOUND).reshape(shape).all(axis=1)
    first_bad = np.argmax((state != SOUND).reshape(shape), axis=1)
    hidden = np.where(sound, 0.0, np.nan)
    return StiffnessMap(
        place_m=place_m,
        state=state.reshape(shape)[np.arange(len(place_m)), first_bad],
        worst_um=worst.reshape(shape).max(axis=1) + hidden,
        along_um=along.reshape(*shape, 3).max(axis=1) + hidden[:, None],
        mean_mm=move.reshape(shape).mean(axis=1) + hidden if program is not None else np.full(len(place_m), np.nan),
        max_mm=move.reshape(shape).max(axis=1) + hidden if program is not None else np.full(len(place_m), np.nan),
    )


def _tool_points(
    model: Model, process: Process, bench: Bench, start: Floats, program: Program | None
) -> tuple[Floats, Floats, Floats, dict[int, Floats]]:
    """What stands at every place: orientations (M, 3, 3), offsets (M, 3), wrenches (6, M), joints that the program drives."""
    if program is None:
        return bench.commanded(start[:, None])[0].transpose(2, 0, 1), np.zeros((1, 3)), np.zeros((6, 1)), {}
    rows = np.flatnonzero(program.corrected)
    if not rows.size:
        raise InputError(
            f"{program.path}: no linear or circular motion with a literal pose; there is nothing to place."
        )
    R, p = targets(program, process, bench, start)
    wrench = wrenches(process, program, rows, p, R[rows])
    given = external_positions(process, program, model, rows)
    taken = np.unique(np.linspace(0, rows.size - 1, min(rows.size, _MOST_ROWS)).round().astype(int))
    offset = p[rows[taken]] - np.array(process.workpiece.position_m)
    return R[rows[taken]], offset, wrench[:, taken], {joint: values[taken] for joint, values in given.items()}


def _stand(
    bench: Bench, R: Floats, p: Floats, start: Floats, given: dict[int, Floats]
) -> tuple[Floats, NDArray[np.str_]]:
    """Joints (n, N) on the branch of `start`, and what is wrong where something is."""
    arm = bench.arm
    R_WE = R @ bench.R_ET.T
    p_WE = p - np.einsum("nij,j->ni", R_WE, bench.p_ET)
    base, free = driven(arm, start, given, len(p))
    solver = six_axes(arm, [j for j in range(arm.num_joints) if j not in free], free)
    if solver is None:
        found = along_path(arm, R_WE, p_WE, start, given)
        q, reached = found.q, found.reached
    else:
        branches = solver.branches(R_WE, p_WE, base)
        mine = sides_of(arm, free, start[:, None])
        for b in range(branches.shape[1]):
            trial = base.copy()
            trial[free] = np.nan_to_num(branches[:, b])
            branches[:, b, (sides_of(arm, free, trial) != mine).any(axis=0)] = np.nan
        q = base
        # Places are not a path: each takes the turn nearest to the posture.
        q[free] = _nearest(branches, start[free], arm.lower[free], arm.upper[free])
        reached = np.asarray(np.isfinite(q[free]).all(axis=0))
    q = np.where(reached, q, 0.0)
    state = np.full(len(p), SOUND, dtype="<U14")
    state[singularity_margin(arm, q) < SINGULAR_BELOW] = SINGULAR
    state[[row for row, _ in outside_limits(arm, q)]] = OUTSIDE_LIMITS
    state[~reached] = OUT_OF_REACH
    return q, state


def _nearest(branches: Floats, start: Floats, lower: Floats, upper: Floats) -> Floats:
    """(6, N) the remaining solution of every place, turns inside the limits."""
    out = np.full((6, branches.shape[2]), np.nan)
    for row in np.flatnonzero(~np.isnan(branches[0]).all(axis=0)).tolist():
        out[:, row] = continuous(branches[:, :, row : row + 1], start, lower, upper)[:, 0]
    return out


def _bend(bench: Bench, q: Floats, sound: Bools, wrench: Floats) -> tuple[Floats, Floats, Floats]:
    """Micrometres per 100 N in the worst direction (N,) and along x, y, z (N, 3); deflection under the wrench, mm (N,)."""
    N = q.shape[1]
    worst, along, move = np.zeros(N), np.zeros((N, 3)), np.zeros(N)
    places = np.flatnonzero(sound)
    for begin in range(0, places.size, _CHUNK):
        part = places[begin : begin + _CHUNK]
        C = cartesian_compliance(bench.loaded, q[:, part].T, bench.p_ET)
        force = C[:, :3, :3]
        worst[part] = np.linalg.norm(force, ord=2, axis=(1, 2)) * _NEWTONS * 1e6
        along[part] = np.linalg.norm(force, axis=1) * _NEWTONS * 1e6
        move[part] = np.linalg.norm(np.einsum("nij,jn->ni", C[:, :3], wrench[:, part]), axis=1) * 1e3
    return worst, along, move
