"""What the application fits to a campaign, and what it asks of the results."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drake_stiffness import statistics as st
from drake_stiffness.assembly import make_model
from drake_stiffness.effects.compliance import JointCompliance
from drake_stiffness.effects.geometry import JointZeroOffset
from drake_stiffness.effects.gravity_compensator import GravityCompensator, free_length
from drake_stiffness.effects.instruments import TrackerFrame
from drake_stiffness.identification import Solution, identify
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations, columns, measured, predicted
from drake_stiffness.reduction.patterns import joints_only, keep_only
from drake_stiffness.reduction.reduction import sequential
from drake_stiffness.semidefinite import smallest_eigenvalue
from drake_stiffness.task import Task, read_task

SPRING = "joint_2.gravity_compensator.spring"
PRELOAD = "joint_2.gravity_compensator.preload"


@dataclass(frozen=True, eq=False)
class Fitted:
    """A fitted model with its statistics, and the names of the compliances (and effects) that it keeps."""

    label: str
    model: Model
    chi2_per_dof: float

    @property
    def kept(self) -> int:
        """How many parameters it has."""
        return int(self.model.x.size)

    def value(self, name: str) -> tuple[float, float]:
        """Value and standard deviation of a parameter, of `k_c` = 1 / K_c (m/N), or of `s_0` (m)."""
        assert self.model.statistics is not None
        places = [self.model.names.index(n) for n in (SPRING, PRELOAD)] if name in ("k_c", "s_0") else []
        if name == "s_0":
            return free_length(self.model.x[places], self.model.statistics.covariance[np.ix_(places, places)])
        i = places[0] if places else self.model.names.index(name)
        x, sigma = float(self.model.x[i]), float(self.model.statistics.sigma[i])
        return (1 / x, sigma / x**2) if name == "k_c" else (x, sigma)


def finished(label: str, solution: Solution, o: Observations, how: str) -> Fitted:
    """A solution with statistics, fit to be stored or to correct a program."""
    fit = st.goodness(solution, o)
    numbers, covariance = st.statistics(solution, o, fit)
    entry = st.fit_entry(solution, fit, float("nan"), how, smallest_eigenvalue(solution.model), covariance)
    return Fitted(label, st.attach(solution, numbers, entry, {}), fit.chi2_per_dof)


def in_turn(task: Task) -> tuple[Fitted, Fitted]:
    """The paper's way to its 18 parameters, M3, with the worst dropped one at a time; and the complete model it starts from."""
    o = task.observations()
    complete = identify(task.model, o)
    # The compensator makes joint_2 nearly, not exactly, redundant beside link_1.k55: without joint_2 it had nothing to act on.
    reduced = sequential(task.model, o, complete=complete, protect=("joint_2",)).solution
    return finished("reduced in turn", reduced, o, "least-squares"), finished("complete, cone", complete, o, "sdp")


def simpler(task: Task) -> list[Fitted]:
    """The same readings explained by joints alone, and by joints and compensator (what Table 1 prints, and k1)."""
    o, model = task.observations(), task.model
    with_it = model.subset([isinstance(e, JointCompliance | GravityCompensator) for e in model.effects])
    return [
        finished("joints only", identify(joints_only(model), o), o, "sdp"),
        finished("joints and compensator", identify(with_it, o), o, "sdp"),
    ]


def same_structure(path: Path, like: Fitted) -> Fitted:
    """Another campaign fitted with exactly the parameters of a reduced model (without noise: what they stand for)."""
    task = read_task(path)
    o = task.observations()
    names = [*like.model.names, f"joint_2.{GravityCompensator.kind}"]
    model, _ = keep_only(task.model, names, combined=True)
    return finished(like.label, identify(model, o, "least-squares"), o, "least-squares")


@dataclass(frozen=True)
class FromPositions:
    """K_c (N/m) and s_0 (m) from absolute positions, with their standard deviations, and chi-square per degree of freedom."""

    spring: tuple[float, float]
    free_length: tuple[float, float]
    chi2_per_dof: float


def from_positions(task: Task, springs: Model, *, calibrated: bool) -> FromPositions:
    """The compensator from absolute positions, the springs as displacements gave them.

    Parameters
    ----------
    task
        Of a campaign of positions.
    springs
        Identified from the displacements of the same campaign.
    calibrated
        Whether tracker frame and joint zeros are known; otherwise they are fitted along.
    """
    o, effects = task.observations(), list(springs.effects)
    if not calibrated:
        effects += [TrackerFrame(), *(JointZeroOffset(name) for name in task.arm.joint_names)]
    x = np.concatenate([springs.x, np.zeros(sum(len(e.parameters) for e in effects) - springs.x.size)])
    model = make_model(task.cell, task.arm, effects, x)
    spring = [model.names.index(n) for n in (SPRING, PRELOAD)]
    free = np.array([*spring, *range(springs.x.size, x.size)])
    for _ in range(6):
        A = columns(o, model)[:, free]
        residual = measured(o) - predicted(o, model)
        step, *_ = np.linalg.lstsq(A, residual, rcond=None)
        x = model.x.copy()
        x[free] += step * model.scales[free]
        model = model.with_x(x)
    residual = measured(o) - predicted(o, model)
    chi2 = float(residual @ residual) / (residual.size - free.size)
    # A share of one direction may be unseen (the tracker turning with joint 1): the pseudo-inverse leaves it out.
    scaled = np.linalg.pinv(A.T @ A, rcond=1e-14, hermitian=True)[:2, :2] * np.outer(*[model.scales[spring]] * 2)
    covariance = scaled * max(chi2, 1.0)
    return FromPositions(
        (float(model.x[spring[0]]), float(np.sqrt(covariance[0, 0]))), free_length(model.x[spring], covariance), chi2
    )
