"""Which experiments take no part in the fit."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.campaign import HoldOut, Measurements
from drake_stiffness.effects.effect import Cases
from drake_stiffness.errors import InputError

log = logging.getLogger("drake_stiffness")


def posture_groups(cases: Cases) -> NDArray[np.int_]:
    """A number for every experiment; experiments of one posture (to 1e-6 rad) share it, so that they stay together."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    _, first = np.unique(cases.experiment, return_index=True)
    q = cases.q[:, first].T
    # A grid cell and its neighbour may share a posture at their border, so near pairs are joined, not cells compared.
    pairs = cKDTree(q).query_pairs(1e-6, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(q), len(q)))
    return np.asarray(connected_components(links, directed=False)[1])


def ordered_groups(m: Measurements) -> NDArray[np.int_]:
    """The same for measurements, numbered by the names of experiments: what is drawn from them must not depend on the order of rows."""
    groups = posture_groups(m.cases)
    place = np.argsort(np.argsort(np.array(m.experiments)))
    first = np.full(int(groups.max()) + 1, place.size)
    np.minimum.at(first, groups, place)
    rank = np.argsort(np.argsort(first))
    return rank[groups]


def held_out_experiments(measurements: Measurements, hold_out: HoldOut | None, where: str) -> NDArray[np.bool_]:
    """Which experiments take no part in the fit.

    Raises
    ------
    InputError
        If a named experiment does not exist, or nothing is left to fit or to hold out.
    """
    held = np.zeros(len(measurements.experiments), dtype=bool)
    if hold_out is None:
        return held
    groups = ordered_groups(measurements)
    if hold_out.experiments is not None:
        for name in hold_out.experiments:
            if name not in measurements.experiments:
                raise InputError(
                    f"{where}: hold_out.experiments: no experiment '{name}' in {measurements.table.path}; it has "
                    f"{', '.join(measurements.experiments[:8])}{' ...' if len(measurements.experiments) > 8 else ''}."
                )
        named = np.isin(measurements.experiments, hold_out.experiments)
        held = np.isin(groups, groups[named])
        extra = [e for e, h, n in zip(measurements.experiments, held, named, strict=True) if h and not n]
        if extra:
            log.warning("held out as well, because they share a posture with one that is: %s", ", ".join(extra))
    else:
        assert hold_out.fraction is not None
        number = int(groups.max()) + 1
        chosen = np.random.default_rng(hold_out.seed).permutation(number)[: max(1, round(hold_out.fraction * number))]
        held = np.isin(groups, chosen)
    if held.all():
        raise InputError(f"{where}: hold_out leaves no experiment to fit; hold out fewer.")
    return held
