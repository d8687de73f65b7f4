"""The elastic Drake plant as an independent judge of poses, torques and loaded equilibria, one posture at a time.

Rotation vectors, their derivative and the springs' law are written anew here with scipy; weight, Jacobians and poses are
Drake's own.
"""

from __future__ import annotations

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import JacobianWrtVariable
from scipy.spatial.transform import Rotation

from drake_stiffness.cell import Cell
from drake_stiffness.plant import build_elastic_plant


def left_jacobian(r: np.ndarray) -> np.ndarray:
    """d(rotation)/dr as angular velocity in the outer axes, by central differences of the rotation itself.

    `r (..., 3)` gives `(..., 3, 3)`, columns by component. Richardson's step makes it of fourth order, so that the judge is
    better than what it judges.
    """
    slopes = []
    for h in (1e-4, 2e-4):
        ends = [Rotation.from_rotvec((r[..., None, :] + s * h * np.eye(3)).reshape(-1, 3)) for s in (1, -1)]
        slopes.append((ends[0] * ends[1].inv()).as_rotvec() / (2 * h))
    by_row = ((4 * slopes[0] - slopes[1]) / 3).reshape(*r.shape[:-1], 3, 3)
    return np.swapaxes(by_row, -1, -2)


class Judge:
    """Sets the elastic plant of a cell to a deflected posture and reads Drake."""

    def __init__(self, cell: Cell) -> None:
        self.e = build_elastic_plant(cell)
        self.plant = self.e.plant
        self.context = self.plant.CreateDefaultContext()
        self.world = self.plant.world_frame()

    def pose(self, q, theta_joint, theta_link) -> np.ndarray:
        """Set the plant; the flange's pose as a 4x4 matrix."""
        for joint, value in zip(self.e.joints, q, strict=True):
            self._set(joint, value)
        for joint, value in zip(self.e.joint_springs, theta_joint, strict=True):
            self._set(joint, value)
        for joint, theta in zip(self.e.link_springs, theta_link, strict=True):
            d, r = (np.zeros(3), np.zeros(3)) if theta is None else (theta[:3], theta[3:])
            R = RotationMatrix(Rotation.from_rotvec(r).as_matrix())
            joint.SetPose(self.context, RigidTransform(R, d))
        return self.e.end.CalcPoseInWorld(self.context).GetAsMatrix4()

    def _set(self, joint, value: float) -> None:
        if joint.type_name() == "revolute":
            joint.set_angle(self.context, value)
        else:
            joint.set_translation(self.context, value)

    def jacobian(self, p_EP) -> np.ndarray:
        """Drake's (6, velocities), rows angular then linear, world axes."""
        return self.plant.CalcJacobianSpatialVelocity(
            self.context, JacobianWrtVariable.kV, self.e.end, np.asarray(p_EP, dtype=float), self.world, self.world
        )

    def torques(self, wrench, p_EL, theta_link) -> tuple[np.ndarray, list[np.ndarray]]:
        """What joints and links carry at the posture now set, in the springs' own coordinates."""
        J = self.jacobian(p_EL)
        tau = self.plant.CalcGravityGeneralizedForces(self.context)
        tau = tau + J.T @ np.concatenate([wrench[3:], wrench[:3]])
        joint = np.array([tau[j.velocity_start()] for j in self.e.joint_springs])
        r = np.array([np.zeros(3) if theta is None else theta[3:] for theta in theta_link])
        links = []
        for spring, turn in zip(self.e.link_springs, left_jacobian(r), strict=True):
            start = spring.velocity_start()
            links.append(np.concatenate([tau[start + 3 : start + 6], turn.T @ tau[start : start + 3]]))
        return joint, links

    def equilibrium(self, q, wrench, p_EL, k_joint, k_link, law=None):
        """theta = k tau by plain repetition; returns flange pose, joint and link deflections.

        Parameters
        ----------
        law : callable, optional
            Further deflection of the joints from what they carry, (n,) -> (n,).
        """
        theta_joint, theta_link = np.zeros(len(q)), [np.zeros(6) for _ in self.e.link_springs]
        for _ in range(60):
            self.pose(q, theta_joint, theta_link)
            tau_joint, tau_link = self.torques(wrench, p_EL, theta_link)
            new_joint = k_joint * tau_joint + (0.0 if law is None else law(tau_joint))
            new_link = [np.zeros(6) if k is None else k @ t for k, t in zip(k_link, tau_link, strict=True)]
            change = np.abs(np.concatenate([new_joint - theta_joint, np.ravel(new_link) - np.ravel(theta_link)])).max()
            theta_joint, theta_link = new_joint, new_link
            if change < 1e-15:
                break
        return self.pose(q, theta_joint, theta_link), theta_joint, theta_link

    def positions(self, cases, points, k_joint, k_link=None) -> np.ndarray:
        """(P, 3, N) loaded positions of points (P, 3) of the flange."""
        k_link = [None] * len(self.e.link_springs) if k_link is None else k_link
        out = np.empty((len(points), 3, cases.number))
        for i in range(cases.number):
            X, _, _ = self.equilibrium(cases.q[:, i], cases.wrench[:, i], cases.p_ELoad, k_joint, k_link)
            out[:, :, i] = points @ X[:3, :3].T + X[:3, 3]
        return out
