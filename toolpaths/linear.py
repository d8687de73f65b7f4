"""The deflection of the tool by linear superposition, for programs of which speed matters more than the second order.

    d = sum over springs of J_s k_s tau_s                                                   (seed eq. 8, spring by spring)

on the undeflected arm: torques of the process force (and of weight, where the reference is the rigid arm) are those of the
commanded posture. The loaded equilibrium differs by the deflection times itself over the arm's length, some micrometres per
millimetre; `difference_mm` looks at some points of every piece and says how much it is there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Poses, joint_jacobian, torques
from drake_stiffness.errors import InputError
from drake_stiffness.rotations import cross, exponential, multiply, rotate, rotate_fixed
from drake_stiffness.structure import Structure

Floats = NDArray[np.float64]
# So many points of a program, or of a piece of it, are looked at with the loaded equilibrium.
LOOKED_AT = 256


def check_linear(structure: Structure) -> None:
    """Raise InputError if an effect of a model cannot be superposed."""
    found = [effect.kind for effect, _ in (*structure.others, *structure.torque_effects)]
    if found:
        raise InputError(
            f"--linear: the model holds {', '.join(sorted(set(found)))}, which does not grow in proportion to the force; leave --linear out."
        )


def linear_deflection(structure: Structure, poses: Poses, wrench: Floats, p_ET: Floats, *, weight: bool) -> Floats:
    """Twist (6, N) of the tool centre point in the world, m and rad, under a wrench (6, N) and, if asked for, weight.

    Parameters
    ----------
    poses : of the undeflected arm
    """
    arm = structure.arm if weight else replace(structure.arm, gravity=np.zeros(3))
    tip = poses.p_E + rotate_fixed(poses.R_E, p_ET)
    tau, tau_link = torques(arm, poses, wrench, p_ET, None, structure.links)
    J = joint_jacobian(arm, poses, tip)
    twist = (J * (structure.k_joint[:, None] * tau)[:, None]).sum(axis=0)
    for k, (compliance, carried) in enumerate(zip(structure.k_link, tau_link, strict=True)):
        if compliance is not None and carried is not None:
            theta = compliance @ carried
            turn = rotate(poses.R_F[k], theta[3:])
            twist[:3] += rotate(poses.R_F[k], theta[:3]) + cross(turn, tip - poses.p_S[k])
            twist[3:] += turn
    return np.asarray(twist)


def moved(twist: Floats, R: Floats, p: Floats) -> tuple[Floats, Floats]:
    """Poses (3, 3, N), (3, N) moved by a twist in the world."""
    return multiply(exponential(twist[3:]), R), p + twist[:3]
