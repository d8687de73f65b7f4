"""Nonlinear constants improved around a fitted model: where an effect is strong, what was best at the old linearisation is not yet right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drake_stiffness.diagnosis.evidence import basis_of
from drake_stiffness.diagnosis.signatures import Scene
from drake_stiffness.effects import Effect
from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.identification import Solution
from drake_stiffness.observation import Observations, columns, measured, predicted

# Steps are shares of the constants; from large to small ones, each kept as long as it helps.
_STEPS, _MOST_TRIED = (0.1, 0.03, 0.01, 0.003), 60
# Squared sigma that a change must gain.
_GAIN = 4.0


def sharpened(solution: Solution, o: Observations, effect: Effect) -> Effect:
    """The effect with better constants, or itself.

    A neighbour takes its place in the fitted model with all values as they are; what that leaves is judged with the model's own columns
    projected out, as a refit would to first order.

    Parameters
    ----------
    effect : Effect
        One of the model's.
    """
    model = solution.model
    Q = basis_of(columns(o, model) @ solution.identifiability.seen)
    y, scene = measured(o), Scene(model, o)

    def rest(other: Effect) -> float:
        if not scene.shows(other):
            return np.inf
        effects = tuple(other if e is effect else e for e in model.effects)
        try:
            r = y - predicted(o, replace(model, effects=effects, statistics=None))
        except (InputError, UntrustworthyError):
            return np.inf
        return float(r @ r) - float(np.sum((Q.T @ r) ** 2))

    best, left, tried = effect, rest(effect), 0
    for step in _STEPS:
        while tried < _MOST_TRIED:
            found = [(rest(other), other) for other in best.neighbours(step)]
            tried += len(found)
            if not found or min(f[0] for f in found) > left - _GAIN:
                break
            left, best = min(found, key=lambda f: f[0])
    return best
