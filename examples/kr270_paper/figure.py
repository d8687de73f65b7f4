"""The figure of docs/paper_kr270.md: how the stiffness of joint 2 varies, and the milled path."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import world
from fits import PRELOAD, SPRING, Fitted
from plants.replay import PathError

from drake_stiffness.effects.gravity_compensator import GravityCompensator


def draw(fit: Fitted, errors: dict[str, PathError], path: Path) -> None:
    """Two panels as an SVG: variation of joint 2's stiffness over its angle, and errors along the program."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "paper_kr270"
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    degrees = np.linspace(-140.0, -5.0, 271)
    q = np.radians(degrees)
    for variant, label in (
        ("stiffness", "true: Table 1 as a stiffness"),
        ("spring", "a real spring that carries the arm"),
    ):
        arm = world.true_arm(variant)
        spring = arm.stiffening or arm.compensator
        assert spring is not None
        share = spring.stiffness_about_joint(arm.chain, q) * arm.joint_compliance[1]
        left.plot(
            degrees,
            100 * share,
            color="0.2" if variant == "stiffness" else "tab:green",
            lw=3 if variant == "stiffness" else 1.5,
            label=label,
        )
    effect = next(e for e in fit.model.effects if isinstance(e, GravityCompensator))
    places = [fit.model.names.index(n) for n in (SPRING, PRELOAD)]
    k2 = fit.value("joint_2")[0]
    # Both are linear in the unknowns, so the band is exact.
    rows = np.stack([effect.stiffening(q, unit) for unit in np.eye(2)], axis=1) * k2
    assert fit.model.statistics is not None
    covariance = fit.model.statistics.covariance[np.ix_(places, places)]
    # Relative to what the joint's own spring is: k2 of the model has links in it.
    rescale = k2 / world.TABLE_1["joint_2"][0]
    middle = 100 * rescale * rows @ fit.model.x[places]
    band = 100 * rescale * np.sqrt(np.einsum("ni,ij,nj->n", rows, covariance, rows))
    left.plot(degrees, middle, color="tab:orange", lw=1.5, label="identified, on the joint's own 0.302 urad/(N m)")
    left.fill_between(degrees, middle - 2 * band, middle + 2 * band, color="tab:orange", alpha=0.25, lw=0)
    left.axvspan(-120, -25, color="0.93", zorder=0)
    left.set_xlabel("joint 2, deg (shaded: where the campaign measured)")
    left.set_ylabel("change of the stiffness of joint 2, %")
    left.legend(fontsize=8)
    for name, error in errors.items():
        right.semilogy(np.arange(1, error.distance_mm.size + 1), error.distance_mm, lw=0.9, label=name)
    right.axhline(0.1, color="0.5", ls=":", lw=1)
    right.annotate("the paper's 0.1 mm", (5, 0.107), fontsize=8, color="0.4")
    right.set_ylim(bottom=3e-6)
    right.set_xlabel("corrected motion")
    right.set_ylabel("error on the true arm, mm")
    right.legend(fontsize=8, loc="lower left", ncols=2)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
