"""What to measure next: postures that tell apart what this campaign confounds, with steps that show what it could not show.

Every posture is loaded in three directions and by one torque, at three levels, up and partly down again, unloaded before and
between: the default experiment. Among random postures that keep clear, those are taken one after the other that separate
best. What separates an effect e from a rival is what is left of e's fitted signature s after the base model's columns A and
the rival's S: its squared length s^T s - s^T X (X^T X)^+ X^T s, X = [A, S], over the campaign and the new postures together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drake_stiffness.campaign import Measurements
from drake_stiffness.design.candidates import Candidates, draw_candidates
from drake_stiffness.design.plan_table import experiment_names, plan_text
from drake_stiffness.design.settings import Design
from drake_stiffness.diagnosis.diagnosis import Diagnosis
from drake_stiffness.diagnosis.signatures import Scene, signature
from drake_stiffness.diagnosis.suspects import Untestable
from drake_stiffness.effects import Effect
from drake_stiffness.errors import InputError
from drake_stiffness.model import Model
from drake_stiffness.observation import columns, observe
from drake_stiffness.rotations import Array
from drake_stiffness.task import Task

POSTURES = 6
_CANDIDATES = 40
_LEVELS = (1 / 3, 2 / 3, 1.0, 2 / 3)
_LEAST_LOAD_N, _ARM_M = 100.0, 0.2


@dataclass(frozen=True, eq=False)
class NextExperiment:
    """A plan and what it is for.

    Attributes
    ----------
    purpose : tuple of str
    separation : list of dict
        Per pair of an effect and a rival: sigma between them now, and expected with the plan.
    text : str
        PLAN.csv.
    """

    purpose: tuple[str, ...]
    separation: list[dict[str, Any]]
    text: str

    def to_dict(self) -> dict[str, Any]:
        return {
            "purpose": list(self.purpose),
            "expected_separation": self.separation,
            "postures": POSTURES,
            "plan_csv": self.text,
        }


def next_experiment(task: Task, d: Diagnosis) -> NextExperiment | None:
    """The plan for what is confounded, untestable or unexplained; None where nothing is open or no posture keeps clear."""
    pairs = [(n.effect, n.tested.coefficient, t.effect) for n in d.search.named for t in n.confounded]
    purpose = _purposes(d)
    if not purpose:
        return None
    model, m = d.search.base.model, d.observations.measurements
    try:
        drawn = draw_candidates(model, Design(candidates=_CANDIDATES, seed=0))
    except InputError:
        return None
    plan = _default_experiment(drawn, m)
    grams = [_grams(task, model, pairs, plan.take(np.array([k]))) for k in range(plan.number)]
    start = _of_campaign(d, model, pairs)
    chosen, total = _choose(grams, start, pairs)
    now, then = _separations(start, pairs), _separations(total, pairs)
    separation = [
        {
            "effect": {"kind": e.kind, "where": e.where},
            "rival": {"kind": r.kind, "where": r.where},
            "sigma_now": float(a),
            "sigma_expected": float(b),
        }
        for (e, _, r), a, b in zip(pairs, now, then, strict=True)
    ]
    names = experiment_names(len(chosen), task.measurements.experiments)
    return NextExperiment(purpose, separation, plan_text(model.arm, plan.take(np.array(chosen)), names))


def _purposes(d: Diagnosis) -> tuple[str, ...]:
    out = [
        f"tell {n.tested.suspect.name} from {', '.join(t.suspect.name for t in n.confounded)}"
        for n in d.search.named
        if n.confounded
    ]
    if d.verdict in ("unexplained", "partly_explained"):
        out.append(f"more postures where the gap remains: {d.words[1]}")
    for lacks in dict.fromkeys(u.lacks for u in d.untestable if _helps(u)):
        kinds = ", ".join(dict.fromkeys(u.kind for u in d.untestable if u.lacks == lacks))
        out.append(f"make {kinds} testable: {lacks}")
    return tuple(out)


def _helps(u: Untestable) -> bool:
    """Whether more steps and postures can mend what is lacking; another quantity or known compliances they are not."""
    return not any(words in u.lacks for words in ("known from elsewhere", "absolute positions"))


def _default_experiment(drawn: Candidates, m: Measurements) -> Candidates:
    """Three directions and a torque, three levels each, up and partly down, unloaded in between; as large as the campaign's loads."""
    force = max(float(np.linalg.norm(m.cases.wrench[:3], axis=0).max(initial=0.0)), _LEAST_LOAD_N)
    loads = np.zeros((4, 6))
    loads[0, 2], loads[1, 0], loads[2, 1] = -force, force, force
    loads[3, 3:] = np.array([1.0, -1.0, 1.0]) * force * _ARM_M / np.sqrt(3)
    pattern = [np.zeros(4)]
    for d in range(4):
        pattern += [level * np.eye(4)[d] for level in _LEVELS]
        pattern.append(np.zeros(4))
    full = np.broadcast_to(loads, (drawn.number, 4, 6)).copy()
    full[1::2, 1:3] *= -1.0  # opposite directions from posture to posture
    return Candidates(drawn.q, full, np.array(pattern), drawn.share)


def _grams(task: Task, model: Model, pairs: list, plan: Candidates) -> Array:
    """Gram matrix of all columns - base, fitted signatures, rivals - over one planned experiment."""
    cases = plan.cases(model.load_point)
    points = np.array(list(model.points))
    case, point = np.repeat(np.arange(cases.number), points.size), np.tile(points, cases.number)
    cases = replace(cases, time_s=np.asarray(25.0 * cases.step, dtype=float))
    m = replace(
        task.measurements,
        cases=cases,
        experiments=("planned",),
        case=case,
        row=np.zeros(case.size, dtype=int),
        point=point,
        position=np.zeros((case.size, 3)),
        orientation=np.full((case.size, 3), np.nan),
        relative=False,
    )
    X = _columns(Scene(model, observe(m, task.displacement, task.campaign.noise)), pairs)
    return np.asarray(X.T @ X)


def _of_campaign(d: Diagnosis, model: Model, pairs: list) -> Array:
    X = _columns(Scene(model, d.observations), pairs)
    return np.asarray(X.T @ X)


def _columns(scene: Scene, pairs: list[tuple[Effect, Array, Effect]]) -> Array:
    parts = [columns(scene.o, scene.model)]
    for effect, coefficient, rival in pairs:
        parts += [signature(scene, effect) @ coefficient[:, None], signature(scene, rival)]
    return np.hstack(parts)


def _separations(gram: Array, pairs: list[tuple[Effect, Array, Effect]]) -> Array:
    """Sigma between every effect and its rival."""
    if not pairs:
        return np.zeros(0)
    widths = [1 + len(rival.parameters) for _, _, rival in pairs]
    base = gram.shape[0] - sum(widths)
    out, start = [], base
    for width in widths:
        X = np.concatenate([np.arange(base), np.arange(start + 1, start + width)])
        s = start
        cross = gram[X, s]
        solved = np.linalg.lstsq(gram[np.ix_(X, X)], cross, rcond=1e-12)[0]
        out.append(np.sqrt(max(float(gram[s, s] - cross @ solved), 0.0)))
        start += width
    return np.array(out)


def _choose(grams: list[Array], start: Array, pairs: list) -> tuple[list[int], Array]:
    """Postures one after the other: each makes the least separated pair as separate as it can (any, without pairs)."""
    chosen: list[int] = []
    total = start
    for _ in range(POSTURES):
        left = [k for k in range(len(grams)) if k not in chosen]
        worth = [float(_separations(total + grams[k], pairs).min(initial=np.inf)) for k in left]
        best = left[int(np.argmax(worth))]
        chosen.append(best)
        total = total + grams[best]
    return chosen, total
