"""Jacobians per second and loaded equilibria on the KR 270: whole arrays of postures against loops of library calls.

Run: python benchmarks/bench_jacobians.py [--postures 20000]

Every competitor computes the same numbers for the same postures; that they agree (to 1e-9) is checked before anything is
timed. They are timed in turn, several rounds in one run. A Drake or pinocchio loop is what a Python user writes around
their one-posture calls; both libraries are faster from C++.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Callable
from typing import Any

from table import KR270, THREADS, in_turn, show, spread

for _name in THREADS:
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402  (reads the number of threads when it is imported)

AGREE = 1e-9
ROUNDS = 7


def pinocchio_loop(urdf: str, frame: str) -> Callable[[np.ndarray], np.ndarray] | None:
    """(N, n) postures to (N, 6, n) frame Jacobians, world axes, linear rows first; None without pinocchio."""
    try:
        import pinocchio as pin
    except ImportError:
        return None
    model = pin.buildModelFromUrdf(urdf)
    data, number, axes = model.createData(), model.getFrameId(frame), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

    def loop(q: np.ndarray) -> np.ndarray:
        out = np.empty((q.shape[0], 6, model.nv))
        for i in range(q.shape[0]):
            out[i] = pin.computeFrameJacobian(model, data, q[i], number, axes)
        return out

    return loop


def drake_loop(cell: Any) -> Callable[[np.ndarray], np.ndarray]:
    """The same from Drake's rigid plant."""
    from pydrake.multibody.tree import JacobianWrtVariable

    from drake_stiffness.plant import find_chain, parse_plant

    plant = parse_plant(cell)
    chain = find_chain(plant, cell)
    plant.Finalize()
    context, world, speed = plant.CreateDefaultContext(), plant.world_frame(), JacobianWrtVariable.kV
    order, origin = [3, 4, 5, 0, 1, 2], np.zeros(3)

    def loop(q: np.ndarray) -> np.ndarray:
        out = np.empty((q.shape[0], 6, plant.num_velocities()))
        for i in range(q.shape[0]):
            plant.SetPositions(context, q[i])
            J = plant.CalcJacobianSpatialVelocity(context, speed, chain.flange, origin, world, world)
            out[i] = J[order]
        return out

    return loop


class DrakeEquilibrium:
    """The fixed point theta = k tau through calls to the elastic Drake plant, one posture at a time."""

    def __init__(self, cell: Any) -> None:
        from pydrake.multibody.tree import JacobianWrtVariable

        from drake_stiffness.plant import build_elastic_plant

        self.e = build_elastic_plant(cell)
        self.plant, self.speed = self.e.plant, JacobianWrtVariable.kV
        self.context, self.world = self.plant.CreateDefaultContext(), self.plant.world_frame()
        self.q_joint = [j.position_start() for j in self.e.joints]
        self.q_spring = [j.position_start() for j in self.e.joint_springs]
        self.v_spring = [j.velocity_start() for j in self.e.joint_springs]
        # RpyFloatingJoint: positions roll, pitch, yaw, x, y, z; velocities angular, then linear.
        self.q_link = np.array([j.position_start() for j in self.e.link_springs])[:, None] + [3, 4, 5, 0, 1, 2]
        self.v_link = np.array([j.velocity_start() for j in self.e.link_springs])[:, None] + [3, 4, 5, 0, 1, 2]
        self.load = np.array(cell.load_point_m)
        self.calls_s, self.iterations = 0.0, 0

    def solve(self, q: np.ndarray, wrench: np.ndarray, k_joint: np.ndarray, k_link: np.ndarray) -> np.ndarray:
        """Loaded flange position of one posture."""
        from drake_stiffness.rotations import conjugate_moment, exponential

        n, plant = k_joint.size, self.plant
        x, spatial = np.zeros(plant.num_positions()), np.concatenate([wrench[3:], wrench[:3]])
        x[self.q_joint] = q
        theta = np.zeros((7, 6))
        joint = np.zeros(n)
        while True:
            R = exponential(theta[:, 3:].T)
            rpy = (np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(R[2, 0]), np.arctan2(R[1, 0], R[0, 0]))
            x[self.q_spring] = joint
            x[self.q_link] = np.concatenate([theta[:, :3], np.stack(rpy, axis=1)], axis=1)
            start = time.perf_counter()
            plant.SetPositions(self.context, x)
            J = plant.CalcJacobianSpatialVelocity(
                self.context, self.speed, self.e.end, self.load, self.world, self.world
            )
            tau = plant.CalcGravityGeneralizedForces(self.context)
            self.calls_s += time.perf_counter() - start
            self.iterations += 1
            tau = tau + spatial @ J
            carried = tau[self.v_link]
            carried[:, 3:] = conjugate_moment(theta[:, 3:].T, carried[:, 3:].T).T
            new, new_joint = np.einsum("kij,kj->ki", k_link, carried), k_joint * tau[self.v_spring]
            change = max(np.abs(new - theta).max(), np.abs(new_joint - joint).max())
            theta, joint = new, new_joint
            if change < 1e-13:
                return np.asarray(self.e.end.CalcPoseInWorld(self.context).translation())


def check(what: str, a: np.ndarray, b: np.ndarray) -> str:
    """Say how well two competitors agree; stop the benchmark if they do not compute the same thing."""
    worst = float(np.abs(a - b).max())
    if not worst < AGREE:
        raise SystemExit(f"{what}: the two differ by {worst:.2g}, so there is nothing to compare")
    return f"{what}: largest difference {worst:.1e}"


def jacobians(arm: Any, cell: Any, q: np.ndarray) -> None:
    """Table of Jacobians per second."""
    from drake_stiffness.arm import chain_jacobian, forward, joint_jacobian

    def ours(q: np.ndarray) -> np.ndarray:
        poses = forward(arm, q.T)
        return joint_jacobian(arm, poses, poses.p_E).transpose(2, 1, 0)

    def chunked(q: np.ndarray) -> np.ndarray:
        return np.concatenate([ours(q[i : i + 2048]) for i in range(0, q.shape[0], 2048)])

    pin, drake = pinocchio_loop(str(cell.robot_path), cell.robot.flange), drake_loop(cell)
    few, notes = q[:500], []
    notes.append(check("this program and Drake", ours(few), drake(few)))
    notes.append(check("6 of the 48 columns", ours(few), chain_jacobian(arm, few, np.zeros(3))[0][:, :, :6]))
    functions: dict[str, Callable[[], object]] = {
        "arrays, 6 dof, one call": lambda: ours(q),
        "arrays, 6 dof, chunks of 2048": lambda: chunked(q),
        "Drake loop, 6 dof": lambda: drake(q[:2000]),
        "arrays, 48 dof (chain_jacobian)": lambda: chain_jacobian(arm, q, np.zeros(3)),
    }
    numbers = dict.fromkeys(functions, q.shape[0]) | {"Drake loop, 6 dof": 2000}
    if pin is not None:
        notes.append(check("this program and pinocchio", ours(few), pin(few)))
        functions["pinocchio loop, 6 dof"], numbers["pinocchio loop, 6 dof"] = (lambda: pin(q)), q.shape[0]
    else:
        notes.append("pinocchio is not installed (pip install pin): not compared")
    seconds = in_turn(functions, ROUNDS)
    base = statistics.median(seconds["pinocchio loop, 6 dof"]) / q.shape[0] if pin is not None else float("nan")
    rows = []
    for name, s in seconds.items():
        each = statistics.median(s) / numbers[name]
        rows.append([name, f"{1 / each:,.0f}", spread(s, 1e6 / numbers[name]), f"{base / each:.2f}"])
    header = ("way", "Jacobians per second", "us each (median, smallest-largest)", "times the pinocchio loop's speed")
    show(f"Jacobians at the flange, {q.shape[0]} postures, {ROUNDS} rounds in turn", header, rows, notes)


def equilibria(arm: Any, cell: Any, q: np.ndarray, rng: np.random.Generator) -> None:
    """Table of microseconds per loaded equilibrium."""
    from drake_stiffness.effects.effect import Cases
    from drake_stiffness.equilibrium import solve_equilibrium
    from drake_stiffness.structure import Structure

    N, some = q.shape[0], 200
    scale = np.array([1.5e-4] * 3 + [2.5e-4] * 3)
    half = rng.normal(size=(7, 6, 6)) * 0.6
    k_link = (half @ half.transpose(0, 2, 1) + 0.5 * np.eye(6)) * np.outer(scale, scale)
    k_joint = rng.uniform(0.3e-6, 3e-6, 6)
    full = Structure(arm, k_joint, tuple(k_link))
    joints = Structure(arm, k_joint, (None,) * 7)
    wrench = np.concatenate([rng.normal(0, 1000.0, (3, N)), rng.normal(0, 100.0, (3, N))])
    cases = Cases(q.T, wrench, np.array(cell.load_point_m))
    loop = DrakeEquilibrium(cell)

    def drake() -> np.ndarray:
        loop.calls_s, loop.iterations = 0.0, 0
        return np.stack([loop.solve(q[i], wrench[:, i], k_joint, k_link) for i in range(some)], axis=1)

    found = solve_equilibrium(full, cases)
    notes = [check("this program and the Drake loop, m", found.p_E[:, :some], drake())]
    seconds = in_turn(
        {
            "joints and 7 links": lambda: solve_equilibrium(full, cases),
            "joints alone": lambda: solve_equilibrium(joints, cases),
            "Drake": drake,
        },
        ROUNDS,
    )
    rows = []
    for name, structure in (("joints and 7 links", full), ("joints alone", joints)):
        s, steps = seconds[name], solve_equilibrium(structure, cases).iterations
        rows.append([f"arrays, {name}", spread(s, 1e6 / N), f"{steps}", spread(s, 1e6 / N / steps)])
    s, steps = seconds["Drake"], loop.iterations / some
    rows.append(
        ["Drake loop, joints and 7 links", spread(s, 1e6 / some), f"{steps:.1f}", spread(s, 1e6 / some / steps)]
    )
    calls = loop.calls_s * 1e6 / some
    rows.append(["of it, inside Drake's three calls", f"{calls:.2f}", f"{steps:.1f}", f"{calls / steps:.2f}"])
    mean = np.abs(found.p_E[:, :some]).mean()
    notes.append(
        f"{some} postures in the Drake loop; both stop when no deflection moves by more than 1e-13 (mean |p| {mean:.1f} m)"
    )
    header = ("way", "us per equilibrium", "iterations", "us per posture and iteration")
    show(f"Loaded equilibria with weight, {N} postures, {ROUNDS} rounds in turn", header, rows, notes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--postures", type=int, default=20000)
    args = parser.parse_args()
    from drake_stiffness.cell import read_cell
    from drake_stiffness.plant import build_arm

    cell = read_cell(KR270 / "cell.yaml")
    arm = build_arm(cell)
    rng = np.random.default_rng(0)
    q = rng.uniform(np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi), (args.postures, arm.num_joints))
    jacobians(arm, cell, q)
    equilibria(arm, cell, q, rng)


if __name__ == "__main__":
    main()
