"""What any model could still explain: a Gaussian process over joint torques, angles, branches and time.

Every joint gets a deflection that is a sum of smooth functions - powers of its torque times harmonics of its angle, and the
branch of its load history - and the tracker a slow wander; each family with a variance of its own. It names nothing. It
tells where a gap lives and of what shape it is, and how much of it a better model could close at most.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from drake_stiffness.diagnosis.naming import Remaining
from drake_stiffness.diagnosis.signatures import Scene
from drake_stiffness.observation import Observations, columns, whitened
from drake_stiffness.rotations import Array

_ROUNDS = 30


@dataclass(frozen=True, eq=False)
class Family:
    """Columns of one place and one sort.

    Attributes
    ----------
    where : str
        A joint, "tracker", or "load".
    sort : str
        What drives them: load, angle, branch or time.
    shapes : tuple of str
        What every column is, in words.
    columns : (rows, k)
        Whitened.
    """

    where: str
    sort: str
    shapes: tuple[str, ...]
    columns: Array


# Functions of the torque t in units of its size; each is also tried times harmonics of the angle.
_OF_TORQUE: tuple[tuple[str, Callable[[Array], Array]], ...] = (
    ("a jump where the torque changes sign", np.sign),
    ("proportional to the torque", lambda t: t),
    ("even in the torque", np.abs),
    ("curved, odd in the torque", lambda t: t * np.abs(t)),
    ("curved, odd in the torque", lambda t: t**3),
)
_HARMONICS = (1, 2, 3)
_SMALL = 1e-5  # rad or m: a deflection whose effect is linear


def families(scene: Scene, like: Scene | None = None) -> list[Family]:
    """Generic columns of every joint, of the load and of the tracker.

    Parameters
    ----------
    like : Scene, optional
        Whose torques, forces and times are the units, and whose times decide whether time is looked at: for readings that a process
        fitted to others is asked of.
    """
    arm, cases = scene.model.structure.arm, scene.cases
    like = like or scene
    out = []
    for i, name in enumerate(arm.joint_names):
        tau, weight = scene.carried.tau_joint[i], scene.carried.weight_joint[i]
        t = tau / max(float(np.sqrt((like.carried.tau_joint[i] ** 2).mean())), 1e-12)
        angle = cases.q[i] * (2 * np.pi if arm.prismatic[i] else 1.0)
        waves = [wave(n * angle) for n in _HARMONICS for wave in (np.sin, np.cos)]
        of_load = [(what, f(t)) for what, f in _OF_TORQUE]
        of_load += [(f"{what}, changing with the angle", f(t) * wave) for what, f in _OF_TORQUE for wave in waves]
        branch = branch_of(tau - weight, scene)
        of_branch = [("different for loading and unloading", branch * f) for f in (np.ones_like(t), np.abs(t))]
        out += [_family(scene, i, name, "load", of_load), _family(scene, i, name, "branch", of_branch)]
        if not scene.o.displacement:
            of_angle = [("periodic in the angle, load or no load", wave) for wave in waves]
            out.append(_family(scene, i, name, "angle", of_angle))
    return [*out, _pull(scene, like), *_wander(scene, like)]


def _family(scene: Scene, joint: int, name: str, sort: str, functions: list[tuple[str, Array]]) -> Family:
    changes = np.stack([scene.deflected({joint: f * _SMALL}) for _, f in functions], axis=2)
    return Family(name, sort, tuple(what for what, _ in functions), whitened(scene.o, changes))


def _pull(scene: Scene, like: Scene) -> Family:
    """Displacements proportional to the force, in world axes and in those of the flange: a load that is not what was stated."""
    m = scene.o.measurements
    force, R = scene.cases.wrench[:3, m.case], scene.poses.R_E[:, :, m.case]
    usual = like.cases.wrench[:3, like.o.measurements.case]
    size = max(float(np.sqrt((usual**2).sum(axis=0).mean())), 1e-12)
    turned = np.einsum("jin,jn->in", R, force)
    parts, shapes = [], []
    for place in ("world", "flange"):
        for i in range(3):
            for j in range(3):
                change = np.zeros((m.case.size, 6))
                if place == "world":
                    change[:, i] = force[j] / size * _SMALL
                else:
                    change[:, :3] = (R[:, i] * turned[j]).T / size * _SMALL
                parts.append(change)
                shapes.append(f"proportional to the force, fixed in the {place}")
    return Family("load", "load", tuple(shapes), whitened(scene.o, np.stack(parts, axis=2)))


def branch_of(load: Array, scene: Scene) -> Array:
    """+1 while a joint's load grows away from zero, -1 while it falls back, 0 at the first step."""
    c = scene.cases
    out = np.zeros_like(load)
    if not c.experiment.size:
        return out
    order = np.lexsort((c.step, c.experiment))
    e, size = c.experiment[order], load[order]
    change = np.diff(size, prepend=size[:1])
    change[np.diff(e, prepend=-1) != 0] = 0.0
    out[order] = np.sign(change)
    return out


def _wander(scene: Scene, like: Scene) -> list[Family]:
    time = like.cases.time_s
    if not time.size or not np.isfinite(time).all() or np.ptp(time) == 0:
        return []
    # A time that is missing among other readings stands in the middle.
    t = np.nan_to_num(2 * (scene.cases.time_s - time.min()) / np.ptp(time) - 1)
    m = scene.o.measurements
    parts, shapes = [], []
    for power in (1, 2, 3):
        for axis in range(3):
            change = np.zeros((m.case.size, 6))
            change[:, axis] = 1e-5 * t[m.case] ** power
            parts.append(change)
            shapes.append("changing with time")
    return [Family("tracker", "time", tuple(shapes), whitened(scene.o, np.stack(parts, axis=2)))]


@dataclass(frozen=True, eq=False)
class Process:
    """A fitted Gaussian process of the remainder.

    Attributes
    ----------
    scene : Scene
        Model and readings that it is fitted to.
    weight : (k,)
        Posterior mean of the columns' coefficients.
    absorbed : (n,)
        By how much the model's own parameters, in units of scale, take up what the process says of those readings.
    share : (families,)
        Squared size of what each family explains on the fitted readings beyond what it would explain of noise, in sigma^2.
    families : list of Family
    floor : float
        Squared noise that is left beside the process, in units of the stated one: no smooth function gets below it.
    dof : float
        Degrees of freedom of that.
    """

    scene: Scene
    weight: Array
    absorbed: Array
    share: Array
    families: list[Family]
    floor: float
    dof: float

    def at(self, where: str, sorts: Collection[str] | None = None) -> float:
        """What is explained at a place, by some sorts or all."""
        return float(
            sum(
                s
                for s, f in zip(self.share, self.families, strict=True)
                if f.where == where and (not sorts or f.sort in sorts)
            )
        )

    def predict(self, o: Observations) -> Array:
        """What it says of other readings, in units of noise, beside what the model's own parameters took up of it."""
        model = self.scene.model
        said = np.hstack([f.columns for f in families(Scene(model, o), self.scene)]) @ self.weight
        return np.asarray(said - columns(o, model) @ self.absorbed)


def _inverse(A: Array) -> Array:
    """Inverse of a positive definite matrix: by Cholesky, at half the price of the general one."""
    from scipy.linalg.lapack import dpotrf, dpotri

    lower, bad = dpotrf(A, lower=1)
    if bad:
        return np.asarray(np.linalg.inv(A), dtype=np.float64)
    half: Array = np.tril(dpotri(lower, lower=1)[0])
    return np.asarray(half + np.tril(half, -1).T)


def fit_process(left: Remaining, seen: Array) -> Process:
    """Posterior mean with family variances by maximum evidence (EM), at the noise the data show.

    Parameters
    ----------
    seen : (n, r)
        Directions of the model's own parameters that were fitted, in units of scale.
    """
    found = families(left.scene)
    whole = np.hstack([f.columns for f in found])
    X = left.beside(whole)
    noise = max(1.0, left.per_dof)
    G, b = X.T @ X, X.T @ left.r
    sizes = [f.columns.shape[1] for f in found]
    family = np.repeat(np.arange(len(found)), sizes)
    variance = np.full(len(found), 1.0)
    mean, taken, rest_dof = np.zeros(b.size), np.zeros(b.size), float(max(left.dof, 1))
    for _ in range(_ROUNDS):
        prior = np.maximum(variance[family], 1e-12)
        half = np.sqrt(prior)
        inner = np.eye(b.size) + half[:, None] * G * half / noise
        inverse = _inverse(inner)
        mean = half * (inverse @ (half * b)) / noise
        spread = half[:, None] * inverse * half
        variance = np.bincount(family, mean**2 + np.diag(spread)) / np.array(sizes)
        # What every column takes of the degrees of freedom.
        taken = (spread * G).sum(axis=1) / noise
        rest_dof = max(left.dof - float(taken.sum()), 1.0)
        noise = max(float(((left.r - X @ mean) ** 2).sum()) / rest_dof, 1e-12)
    share = np.array([float(((X[:, family == k] @ mean[family == k]) ** 2).sum()) for k in range(len(found))])
    share = np.maximum(share - noise * np.bincount(family, taken), 0.0)
    A = columns(left.scene.o, left.scene.model) @ seen
    absorbed = seen @ np.linalg.lstsq(A, whole @ mean, rcond=1e-9)[0]
    return Process(left.scene, mean, absorbed, share, found, noise, rest_dof)
