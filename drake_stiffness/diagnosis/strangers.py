"""Forms that the catalogue lacks: never named, but what they explain casts doubt on names and hints at what else there is.

A joint that creeps looks like friction, a flange that opens on one side like a mesh that varies. An effect of the catalogue that
stands in for such a thing explains a good part of it, and alone nothing speaks against it. So every name is held against forms
that it could be standing in for: where one of them does clearly better, the name is withdrawn and the form is told as a hint.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from drake_stiffness.diagnosis.evidence import basis_of, score
from drake_stiffness.diagnosis.naming import Remaining
from drake_stiffness.diagnosis.signatures import Scene
from drake_stiffness.effects.compliance import ROTATION_SCALE, BaseCompliance, LinkCompliance
from drake_stiffness.observation import whitened
from drake_stiffness.rotations import Array, rotate_back

# Relaxation times of creep that are tried, in units of the time between steps; without times a step takes this long (s).
_RELAXATIONS, _STEP_S = (0.5, 1.0, 2.0, 5.0, 15.0, 50.0), 25.0
# How fast something warms up, in units of the campaign's length.
_WARMINGS = (0.03, 0.1, 0.3, 1.0)
# Shares of the largest moment from which a foot may lift off.
_LIFTS_OFF = (0.2, 0.4, 0.6, 0.8)
# Changes (m, rad) whose effect is linear.
_SMALL = 1e-5


@dataclass(frozen=True, eq=False)
class Stranger:
    """A form at a place.

    Attributes
    ----------
    what : str
        In words.
    variants : tuple of (rows, p)
        Whitened columns, for every constant that is tried.
    like_weight : bool
        Whether it goes with angles as the weight on a spring does. Then it speaks against no name under which something gives way.
    """

    what: str
    variants: tuple[Array, ...]
    like_weight: bool = False


@dataclass(frozen=True)
class Likeness:
    """How well a form explains what a model leaves.

    Attributes
    ----------
    what : str
    explained : float
        In squared sigma of the stated noise.
    score : float
        In units of the noise the data show, less what its freedom explains of noise.
    p_value : float
        Of the best of its variants.
    """

    what: str
    explained: float
    score: float
    p_value: float


def likeness(left: Remaining, found: Sequence[Stranger], noise: float) -> list[Likeness]:
    """All forms against what a model leaves, best first.

    Parameters
    ----------
    noise : float
        Squared, in units of the stated one.
    """
    from scipy.special import chdtrc

    out = []
    for stranger in found:
        best = (0.0, 1)
        for S in stranger.variants:
            rest = left.beside(S)
            if np.isfinite(rest).all():
                Q = basis_of(rest)
                best = max(
                    best, (float(((Q.T @ left.r) ** 2).sum()), Q.shape[1]), key=lambda b: b[0] - 2 * b[1] * noise
                )
        explained, p = best
        p_value = float(chdtrc(max(p, 1), explained / max(noise, 1e-300)))
        out.append(Likeness(stranger.what, explained, score(explained, p, len(stranger.variants), noise), p_value))
    return sorted(out, key=lambda s: -s.score)


def strangers(scene: Scene) -> list[Stranger]:
    """Everything that is tried, at a fitted model."""
    return [*_in_joints(scene), *_pulls(scene), *_at_the_foot(scene), *_in_links(scene), *_of_time(scene)]


def _in_joints(scene: Scene) -> Iterator[Stranger]:
    arm = scene.model.structure.arm
    elapsed = _elapsed(scene)
    interval = float(np.median(elapsed[elapsed > 0])) if (elapsed > 0).any() else _STEP_S
    for i, name in enumerate(arm.joint_names):
        tau = scene.carried.tau_joint[i]
        size = ROTATION_SCALE * (arm.length_m**2 if arm.prismatic[i] else 1.0)

        def turned(functions: Sequence[Array], i: int = i, size: float = size) -> Array:
            changes = [scene.deflected({i: size * f}) for f in functions]
            return whitened(scene.o, np.stack(changes, axis=2))

        lags = [crept(tau, elapsed, scene, interval * share) - tau for share in _RELAXATIONS]
        yield Stranger(f"creep in {name}", tuple(turned([lag]) for lag in lags))
        yield Stranger(f"{name} gives more to one side than to the other", (turned([np.abs(tau)]),))


def _pulls(scene: Scene) -> Iterator[Stranger]:
    """What pulls across two or three joints, as hoses do: it stores energy that is a function of their angles.

    The square of the distance between two links is linear in the sine and cosine of every angle between them. So is the energy of
    a spring without free length, and much of that of a hose; each joint gives by its compliance times the slope.
    """
    arm, q = scene.model.structure.arm, scene.cases.q
    if scene.o.displacement:
        return
    k = scene.model.structure.k_joint
    if not any(k):
        k = np.full(arm.num_joints, ROTATION_SCALE)
    for i in range(arm.num_joints):
        for end in (i + 2, i + 3):
            joints = range(i, min(end, arm.num_joints))
            if len(joints) < end - i or any(arm.prismatic[j] for j in joints):
                continue
            value = {j: (np.ones_like(q[j]), np.sin(q[j]), np.cos(q[j])) for j in joints}
            slope = {j: (np.zeros_like(q[j]), np.cos(q[j]), -np.sin(q[j])) for j in joints}
            columns = []
            for term in list(product(range(3), repeat=len(joints)))[1:]:
                place = dict(zip(joints, term, strict=True))
                turns = {
                    j: -1e3 * k[j] * np.prod([(slope if h == j else value)[h][n] for h, n in place.items()], axis=0)
                    for j in joints
                }
                columns.append(scene.deflected(turns))
            names = [arm.joint_names[j] for j in joints]
            across = f"{', '.join(names[:-1])} and {names[-1]}"
            yield Stranger(f"a pull across {across}", (whitened(scene.o, np.stack(columns, axis=2)),), like_weight=True)


def _elapsed(scene: Scene) -> Array:
    """Time since the step before, (N,) s; 0 at the first step of an experiment, and a usual time where none is known."""
    c = scene.cases
    if not c.experiment.size:
        return np.zeros(c.number)
    time = c.time_s if c.time_s.size and np.isfinite(c.time_s).all() and np.ptp(c.time_s) > 0 else _STEP_S * c.step
    order = np.lexsort((c.step, c.experiment))
    out = np.zeros(c.number)
    out[order] = np.where(np.diff(c.experiment[order], prepend=-1) == 0, np.diff(time[order], prepend=0.0), 0.0)
    return np.maximum(out, 0.0)


def crept(tau: Array, elapsed: Array, scene: Scene, relaxation_s: float) -> Array:
    """A Kelvin element's state under torque tau (N,), at rest under the first step: c' = (tau - c) / relaxation."""
    c = scene.cases
    if not c.experiment.size:
        return tau
    order = np.lexsort((c.step, c.experiment))
    out = np.empty_like(tau)
    state, before = 0.0, -1
    for k in order:
        here = c.experiment[k]
        stays = np.exp(-elapsed[k] / relaxation_s)
        state = tau[k] if here != before else tau[k] + (state - tau[k]) * stays
        out[k], before = state, here
    return out


def _at_the_foot(scene: Scene) -> Iterator[Stranger]:
    """A foot that tilts more the more it is loaded, or past a load, or to one side: bolts that give, a floor that lifts off."""
    columns, case = scene.spring_columns, scene.o.measurements.case
    carried, moves = columns.tau_link[0], columns.moves(0)
    assert carried is not None
    moment = carried[3:5, case]
    size = np.linalg.norm(moment, axis=0)
    largest = max(float(size.max(initial=0.0)), 1e-12)
    past = [np.maximum(size - at * largest, 0.0) for at in _LIFTS_OFF]
    more = [moment * size, *(moment * p / np.maximum(size, 1e-12) for p in past)]

    def tilted(driven: Array) -> Array:
        unit = max(float(np.abs(driven).max(initial=0.0)), 1e-12)
        return whitened(scene.o, moves[:, :, 3:5] * (driven.T / unit * _SMALL)[:, None])

    yield Stranger("the base tilts more under more load", tuple(tilted(driven) for driven in more))
    yield Stranger("the base tilts more to one side than to the other", (tilted(np.abs(moment)),))


def _in_links(scene: Scene) -> Iterator[Stranger]:
    """Flanges that open on one side, at either end of a link, and springs beyond their template."""
    arm, case, columns = scene.model.structure.arm, scene.o.measurements.case, scene.spring_columns
    for effect in scene.model.effects:
        if not isinstance(effect, LinkCompliance):
            continue
        k = effect.site(arm)[1]
        name, carried, moves = arm.link_names[k], columns.tau_link[k], columns.moves(k)
        assert carried is not None
        root = _root(scene, k)
        for at_root in (False, True) if k else (False,):
            turns, moments = [moves[:, :, 3 + j] for j in range(3)], carried[3:]
            if at_root:
                turns = [t + moves[:, :, :3] @ np.cross(np.eye(3)[j], root) for j, t in enumerate(turns)]
                moments = carried[3:] + np.cross(root, carried[:3], axis=0)
            for j in range(3):
                change = turns[j] * (ROTATION_SCALE * np.abs(moments[j, case]))[:, None]
                end = "root" if at_root else "end"
                yield Stranger(
                    f"{name} bends more to one side than to the other, at its {end}",
                    (whitened(scene.o, change[:, :, None]),),
                )
        if effect.template_name != "symmetric":
            whole: LinkCompliance = (
                BaseCompliance(effect.where, "symmetric", effect.beam_axis, effect.length_m, name)
                if isinstance(effect, BaseCompliance)
                else LinkCompliance(effect.where, "symmetric", effect.beam_axis, effect.length_m)
            )
            scales = np.array([p.scale for p in whole.parameters])
            yield Stranger(
                f"{effect.kind} at {effect.where} beyond the template {effect.template_name}",
                (whitened(scene.o, columns.of(whole) * scales),),
            )


def _root(scene: Scene, k: int) -> Array:
    """From the link's own joint to its spring, in the spring's frame, (3,)."""
    if not k:
        return np.zeros(3)
    poses = scene.poses
    lever = rotate_back(poses.R_F[k][:, :, :1], poses.p_S[k][:, :1] - poses.p_J[k - 1][:, :1])
    return np.asarray(lever[:, 0])


def _of_time(scene: Scene) -> Iterator[Stranger]:
    """Links that grow and bow as they warm up."""
    time, case = scene.cases.time_s, scene.o.measurements.case
    if not time.size or not np.isfinite(time).all() or np.ptp(time) == 0:
        return
    t = (time - time.min()) / np.ptp(time)
    courses = [(1 - np.exp(-t / w))[case] for w in _WARMINGS] + [(t**2)[case]]
    for k, name in enumerate(scene.model.structure.arm.link_names):
        moves = scene.spring_columns.moves(k)
        along = _root(scene, k)
        size = float(np.linalg.norm(along))
        grows = [moves[:, :, :3] @ (along / size)] if size > 0 else []
        change = np.stack([*grows, *(moves[:, :, 3 + j] for j in range(3))], axis=2) * _SMALL
        yield Stranger(
            f"{name} grows or bows with time", tuple(whitened(scene.o, change * g[:, None, None]) for g in courses)
        )
