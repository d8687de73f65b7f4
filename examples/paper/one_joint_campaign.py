"""A campaign on one link and one joint, by hand: what restoration starts from in the study of `restoration.py`.

The link stands between the clamp and a joint about z at its end. 12 postures of the joint, forces along three axes at a point off its
axis, three reflectors, 12 um of noise: joint and k66 are not told apart, k11 drowns in the noise.
"""

from __future__ import annotations

import numpy as np
from plants.sections import Cantilever

from drake_stiffness.arm import Arm
from drake_stiffness.effects.compliance import BaseCompliance, JointCompliance
from drake_stiffness.identifiability import analyse, classify, determined
from drake_stiffness.model import Model, Statistics
from drake_stiffness.springs import spring_template

SIGMA_M, FORCE_N, POSTURES = 12e-6, 3000.0, 12
LOAD = np.array([0.25, 0.05, 0.2])
POINTS = np.array([[0.3, 0.1, 0.1], [0.1, -0.2, 0.05], [0.2, 0.0, -0.25]])
BEAM, SYMMETRIC = spring_template("beam", "x"), spring_template("symmetric")


def observation_matrix(basis: np.ndarray) -> np.ndarray:
    """Displacements of the reflectors, m, per unit of (joint, entries of the link): statics of one link and one joint, by hand."""
    rows = []
    for q in np.linspace(-2.5, 2.5, POSTURES):
        c, s = np.cos(q), np.sin(q)
        R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        for force in FORCE_N * np.eye(3):
            wrench = np.concatenate([force, np.cross(R @ LOAD, force)])
            twist = np.column_stack([np.eye(6)[5] * wrench[5], (basis @ wrench).T])
            rows += [twist[:3] + np.cross(twist[3:].T, point).T for point in POINTS @ R.T]
    return np.vstack(rows)


def identified(link: Cantilever, rng: np.random.Generator) -> tuple[Model, np.ndarray]:
    """What least squares finds in a campaign on the link, and the truth (joint, eight entries)."""
    places = {"R_PF": np.stack([np.eye(3)] * 2), "p_PF": np.array([[link.length, 0, 0], [0.3, 0, 0]])}
    masses = {"mass_kg": np.zeros(2), "p_MCom": np.zeros((2, 3)), "tool_mass_kg": 0.0, "p_ETool": np.zeros(3)}
    arm = Arm(("joint_1",), ("link", "hand"), (False,), **places, axis_F=np.array([[0.0, 0, 1]]), lower=np.array([-3.0]),
              upper=np.array([3.0]), **masses, gravity=np.zeros(3))  # fmt: skip
    cell = {
        "robot": {"model": "-", "flange": "-"},
        "reference_points_m": {"P": [0, 0, 0]},
        "springs": {"links": ["link"]},
    }
    effects = (JointCompliance("joint_1"), BaseCompliance("base", "beam", "x", link.length, "link"))
    model = Model(cell, arm, {"P": np.zeros(3)}, LOAD, effects, np.zeros(9))
    C = link.compliance()
    joint = C[5, 5] * np.exp(rng.uniform(np.log(0.1), np.log(3.0)))
    readings = observation_matrix(SYMMETRIC.basis) @ np.array([joint, *SYMMETRIC.values(C)]) / SIGMA_M
    A = observation_matrix(BEAM.basis) / SIGMA_M * model.scales
    view = analyse(A, coarse=False)
    x = view.seen @ view.pseudo_inverse_seen(A, readings + rng.normal(size=readings.size))
    cov, scales = view.covariance(), model.scales
    sigma = np.sqrt(np.diag(cov))
    known = np.where(determined(view), sigma * scales, np.nan)
    groups = classify(view, x, sigma)
    s = Statistics(known, groups, ((),) * 9, cov * np.outer(scales, scales), view.unseen)
    return Model(cell, arm, model.points, LOAD, effects, x * scales, s), np.array([joint, *BEAM.values(C)])
