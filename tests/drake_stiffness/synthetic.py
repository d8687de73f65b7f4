"""Small campaigns: plans as cases, tables written with all digits and read back through the front door."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from three_arms import TRACK_CELL, TRACK_URDF, random_postures

from drake_stiffness.arm import Arm
from drake_stiffness.campaign import Measurements, Noise, read_measurements
from drake_stiffness.cell import Cell, read_cell
from drake_stiffness.effects.effect import Cases
from drake_stiffness.observation import observe

VERTICAL, SIDEWAYS, FORWARD = (0, 0, -2500.0), (0, 3500.0, 0), (3500.0, 0, 0)


def plan(
    arm: Arm, cell: Cell, postures: int, rng, loads=(VERTICAL, SIDEWAYS, FORWARD), *, rest: int = 1, factor: float = 1.0
) -> Cases:
    """Experiments of `rest` unloaded steps, then one step a load (3 or 6 numbers); `factor` scales loads."""
    q = random_postures(arm, postures, rng)
    steps = [np.zeros(6)] * rest + [
        factor * np.pad(np.asarray(load, dtype=float), (0, 6 - len(load))) for load in loads
    ]
    number = len(steps)
    return Cases(
        np.repeat(q, number, axis=1),
        np.tile(np.array(steps).T, postures),
        np.array(cell.load_point_m),
        np.repeat(np.arange(postures), number),
        np.tile(np.arange(number), postures),
        1000.0 * np.arange(postures * number)[::-1],
    )


def table_text(
    arm: Arm,
    cases: Cases,
    points: tuple[str, ...],
    p: np.ndarray,
    *,
    relative: bool = False,
    turn: np.ndarray | None = None,
) -> str:
    """measurements.csv of positions (or displacements) `p (P, 3, N)` in metres and rotations `turn (3, N)`, written in `_m`."""
    units = ["_m" if prismatic else "_rad" for prismatic in arm.prismatic]
    names = ["dx_m", "dy_m", "dz_m"] if relative else ["x_m", "y_m", "z_m"]
    header = ["experiment", "step", "point", "time_s", *(n + u for n, u in zip(arm.joint_names, units, strict=True))]
    header += ["fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm", *names]
    header += ["rx_rad", "ry_rad", "rz_rad"] if turn is not None else []
    lines = [",".join(header)]
    for i in range(cases.number):
        for place, point in enumerate(points):
            numbers = [cases.time_s[i], *cases.q[:, i], *cases.wrench[:, i], *p[place, :, i]]
            numbers += [] if turn is None else list(turn[:, i])
            cells = [f"E{cases.experiment[i]:03d}", str(cases.step[i]), point, *(repr(float(v)) for v in numbers)]
            lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def table(folder: Path, cell: Cell, arm: Arm, cases: Cases, p: np.ndarray, **options) -> Measurements:
    """The same, read back."""
    points = tuple(cell.reference_points_m)[: len(p)]
    path = folder / "measurements.csv"
    path.write_text(table_text(arm, cases, points, p, **options))
    return read_measurements(path, arm, tuple(cell.reference_points_m), np.array(cell.load_point_m), readings=True)


def noise(sigma_m: float, sigma_rad: float | None = None) -> Noise:
    return Noise(position_sigma_mm=sigma_m * 1e3, orientation_sigma_mrad=None if sigma_rad is None else sigma_rad * 1e3)


def watched(folder, cell, arm, cases, p, sigma_m, *, displacement=True, sigma_rad=None, **options):
    """Observations of a synthetic table."""
    return observe(table(folder, cell, arm, cases, p, **options), displacement, noise(sigma_m, sigma_rad))


def points_of(cell: Cell) -> np.ndarray:
    return np.array(list(cell.reference_points_m.values()))


def hand_made_arm(lengths, axes, masses=None, *, gravity=(0.0, 0.0, 0.0), tool_mass=0.0) -> Arm:
    """Joints at the ends of straight links along `lengths` (n + 1 vectors, the base first), frames parallel, masses at the tips."""
    lengths, n = np.array(lengths, dtype=float), len(axes)
    return Arm(
        joint_names=tuple(f"j{i + 1}" for i in range(n)),
        link_names=("ground", *(f"l{i + 1}" for i in range(n))),
        prismatic=(False,) * n,
        R_PF=np.broadcast_to(np.eye(3), (n + 1, 3, 3)).copy(),
        p_PF=lengths,
        axis_F=np.array(axes, dtype=float),
        lower=np.full(n, -np.inf),
        upper=np.full(n, np.inf),
        mass_kg=np.zeros(n + 1) if masses is None else np.array(masses, dtype=float),
        p_MCom=lengths.copy(),
        tool_mass_kg=tool_mass,
        p_ETool=np.zeros(3),
        gravity=np.array(gravity, dtype=float),
    )


def heavier(cell: Cell, x) -> Cell:
    """The cell with `x = (mass, three moments)` more on the flange, stated as a tool; what a payload error is."""
    mass = cell.tool.mass_kg + x[0]
    centre = tuple((mass * np.array(cell.tool.center_of_mass_m) + x[1:]) / mass)
    other = cell.model_copy(update={"tool": cell.tool.model_copy(update={"mass_kg": mass, "center_of_mass_m": centre})})
    other._path = cell._path
    return other


def reshaped_track(folder: Path, joint: str, x) -> Cell:
    """The track arm with the frame of a joint moved by (d, exp r) in its own axes, written as a robot description."""
    robot = ET.fromstring(TRACK_URDF)
    origin = robot.find(f"joint[@name='{joint}']/origin")
    R = Rotation.from_euler("xyz", np.array(origin.get("rpy").split(), dtype=float))
    place = np.array(origin.get("xyz").split(), dtype=float) + R.apply(x[:3])
    rpy = (R * Rotation.from_rotvec(x[3:])).as_euler("xyz")
    origin.set("xyz", " ".join(repr(float(v)) for v in place))
    origin.set("rpy", " ".join(repr(float(v)) for v in rpy))
    (folder / "reshaped.urdf").write_text(ET.tostring(robot, encoding="unicode"))
    (folder / "reshaped.yaml").write_text(TRACK_CELL.replace("track.urdf", "reshaped.urdf"))
    return read_cell(folder / "reshaped.yaml")
