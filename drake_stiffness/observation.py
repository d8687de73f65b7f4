"""Model and campaign as a whitened linear system in the effects' parameters.

Readings y = f(x) + e. Around x the system is A dx = r with r = (y - f(x)) / sigma from the loaded equilibrium and A the
observation matrix of seed eqs. (9), (23), divided by sigma. In displacement mode the unloaded position of every point in
every experiment is an unknown of its own; it is eliminated by taking the mean off every group of rows it is shared by. With
displacement columns the reference reading appears as the row of zeros it is, so the same elimination gives the covariance
that differences imply.

Columns of linear springs are taken at the undeflected posture. That makes them exactly the columns of the linear theory -
redundancies stay exact, ranks have visible gaps - and an outer iteration on the residual of the loaded equilibrium removes
the difference: columns only steer, residuals decide.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Poses, forward, joint_jacobian, link_jacobian, torques
from drake_stiffness.campaign import Measurements, Noise
from drake_stiffness.effects.compliance import Spring
from drake_stiffness.effects.effect import Cases, Reading
from drake_stiffness.equilibrium import solve_equilibrium
from drake_stiffness.errors import InputError
from drake_stiffness.model import Model
from drake_stiffness.rotations import Array, logarithm, multiply, rotate
from drake_stiffness.simulation import read

log = logging.getLogger("drake_stiffness")

# Central differences step by this share of a parameter's scale: truncation and rounding both stay below 1e-9.
_STEP = 0.05


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
    """

    measurements: Measurements
    displacement: bool
    sigma_p: float
    sigma_r: float
    turned: NDArray[np.int_]
    group: NDArray[np.int_]
    group_r: NDArray[np.int_]
    first_unloaded: NDArray[np.int_]

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


def observe(measurements: Measurements, displacement: bool, noise: Noise) -> Observations:
    """Arrange readings for a fit.

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
    return Observations(
        measurements=m,
        displacement=displacement,
        sigma_p=noise.position_sigma_mm * 1e-3,
        sigma_r=(noise.orientation_sigma_mrad or 1.0) * 1e-3,
        turned=turned,
        group=group.reshape(-1),
        group_r=group_r.reshape(-1),
        first_unloaded=first,
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
    return _center(o, _stack(o, _read_all(o, model)))


def _read_all(o: Observations, model: Model) -> Reading:
    m = o.measurements
    return read(model, solve_equilibrium(model.structure, m.cases), m.cases, m.case, m.point)


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


def _center(o: Observations, v: Array) -> Array:
    """Take the group means off a vector or off every column of a matrix: eliminates the free references."""
    columns = v.reshape(v.shape[0], -1)
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
    A = np.empty((o.rows, model.x.size))
    spring_columns = _SpringColumns(o, model) if any(isinstance(e, Spring) for e in model.effects) else None
    for effect, own in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, Spring):
            assert spring_columns is not None
            A[:, own] = spring_columns.of(effect)
        else:
            A[:, own] = _differences(o, model, own)
    A *= model.scales
    return _center(o, A)


def has_finite_differences(model: Model) -> bool:
    """Whether any column is a difference quotient (then ranks are judged more coarsely)."""
    return any(not isinstance(effect, Spring) for effect in model.effects)


def _differences(o: Observations, model: Model, own: slice) -> Array:
    """Central differences of the loaded readings; effects on readings reuse the equilibrium."""
    out = np.empty((o.rows, own.stop - own.start))
    m = o.measurements
    fixed = None
    if model.effects[model.slices.index(own)].station == "reading":
        fixed = solve_equilibrium(model.structure, m.cases)
    for place, number in enumerate(range(own.start, own.stop)):
        h = _STEP * model.scales[number]
        ends = []
        for sign in (1.0, -1.0):
            x = model.x.copy()
            x[number] += sign * h
            other = model.with_x(x)
            equilibrium = fixed or solve_equilibrium(other.structure, m.cases)
            ends.append(_stack(o, read(other, equilibrium, m.cases, m.case, m.point)))
        out[:, place] = (ends[0] - ends[1]) / (2 * h)
    return out


class _SpringColumns:
    """Columns J omega J^T W of linear springs at the undeflected posture (seed eq. 23), as the instruments see them."""

    def __init__(self, o: Observations, model: Model) -> None:
        self.o, self.arm = o, model.structure.arm
        m = o.measurements
        cases = m.cases
        wrench = cases.wrench
        poses = forward(self.arm, cases.q)
        for effect, x in model.structure.wrench_effects:
            wrench = effect.on_wrench(wrench, cases, poses.R_E, x)
        links = [True] * (self.arm.num_joints + 1)
        self.tau_joint, self.tau_link = torques(self.arm, poses, wrench, cases.p_ELoad, None, links)
        self.poses = _take(poses, m.case)
        R = self.poses.R_E
        self.p = self.poses.p_E + rotate(R, model.point_positions(m.point))
        self.turn_p, self.turn_r = _instrument_jacobians(model, cases, Reading(self.p, R, m.point, m.case))

    def of(self, effect: Spring) -> Array:
        place, number = effect.site(self.arm)
        case = self.o.measurements.case
        if place == "joint":
            J = joint_jacobian(self.arm, self.poses, self.p)[number][None]
            tau = self.tau_joint[number][None, case]
        else:
            J = link_jacobian(self.poses, number, self.p)
            tau_k = self.tau_link[number]
            assert tau_k is not None
            tau = tau_k[:, case]
        # the column of an unknown is the sum over ij of J_i omega_ij tau_j; omega is sparse, so go through its ones
        out = np.zeros((len(effect.basis), 6, case.size))
        for unknown, i, j in zip(*np.nonzero(effect.basis), strict=True):
            out[unknown] += effect.basis[unknown, i, j] * J[i] * tau[j]
        dp = (
            np.einsum("abm,lbm->mal", self.turn_p, out[:, :3])
            if self.turn_p is not None
            else out[:, :3].transpose(2, 1, 0)
        )
        rows = [(dp / self.o.sigma_p).reshape(-1, out.shape[0])]
        if self.o.turned.size:
            phi = out[:, 3:, self.o.turned]
            if self.turn_r is not None:
                phi = np.einsum("abm,lbm->lam", self.turn_r[:, :, self.o.turned], phi)
            rows.append((phi.transpose(2, 1, 0) / self.o.sigma_r).reshape(-1, out.shape[0]))
        return np.concatenate(rows)


def _take(poses: Poses, case: NDArray[np.int_]) -> Poses:
    """Poses reading by reading; constants that broadcast stay as they are."""

    def pick(a: Array) -> Array:
        return a if a.shape[-1] == 1 else a[..., case]

    def picks(entries: list[Array]) -> list[Array]:
        return [pick(a) for a in entries]

    return Poses(
        R_F=picks(poses.R_F),
        p_F=picks(poses.p_F),
        p_S=picks(poses.p_S),
        axis=picks(poses.axis),
        p_J=picks(poses.p_J),
        p_C=picks(poses.p_C),
        R_E=pick(poses.R_E),
        p_E=pick(poses.p_E),
    )


def _instrument_jacobians(model: Model, cases: Cases, reading: Reading) -> tuple[Array | None, Array | None]:
    """How instruments pass on a small displacement (3, 3, M) and a small rotation (3, 3, M); None where they pass it as is."""
    effects = [(e, x) for e, x in zip(model.effects, model.values, strict=True) if e.station == "reading"]
    if not effects:
        return None, None

    def chain(r: Reading) -> Reading:
        for effect, x in effects:
            r = effect.on_reading(r, cases, x)
        return r

    h = 1e-3
    D = np.empty((3, 3, reading.p.shape[1]))
    for axis in range(3):
        step = np.zeros((3, 1))
        step[axis] = h
        D[:, axis] = (chain(replace(reading, p=reading.p + step)).p - chain(replace(reading, p=reading.p - step)).p) / (
            2 * h
        )
    return D, multiply(chain(reading).R, reading.R.transpose(1, 0, 2))
