"""Measurement postures with a good spread: far from each other in joint space, near nothing forbidden."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .beams import Array


def spread_postures(
    lower: Array,
    upper: Array,
    count: int,
    rng: np.random.Generator,
    accept: Callable[[Array], Array],
    *,
    candidates: int = 20_000,
) -> Array:
    """Choose `count` postures far from each other among random ones (farthest-point selection, ranges scaled to 1).

    Parameters
    ----------
    lower, upper
        (n,) ranges the candidates are drawn from, evenly.
    accept
        Says of candidates (M, n) which may be used, (M,) boolean.

    Returns
    -------
    (count, n) postures in the order they were chosen.

    Raises
    ------
    ValueError
        If fewer than `count` candidates are accepted.
    """
    drawn = rng.uniform(lower, upper, size=(candidates, len(lower)))
    drawn = drawn[accept(drawn)]
    if len(drawn) < count:
        raise ValueError(f"only {len(drawn)} of {candidates} random postures are acceptable, {count} are wanted")
    scaled = (drawn - lower) / (upper - lower)
    chosen = [0]
    distance = np.linalg.norm(scaled - scaled[0], axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(scaled - scaled[chosen[-1]], axis=1))
    return drawn[chosen]
