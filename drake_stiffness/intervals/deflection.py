"""Profile-likelihood intervals of predicted deflections: a pose, a load and a point make a linear combination of the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.effects.effect import Cases
from drake_stiffness.identification import Solution
from drake_stiffness.intervals.interval import Combination, Interval
from drake_stiffness.intervals.profile import profile_intervals
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations
from drake_stiffness.simulation import simulate_displacement
from drake_stiffness.support import displacement_gradient


def deflection_combinations(
    model: Model, cases: Cases, case: NDArray[np.int_], point: NDArray[np.str_], names: Sequence[str]
) -> tuple[Combination, ...]:
    """The three coordinates of every displacement as combinations of the parameters (linear theory of seed eq. 9).

    Parameters
    ----------
    cases, case, point
        M readings as `simulation` takes them.
    names : M names
    """
    gradient = displacement_gradient(model, cases, case, point) / model.scales
    return tuple(
        Combination(f"{name} d{axis}", "m", gradient[i, c])
        for i, name in enumerate(names)
        for c, axis in enumerate("xyz")
    )


def deflection_intervals(
    solution: Solution,
    o: Observations,
    cases: Cases,
    case: NDArray[np.int_],
    point: NDArray[np.str_],
    names: Sequence[str],
    level: float = 0.95,
    processes: int | None = None,
) -> tuple[Interval, ...]:
    """Intervals of predicted displacements (loaded minus unloaded at the same joints), m, all cones respected.

    The value is the loaded equilibrium's; the interval around it is that of the linear theory. A deflection of which some part rests on
    nothing that was seen is "bounded, not identified" where the cones keep that part finite: its interval then includes it.

    Raises
    ------
    InputError, UntrustworthyError
        See `profile.profile_intervals`; NoEquilibriumError for a load that the arm cannot carry.
    """
    model = solution.model
    chosen = deflection_combinations(model, cases, case, point, names)
    exact = simulate_displacement(model, cases, case, point).dp.T.ravel()
    found = profile_intervals(solution, o, chosen, level, processes)
    return tuple(_moved(one, float(value) - one.value) for one, value in zip(found, exact, strict=True))


def _moved(one: Interval, by: float) -> Interval:
    """The interval with everything shifted by what the linear theory leaves out."""
    return replace(
        one,
        value=one.value + by,
        low=one.low + by,
        high=one.high + by,
        profile=(one.profile[0] + by, one.profile[1] + by),
        least_squares=one.least_squares + by,
    )
