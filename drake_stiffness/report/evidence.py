"""The numbers behind the identification page: residuals in units of noise, what noise alone would leave, what loads reached."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import forward, torques
from drake_stiffness.effects.compliance import JointCompliance, LinkCompliance, Spring
from drake_stiffness.model import Model
from drake_stiffness.rotations import Array
from drake_stiffness.sensitivity import sensitivity

if TYPE_CHECKING:
    from drake_stiffness.campaign import Measurements
    from drake_stiffness.jobs import Identified

# Shares are averages: so many readings, evenly over the campaign, are plenty.
_SHARE_READINGS = 400


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the readings say of a fit.

    Attributes
    ----------
    sigma_mm : float
        Stated noise of one coordinate.
    fitted : Measurements
        The readings that took part.
    residual_mm, z : (3, M)
        Residuals of fitted readings, mm and in units of the stated noise.
    left : float
        Share of the noise's standard deviation that a right model leaves in `z` (fitted unknowns take up some); NaN
        without degrees of freedom.
    held_mm : (3, H)
        Errors of held-out readings, mm.
    fit_noise_mm, held_noise_mm : float
        3-D RMS that the stated noise alone would leave in fitted and in held-out readings.
    """

    sigma_mm: float
    fitted: Measurements
    residual_mm: Array
    z: Array
    left: float
    held_mm: Array
    fit_noise_mm: float
    held_noise_mm: float

    @property
    def experiment(self) -> NDArray[np.int_]:
        """(M,) experiment of every fitted reading."""
        return self.fitted.cases.experiment[self.fitted.case]

    @property
    def force_N(self) -> Array:
        """(M,) size of the applied force of every fitted reading."""
        return np.asarray(np.linalg.norm(self.fitted.cases.wrench[:3], axis=0)[self.fitted.case])


def evidence(result: Identified) -> Evidence:
    """Gather what the page shows of residuals and held-out errors."""
    from drake_stiffness.observation import observe, restrict
    from drake_stiffness.statistics import held_out_errors

    displacement = result.campaign.quantity == "displacement"
    sigma = result.campaign.noise.position_sigma_mm
    fitted = restrict(result.measurements, ~result.held)
    o = observe(fitted, displacement, result.campaign.noise)
    dof = o.rows - o.references - int(result.model.fit["rank"])
    left = float(np.sqrt(dof / o.rows)) if dof > 0 else float("nan")
    held_mm, held_noise = np.zeros((3, 0)), float("nan")
    if result.held.any():
        kept = restrict(result.measurements, result.held)
        held_mm = held_out_errors(result.model, kept, displacement) * 1e3
        held_noise = sigma * np.sqrt(3 * _held_variance(kept, displacement))
    residual = result.residual_mm
    return Evidence(sigma, fitted, residual, residual / sigma, left, held_mm, sigma * np.sqrt(3) * left, held_noise)


def _held_variance(m: Measurements, displacement: bool) -> float:
    """Mean variance of a held-out coordinate in units of the noise's: its own and that of the unloaded readings it refers to."""
    if not displacement:
        return 1.0
    _, point = np.unique(m.point, return_inverse=True)
    key = m.cases.experiment[m.case] * (int(point.max()) + 1) + point.reshape(-1)
    _, group = np.unique(key, return_inverse=True)
    free = m.unloaded[m.case]
    count = np.bincount(group.reshape(-1)[free], minlength=int(group.max()) + 1)[group.reshape(-1)]
    scored = ~free & (count > 0)
    return float((1 + 1 / count[scored]).mean()) if scored.any() else float("nan")


def rms(values: Array) -> float:
    """Root mean square; NaN of nothing."""
    return float(np.sqrt((values**2).mean())) if values.size else float("nan")


def rms_3d(vectors: Array) -> float:
    """Root mean square of the lengths of vectors (3, M); NaN of none."""
    return float(np.sqrt((vectors**2).sum(axis=0).mean())) if vectors.size else float("nan")


@dataclass(frozen=True)
class Shares:
    """By how much every spring contributes to the displacement at the campaign's loads.

    Attributes
    ----------
    name, joint : per spring
    share : per spring
        Along the direction of the whole displacement; they sum to one.
    alone_mm : per spring
        Mean size of what the spring contributes, whatever its direction.
    mean_mm, largest_mm : float
        Size of the whole displacement.
    """

    name: tuple[str, ...]
    joint: tuple[bool, ...]
    share: tuple[float, ...]
    alone_mm: tuple[float, ...]
    mean_mm: float
    largest_mm: float


def shares(model: Model, m: Measurements, displacement: bool) -> Shares | None:
    """Shares of the springs in the mean displacement, in the linear theory; None if the arm does not move.

    Each spring moves a reading by u_s = J_s k_s tau_s (seed eq. 8); its share is mean(u_s . u) / mean(u . u) with u the sum
    over all springs. In displacement mode u is loaded minus unloaded, else the whole sag.
    """
    springs = model.subset([isinstance(effect, Spring) for effect in model.effects])
    wanted = np.flatnonzero(~m.unloaded[m.case]) if displacement else np.arange(m.case.size)
    if not springs.effects or not wanted.size:
        return None
    some = wanted[np.unique(np.linspace(0, wanted.size - 1, min(_SHARE_READINGS, wanted.size)).astype(int))]
    used, case = np.unique(m.case[some], return_inverse=True)
    cases = m.cases.take(used)
    columns = sensitivity(springs, cases, case.reshape(-1), m.point[some])[:, :3]
    if displacement:
        columns = columns - sensitivity(springs, cases.unloaded(), case.reshape(-1), m.point[some])[:, :3]
    moved = columns * (springs.x / springs.scales)
    parts = np.stack([moved[:, :, own].sum(axis=2) for own in springs.slices])
    whole = parts.sum(axis=0)
    power = float((whole**2).sum())
    size = np.linalg.norm(whole, axis=1) * 1e3
    if power == 0.0:
        return None
    return Shares(
        tuple(spring_name(effect) for effect in springs.effects),
        tuple(isinstance(effect, JointCompliance) for effect in springs.effects),
        tuple(((parts * whole).sum(axis=(1, 2)) / power).tolist()),
        tuple((np.linalg.norm(parts, axis=2).mean(axis=1) * 1e3).tolist()),
        float(size.mean()),
        float(size.max()),
    )


def spring_name(effect: object) -> str:
    """What the report calls a spring: its joint, or its link."""
    return effect.link_name() if isinstance(effect, LinkCompliance) else str(getattr(effect, "where", ""))


def joint_torques(model: Model, m: Measurements, displacement: bool) -> Array:
    """Torque about (force along) every joint axis in every case that was read, (n, N), N m or N.

    In displacement mode what the applied load adds, because weight alone leaves no trace there; else the whole.
    """
    arm = model.structure.arm
    cases = m.cases.take(np.unique(m.case))
    poses = forward(arm, cases.q)
    tau, _ = torques(arm, poses, cases.wrench, cases.p_ELoad)
    if displacement:
        tau = tau - torques(arm, poses, np.zeros_like(cases.wrench), cases.p_ELoad)[0]
    return tau
