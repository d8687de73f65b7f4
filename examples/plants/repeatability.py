"""The robot's repeatability: random joint errors that move the flange by a stated amount."""

from __future__ import annotations

import numpy as np

from .beams import Array
from .chain import RigidChain


def joint_errors(chain: RigidChain, q: Array, rms_m: float, rng: np.random.Generator) -> Array:
    r"""One random error of the joint positions per posture, the same spread in all joints.

    Independent normal errors with one standard deviation s (rad, or m for a prismatic joint), where s is such that the
    flange origin is displaced by `rms_m` on average over the postures:

    .. math:: s^2 \; \mathrm{mean}_k \, \mathrm{tr}(J_k J_k^T) = \mathrm{rms}^2

    with J_k the position Jacobian of the flange at posture k.

    Parameters
    ----------
    q
        (N, n) postures.
    rms_m
        Root mean square of the flange's displacement (3-D length), m. The KR 270 has 0.06e-3.

    Returns
    -------
    (N, n) errors to add to q.
    """
    jacobian = chain.jacobian(q, np.zeros(3))[:, :3]
    sensitivity = np.sqrt(np.mean(np.sum(jacobian**2, axis=(1, 2))))
    return rng.normal(scale=rms_m / sensitivity, size=q.shape)
