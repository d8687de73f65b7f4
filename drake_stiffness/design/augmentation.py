"""What more postures would bring: a campaign's information as the start of a plan, and which doubtful parameters k more would settle."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import forward, torques
from drake_stiffness.campaign import Measurements
from drake_stiffness.design.settings import Design, DesignNoise, Loads
from drake_stiffness.design.space import Measured, Space, prepare
from drake_stiffness.effects.compliance import JointCompliance
from drake_stiffness.errors import InputError
from drake_stiffness.groups import Groups
from drake_stiffness.model import Model
from drake_stiffness.rotations import Array
from drake_stiffness.sensitivity import has_finite_differences
from drake_stiffness.shop.load_words import load_words

log = logging.getLogger("drake_stiffness")

# More postures than this are no advice; a stronger load is.
_MOST = 20
# Candidates that are tried, few enough that `identify` hardly takes longer.
_CANDIDATES = 400
_CANDIDATES_BY_DIFFERENCES = 100


@dataclass(frozen=True, eq=False)
class Suggestion:
    """What would settle a doubtful parameter.

    Attributes
    ----------
    parameter : str
        Of group G1~ (base parameters).
    ratio : float
        Value over standard deviation now.
    postures : int or None
        How many more of the best kind would pass the upper threshold; None if more than twenty.
    reached : float
        The ratio predicted then.
    q : (n,)
        The posture that helps most, rad and m.
    loads : (D, 6)
        Its full loads, N and N m.
    text : str
        A sentence for people.
    """

    parameter: str
    ratio: float
    postures: int | None
    reached: float
    q: Array
    loads: Array
    text: str

    def to_dict(self) -> dict[str, Any]:
        """For `--json`; joints in rad and m."""
        return {
            "parameter": self.parameter,
            "ratio": self.ratio,
            "postures": self.postures,
            "reached": self.reached,
            "joints": self.q,
            "loads_N_Nm": self.loads,
            "text": self.text,
        }


def measured_information(groups: Groups, experiments: tuple[str, ...]) -> Measured:
    """The information of an identified campaign: its compressed columns, R^T R = A^T A."""
    view = groups.view
    return Measured(experiments, view.unit * view.length)


def settings_like(m: Measurements, position_sigma_mm: float) -> Design:
    """Settings of a campaign that goes on as it began: the largest force it used, down and across, and its noise."""
    force = float(np.linalg.norm(m.cases.wrench[:3], axis=0).max(initial=0.0))
    loads = Loads(down_N=round(force, 1), horizontal_N=round(force, 1)) if force > 0 else Loads()
    return Design(loads=loads, noise=DesignNoise(position_sigma_mm=position_sigma_mm))


def what_more(model: Model, groups: Groups, m: Measurements, position_sigma_mm: float) -> list[Suggestion]:
    """For every base parameter of group G1~: how many more postures, of which kind, would lift it above the threshold.

    Postures are added one at a time, each the one among random candidates that shrinks the parameter's variance most; its ratio
    grows with the root of that. Candidates carry the campaign's largest force, down and across.
    """
    doubtful = [k for k, group in enumerate(groups.group) if group == "G1~"]
    if not doubtful:
        return []
    number = _CANDIDATES_BY_DIFFERENCES if has_finite_differences(model) else _CANDIDATES
    settings = settings_like(m, position_sigma_mm).model_copy(update={"candidates": number})
    try:
        space = prepare(model, 1, settings, measured=measured_information(groups, m.experiments))
    except (
        InputError
    ) as error:  # a cell so tight that random postures hardly keep clear: no advice, but no failure either
        log.info("no suggestion of further postures: %s", error)
        return []
    return [_suggestion(space, groups, k, m) for k in doubtful]


def _suggestion(space: Space, groups: Groups, k: int, m: Measurements) -> Suggestion:
    c = groups.found.matrix[k] @ space.basis
    name, ratio = groups.base_names[k], float(groups.ratio[k])
    information = space.information
    # What only the new postures show has no information yet; a trace of it keeps the matrix regular.
    V: Array = np.asarray(np.linalg.inv(information.start + information.ridge(1)), dtype=float)
    before = float(c @ V @ c)
    added: list[int] = []
    reached, variance = ratio, before
    while reached <= groups.upper and len(added) < _MOST:
        best, variance, V = _best_addition(space, V, c)
        added.append(best)
        reached = ratio * float(np.sqrt(before / variance))
    enough = reached > groups.upper
    first = space.candidates.take(np.array(added[:1]))
    q, loads = first.q[:, 0], first.full[0]
    needed = len(added) if enough else None
    text = _sentence(space.model, name, ratio, groups.upper, needed, q, loads, m)
    return Suggestion(name, ratio, needed, reached, q, loads, text)


def _best_addition(space: Space, V: Array, c: Array) -> tuple[int, float, Array]:
    """The candidate that shrinks c^T V c most, what it shrinks it to, and V with it (Woodbury).

    With G = B V: c^T (V^-1 + B^T B)^-1 c = c^T V c - (G c)^T (1 + G B^T)^-1 (G c).
    """
    B = space.rows @ space.basis
    G = B @ V
    inner = np.eye(B.shape[1]) + G @ B.transpose(0, 2, 1)
    Gc = G @ c
    drop = np.einsum("nm,nm->n", Gc, np.linalg.solve(inner, Gc[:, :, None])[:, :, 0])
    best = int(np.argmax(drop))
    V = V - G[best].T @ np.linalg.solve(inner[best], G[best])
    return best, float(c @ V @ c), (V + V.T) / 2


def _sentence(
    model: Model, name: str, ratio: float, upper: float, k: int | None, q: Array, loads: Array, m: Measurements
) -> str:
    """`joint_4 (ratio 3.1) would pass 5 with 4 more postures with a moment about its axis: e.g. ...`."""
    arm = model.arm
    number = f"with {k} more posture{'s' * (k != 1)}" if k else f"only with more than {_MOST} more postures"
    joints = [e.where for e in model.effects if isinstance(e, JointCompliance)]
    kind = ""
    if name in joints:
        i = arm.joint_names.index(name)
        own = float(np.abs(_torque(model, np.tile(q[:, None], (1, len(loads))), loads.T)[i]).max())
        used = float(np.abs(_torque(model, m.cases.q, m.cases.wrench)[i]).max())
        word, unit = ("force along", "N") if arm.prismatic[i] else ("moment about", "N m")
        kind = f" with a {word} its axis ({own:.0f} {unit}; the campaign's largest: {used:.0f} {unit})"
    where = ", ".join(
        f"{n} {v * (1e3 if p else 180 / np.pi):.0f} {'mm' if p else 'deg'}"
        for n, v, p in zip(arm.joint_names, q, arm.prismatic, strict=True)
    )
    hung = " and ".join(load_words(load, arm.gravity) for load in loads)
    more = "" if k else "; a stronger load or a better tracker would help more"
    return f"{name} (ratio {ratio:.2g}) would pass {upper:g} {number}{kind}: e.g. {where} under {hung}{more}."


def _torque(model: Model, q: Array, wrench: Array) -> NDArray[np.float64]:
    """What the joints carry of the load alone, (n, N)."""
    weightless = replace(model.arm, gravity=np.zeros(3))
    tau, _ = torques(weightless, forward(weightless, q), wrench, model.load_point)
    return tau
