"""Model and campaign as a whitened linear system in the effects' parameters.

Readings y = f(x) + e. Around x the system is A dx = r with r = (y - f(x)) / sigma from the loaded equilibrium and A the
observation matrix of seed eqs. (9), (23), divided by sigma. In displacement mode the unloaded position of every point in
every experiment is an unknown of its own; it is eliminated by taking the mean off every group of rows it is shared by. With
displacement columns the reference reading appears as the row of zeros it is, so the same elimination gives the covariance
that differences imply.

Where the campaign states that the arm does not come back exactly (`posture_noise`), rows of one approach share a common
motion: they are whitened by blocks first, and references are eliminated after that, by projection.

A is that of the linear theory for springs (see `sensitivity`), while r comes from the loaded equilibrium: columns only
steer, residuals decide, and an outer iteration removes the difference.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.campaign import Measurements, Noise
from drake_stiffness.effects.effect import Reading
from drake_stiffness.errors import InputError
from drake_stiffness.model import Model
from drake_stiffness.posture_noise import PostureNoise, Whitening, make_whitening
from drake_stiffness.rotations import Array, logarithm, multiply
from drake_stiffness.sensitivity import sensitivity
from drake_stiffness.simulation import simulate_readings

log = logging.getLogger("drake_stiffness")


@dataclass(frozen=True, eq=False)
class Observations:
    """Readings that take part in a fit, and how rows belong together.

    Attributes
    ----------
    measurements : Measurements
        Restricted to the experiments that take part.
    displacement : bool
        Whether unloaded positions are unknowns of their own.
    sigma_p, sigma_r : float
        Standard deviation of a coordinate, m and rad.
    turned : (Mo,)
        Which readings carry an orientation.
    group, group_r : (M,), (Mo,)
        Rows of one group share a free reference (point and experiment; experiment for orientations).
    first_unloaded : (experiments,)
        Case that orientations refer to.
    whitening : Whitening or None
        For readings that share the motion of an arm that does not come back exactly.
    """

    measurements: Measurements
    displacement: bool
    sigma_p: float
    sigma_r: float
    turned: NDArray[np.int_]
    group: NDArray[np.int_]
    group_r: NDArray[np.int_]
    first_unloaded: NDArray[np.int_]
    whitening: Whitening | None = None

    @property
    def rows(self) -> int:
        return 3 * (self.measurements.case.size + self.turned.size)

    @property
    def references(self) -> int:
        """Free reference coordinates that were eliminated."""
        free = 3 * (int(self.group.max()) + 1) if self.displacement else 0
        return free + (3 * (int(self.group_r.max()) + 1) if self.turned.size else 0)

    @property
    def cluster(self) -> NDArray[np.int_]:
        """(rows,) experiment of every scalar row."""
        e = self.measurements.cases.experiment[self.measurements.case]
        return np.concatenate([np.repeat(e, 3), np.repeat(e[self.turned], 3)])


def observe(
    measurements: Measurements, displacement: bool, noise: Noise, motion: PostureNoise | None = None
) -> Observations:
    """Arrange readings for a fit.

    Parameters
    ----------
    motion : PostureNoise, optional
        How the arm comes back to a posture; without it readings are independent.

    Raises
    ------
    InputError
        If displacement is the quantity, or orientations are given, and an experiment has no unloaded step; if positions are
        the quantity but displacements were read; if orientations come without their noise.
    """
    m = measurements
    if not displacement and m.relative:
        raise InputError(
            f"{m.table.path}: quantity is 'position' but the table holds displacements (dx, dy, dz); give x, y, z columns or "
            "write quantity: displacement."
        )
    turned = _orientation_rows(m)
    if turned.size and noise.orientation_sigma_mrad is None:
        raise InputError(
            f"{m.table.path} holds orientations (rx, ry, rz) but the campaign states no noise.orientation_sigma_mrad; add it "
            "(one standard deviation of one component, mrad)."
        )
    first = np.full(len(m.experiments), -1)
    for case in np.flatnonzero(m.unloaded)[::-1]:
        first[m.cases.experiment[case]] = case
    used = np.unique(m.cases.experiment[m.case])
    lacking = [m.experiments[e] for e in used if first[e] < 0]
    if lacking and (displacement or turned.size):
        raise InputError(
            f"{m.table.path}: experiment '{lacking[0]}' has no unloaded step (all wrench columns zero), so its displacements have "
            f"no reference{_and_more(lacking)}. Add the unloaded reading, or use quantity: position."
        )
    e = m.cases.experiment[m.case]
    _, point = np.unique(m.point, return_inverse=True)
    _, group = np.unique(e * (int(point.max()) + 1) + point.reshape(-1), return_inverse=True)
    _, group_r = np.unique(e[turned], return_inverse=True)
    o = Observations(
        measurements=m,
        displacement=displacement,
        sigma_p=noise.position_sigma_mm * 1e-3,
        sigma_r=(noise.orientation_sigma_mrad or 1.0) * 1e-3,
        turned=turned,
        group=group.reshape(-1),
        group_r=group_r.reshape(-1),
        first_unloaded=first,
    )
    return o if motion is None else replace(o, whitening=_whitening(o, motion))


def _whitening(o: Observations, motion: PostureNoise) -> Whitening:
    """Blocks and references of the scalar rows: positions first, then orientations, as everywhere here."""
    m = o.measurements
    spread, block = motion.spread(m), motion.blocks(m)
    n = spread.shape[2]
    positions = (spread[:, :3] / o.sigma_p).reshape(-1, n)
    turns = (spread[o.turned, 3:] / o.sigma_r).reshape(-1, n)
    axis = np.arange(3)
    free = (3 * o.group[:, None] + axis).ravel() if o.displacement else np.full(3 * m.case.size, -1)
    free_r = (3 * o.group_r[:, None] + axis).ravel() + int(free.max()) + 1
    return make_whitening(
        np.concatenate([positions, turns]),
        np.concatenate([np.repeat(block, 3), np.repeat(block[o.turned], 3)]),
        o.cluster,
        np.concatenate([free, free_r]),
    )


def _and_more(names: list[str]) -> str:
    return f" ({len(names) - 1} more like it)" if len(names) > 1 else ""


def _orientation_rows(m: Measurements) -> NDArray[np.int_]:
    """Readings with an orientation; the same orientation written beside several points of one step counts once."""
    given = np.flatnonzero(~np.isnan(m.orientation).any(axis=1))
    if not given.size:
        return given
    keys = np.column_stack([m.case[given], m.orientation[given]])
    _, first = np.unique(keys, axis=0, return_index=True)
    if first.size < given.size:
        log.info(
            "%d orientations are repeated beside several points of a step; each is used once.", given.size - first.size
        )
    return given[np.sort(first)]


def restrict(m: Measurements, experiments: NDArray[np.bool_]) -> Measurements:
    """The measurements of some experiments only."""
    keep_case = experiments[m.cases.experiment]
    number = np.cumsum(keep_case) - 1
    rename = np.cumsum(experiments) - 1
    keep = keep_case[m.case]
    cases = m.cases.take(np.flatnonzero(keep_case))
    return replace(
        m,
        cases=replace(cases, experiment=rename[cases.experiment]),
        experiments=tuple(np.array(m.experiments)[experiments]),
        case=number[m.case[keep]],
        row=m.row[keep],
        point=m.point[keep],
        position=None if m.position is None else m.position[keep],
        orientation=m.orientation[keep],
    )


def measured(o: Observations) -> Array:
    """The readings as one vector in units of their noise, references taken off."""
    m = o.measurements
    assert m.position is not None
    return _center(o, np.concatenate([(m.position / o.sigma_p).ravel(), (m.orientation[o.turned] / o.sigma_r).ravel()]))


def predicted(o: Observations, model: Model) -> Array:
    """What the model says of the same vector, from the loaded equilibrium."""
    m = o.measurements
    return _center(o, _stack(o, simulate_readings(model, m.cases, m.case, m.point)))


def _stack(o: Observations, reading: Reading) -> Array:
    """A reading as one vector in units of the noise."""
    phi = np.zeros((3, 0))
    if o.turned.size:
        m = o.measurements
        # The rotation since the first unloaded step; a reading of that step exists for every experiment that is turned.
        case_of = np.full(m.cases.number, -1)
        case_of[m.case[::-1]] = np.arange(m.case.size)[::-1]
        start = case_of[o.first_unloaded[m.cases.experiment[m.case[o.turned]]]]
        phi = logarithm(multiply(reading.R[:, :, o.turned], reading.R[:, :, start].transpose(1, 0, 2)))
    return np.concatenate([(reading.p / o.sigma_p).T.ravel(), (phi / o.sigma_r).T.ravel()])


def residual_m(o: Observations, model: Model) -> Array:
    """(3, M) measured minus predicted in metres, the free references taken off: what the residuals are of the readings
    themselves, where whitening would mix the points of a step."""
    assert o.measurements.position is not None
    plain = replace(o, whitening=None)
    r = measured(plain) - predicted(plain, model)
    return r[: 3 * o.measurements.case.size].reshape(-1, 3).T * o.sigma_p


def _center(o: Observations, v: Array) -> Array:
    """Eliminate the free references from a vector or from every column of a matrix, by taking the group means off; where
    readings share a motion they are whitened first, and references are projected out."""
    columns = v.reshape(v.shape[0], -1)
    if o.whitening is not None:
        return o.whitening.apply(columns).reshape(v.shape)
    split = 3 * o.measurements.case.size
    parts = [columns[:split], columns[split:]]
    if o.displacement:
        parts[0] = _without_means(parts[0], o.group)
    if o.turned.size:
        parts[1] = _without_means(parts[1], o.group_r)
    return np.concatenate(parts).reshape(v.shape)


def _without_means(columns: Array, group: NDArray[np.int_]) -> Array:
    order = np.argsort(group, kind="stable")
    starts = np.flatnonzero(np.diff(group[order], prepend=-1))
    blocks = columns.reshape(group.size, -1)
    sums = np.add.reduceat(blocks[order], starts, axis=0)
    means = sums / np.bincount(group)[:, None]
    return (blocks - means[group]).reshape(columns.shape)


def columns(o: Observations, model: Model) -> Array:
    """The observation matrix in units of noise per unit of a parameter's scale, `(rows, n)`, references taken off."""
    m = o.measurements
    return whitened(o, sensitivity(model, m.cases, m.case, m.point))


def whitened(o: Observations, change: Array) -> Array:
    """Changes of the readings `(M, 6, n)`, m and rad, in units of noise, references taken off: `(rows, n)`."""
    n = change.shape[2]
    position = (change[:, :3] / o.sigma_p).reshape(3 * change.shape[0], n)
    turned = (change[o.turned, 3:] / o.sigma_r).reshape(3 * o.turned.size, n)
    return _center(o, np.concatenate([position, turned]))
