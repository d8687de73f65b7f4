"""Which effects nobody could tell from a true one: those whose left-over carries the true one's."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from blind_trials.hidden import Hidden
from blind_trials.hidden_around import DRAWS, places
from blind_trials.oracle import Oracle, end_springs
from blind_trials.stands import Array

#: How often a kind's constants are drawn: kinds with directions until they are spanned, others to see how they vary.
_DRAWN = {
    "joint_hysteresis": 8,
    "joint_hardening": 6,
    "gravity_compensator": 6,
    "joint_mesh_stiffness": 60,
    "joint_periodic_error": 60,
    "force_sensor_bias": 8,
    "force_sensor_misalignment": 8,
    "tracker_drift": 3,
    "tracker_frame": 3,
    "reflector_offset": 3,
    "payload": 4,
    "link_geometry": 5,
}
#: Kinds whose constants are shapes: one draw at a time is compared; of all others the span.
_SHAPES = ("joint_hysteresis", "joint_hardening", "gravity_compensator")
_LEAST_SIGMA = 1e-3


def likenesses(oracle: Oracle, hidden: Hidden, suspects: set[str], rng: np.random.Generator) -> dict[str, float]:
    """Of suspects ("kind at where") the largest correlation of what they can show with the true signature; the true one has 1.

    Parameters
    ----------
    suspects
        What is looked at: others are not of the catalogue, or need what the campaign does not have.
    """
    true = oracle.signature(hidden)
    true = true / np.linalg.norm(true)
    found = {name: _carries(oracle, some, true) for name, some in _drawn(oracle, suspects - {hidden.name}, rng)}
    return found | ({hidden.name: 1.0} if hidden.known else {})


def _drawn(oracle: Oracle, suspects: set[str], rng: np.random.Generator) -> Iterator[tuple[str, list[Hidden]]]:
    """Every suspect with draws of its constants."""
    for kind, draw in DRAWS.items():
        if kind == "outliers":
            continue
        for where in places(oracle.setting, kind):
            some = [draw(oracle.setting, where, rng) for _ in range(_DRAWN.get(kind, 1))]
            if some[0].name in suspects:
                yield some[0].name, some


def _carries(oracle: Oracle, some: list[Hidden], true: Array) -> float:
    """Largest correlation of the true left-over with what a kind at a place can show."""
    kind = some[0].kind
    if kind in ("link_compliance", "base_compliance"):
        return _within(_link_columns(oracle, some[0].where), true)
    columns = np.array([oracle.quick_signature(one) for one in some])
    if kind in _SHAPES:
        return max(_within(column[None], true) for column in columns)
    # Constants of one frame or one harmonic go together.
    groups = np.array([str(one.constants.get("frame", one.constants.get("harmonic", ""))) for one in some])
    return max(_within(columns[groups == group], true) for group in np.unique(groups))


def _link_columns(oracle: Oracle, where: str) -> Array:
    """What a link's whole spring can show: the catalogue's has more freedom than the beam that is hidden."""
    s = oracle.setting
    link = 0 if where == "base" else s.stand.chain.link_names.index(where)
    return np.array([oracle.left(s.read(world) - oracle.clean) for world in end_springs(s, link)])


def _within(columns: Array, true: Array) -> float:
    """Length of the part of a unit vector in the span of some rows."""
    size = np.linalg.norm(columns, axis=1)
    able = columns[size > _LEAST_SIGMA] / size[size > _LEAST_SIGMA, None]
    if len(able) == 0:
        return 0.0
    U, d, _ = np.linalg.svd(able.T, full_matrices=False)
    return float(np.linalg.norm(U[:, d > 1e-3 * d[0]].T @ true))
