"""What an observer could know who is told the true effect: the left-over of its signature, and its test.

Signatures are differences of the plant's own readings, in units of the noise. What is free in the job is projected out: the
reference of every point in every experiment (displacements), and the springs of the base model - on the plant, a spring
there made a little softer. Nothing of the packages on trial is used.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from plants.end_spring import EndSpring
from plants.measured_world import MeasuredWorld

from blind_trials.hidden import Hidden
from blind_trials.setting import Setting
from blind_trials.stands import SIGMA_M, Array

# A spring is made softer by so much that readings move by some micrometres.
_SOFTER = 3e-3


@dataclass(frozen=True)
class Oracle:
    """The setting seen through what the base model can absorb.

    Attributes
    ----------
    setting
    kept
        (E,) experiments that take part (all, or those a job does not hold out).
    springs
        `spring_columns` of the setting.
    """

    setting: Setting
    kept: Array
    springs: Array

    @cached_property
    def _rows(self) -> Array:
        return np.asarray(self.kept[self.setting.experiment.course.experiment])

    @cached_property
    def clean(self) -> Array:
        """Readings of the world without anything hidden, (N, P, 3), m, as exact as differences need."""
        return self.setting.read(self.setting.world)

    @cached_property
    def basis(self) -> Array:
        """Orthonormal basis (rows, r) of what the base model's springs can absorb."""
        matrix = np.array([self.whitened(change) for change in self.springs]).T
        matrix /= np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        U, size, _ = np.linalg.svd(matrix, full_matrices=False)
        return np.asarray(U[:, size > 1e-4 * size[0]])

    def whitened(self, change: Array) -> Array:
        """A change of the readings (N, P, 3) in units of noise, references taken off: (rows,)."""
        rows = change[self._rows] / SIGMA_M
        if self.setting.quantity == "displacement":
            experiment = self.setting.experiment.course.experiment[self._rows]
            for e in np.unique(experiment):
                rows[experiment == e] -= rows[experiment == e].mean(axis=0)
        return np.asarray(rows.reshape(-1))

    def left(self, change: Array) -> Array:
        """What the base model leaves of a change of the readings, (rows,)."""
        v = self.whitened(change)
        return np.asarray(v - self.basis @ (self.basis.T @ v))

    def signature(self, hidden: Hidden, size: float = 1.0) -> Array:
        """What is left of an effect of some size: its length is its visible size in sigma."""
        return self.left(self.setting.read(hidden.change(self.setting.world, size)) - self.clean)

    @cached_property
    def levers(self) -> tuple[Array, Array]:
        """Change of the readings per unit deflection of every joint (n, N, P, 3), and what the joints carry (n, N)."""
        e, s, arm = self.setting.experiment, self.setting.stand, self.setting.world.arm
        shape = arm.shape(e.q, self.setting.start)
        points = shape.p[:, None] + np.einsum("nij,pj->npi", shape.R, s.targets)
        along = np.broadcast_to(shape.joint_a[:, :, None], (s.chain.size, *points.shape))
        turned = np.cross(along, points - shape.joint_p[:, :, None])
        slides = np.array(s.chain.prismatic)[:, None, None, None]
        return np.where(slides, along, turned), self.setting.torque

    def quick_signature(self, hidden: Hidden) -> Array:
        """`signature` at size 1, for physics in joints without the little that its deflection changes of the loads."""
        world = hidden.change(self.setting.world, 1.0)
        parts = world.arm.joint_physics[len(self.setting.world.arm.joint_physics) :]
        if not parts:
            return self.signature(hidden)
        levers, torque = self.levers
        e = self.setting.experiment
        turned = sum(part.turn(torque, e.q, e.course) for part in parts)
        return self.left(np.einsum("kn,knpi->npi", turned, levers))


def spring_columns(s: Setting, kept_in: Path | None = None) -> Array:
    """Changes of the readings (springs, N, P, 3) by each of the base model's springs; kept in a folder, for they are dear."""
    path = None if kept_in is None else kept_in / f"{s.label}.npy"
    if path is not None and path.exists():
        return np.asarray(np.load(path))
    clean = s.read(s.world)
    columns = np.array([s.read(world) - clean for world in spring_changes(s)])
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.with_suffix(f".{os.getpid()}").open("wb") as file:
            np.save(file, columns)
        path.with_suffix(f".{os.getpid()}").rename(path)
    return columns


def spring_changes(s: Setting) -> list[MeasuredWorld]:
    """The world with each of the base model's springs a little softer."""
    arm, chain, worlds = s.world.arm, s.stand.chain, []
    for i, name in enumerate(s.joint_names):
        if name != s.rigid_joint:
            softer = arm.joint_compliance.copy()
            softer[i] *= 1.0 + _SOFTER
            worlds.append(s.world.with_arm(joint_compliance=softer))
    if not s.links:
        return worlds
    for link in range(chain.size + 1):
        worlds += end_springs(s, link)
    return worlds


def end_springs(s: Setting, link: int) -> list[MeasuredWorld]:
    """The world with each entry of a spring of the beam template at the end of a link, one at a time."""
    arm, chain, worlds = s.world.arm, s.stand.chain, []
    axis = int(np.argmax(np.abs(chain.end_R[link].T @ chain.end_p[link])))
    flexible = replace(arm, link_factors=np.ones_like(arm.link_factors)).element_compliance()
    size = _SOFTER * np.abs(flexible[link]).sum(axis=0)[3:, 3:].max()
    for i, j in beam_entries(axis):
        spring = np.zeros((6, 6))
        spring[i, j] = spring[j, i] = size
        part = EndSpring(link, spring, arm.segments.end_R[link])
        worlds.append(s.world.with_arm(link_physics=(*arm.link_physics, part)))
    return worlds


def beam_entries(axis: int) -> list[tuple[int, int]]:
    """Entries of the beam template about a long axis: the diagonal, and what bends with a shift across the axis."""
    y, z = (axis + 1) % 3, (axis + 2) % 3
    return [*((i, i) for i in range(6)), (y, 3 + z), (z, 3 + y)]


def detected(left: Array, data: Array, level: float) -> tuple[float, bool]:
    """Test of one known regressor in data (both left-overs): the statistic in sigma, and whether it passes two-sided."""
    from scipy.stats import norm

    z = float(left @ data / np.linalg.norm(left))
    return z, bool(abs(z) > norm.isf(level / 2))


def power(sigma: float, parameters: int, level: float) -> float:
    """Chance that a test of so many degrees of freedom at this level finds an effect of `sigma`."""
    from scipy.stats import chi2, ncx2

    return float(ncx2.sf(chi2.isf(level, parameters), parameters, sigma**2))
