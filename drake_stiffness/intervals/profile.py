"""Profile-likelihood intervals: what the data and physics together allow a value to be, cones included.

All unknowns x with cones, and a linear combination c^T x. With chi2_min the least of || F x - g ||^2 inside the cones,

    low, high = min, max of c^T x    over { x in the cones : || F x - g ||^2 <= chi2_min + q },

q the quantile of chi-square with one degree of freedom: exactly the set of values that a likelihood-ratio test at that level does not
reject. It runs over all unknowns, seen or not. Where no cone takes part the ends are those of seed eq. (14). Near an
active constraint, where (14) does not apply, the test's own distribution is another one, for single parameters a narrower one: such
intervals then cover more often than they promise. For combinations of many parameters at the rim that is no theorem (the Burrus
conjecture is false); `docs/intervals.md` shows what simulation gives.

A combination is "identified" if it is unique without the cones: no direction that the data do not see has a part in it. If only the
cones keep it finite it is "bounded, not identified", and where nothing does "unbounded".
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.base_parameters import base_of, relation
from drake_stiffness.errors import InputError
from drake_stiffness.identification import Solution
from drake_stiffness.intervals.cone_range import ConeRange
from drake_stiffness.intervals.interval import Combination, Interval, Status, quantile
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations
from drake_stiffness.rotations import Array
from drake_stiffness.semidefinite import cone_blocks
from drake_stiffness.statistics import goodness

# A combination with less than this share of its length along what the data do not see is unique.
_UNIQUE = 1e-6
# Terms of a combination that its name spells out.
_TERMS = 4
# An end this close to zero, in widths of the interval, is zero.
_ZERO = 1e-6
# Below so many conic programs other processes take longer to start than they save.
_WORTH_PROCESSES = 400


@dataclass(frozen=True, eq=False)
class ProfileProblem:
    """A linearised campaign as plain arrays, in units of the parameters' scales: what other processes get.

    Attributes
    ----------
    F, g : (r, n), (r,)
        The compressed system: seen and hidden directions times their weights. Exact zeros elsewhere.
    blocks, lower, upper
        Cones and bounds, as `cone_program` takes them.
    unseen : (n, u)
        Directions without any influence, orthonormal.
    half : (n, r)
        Root of the covariance (14): half half^T.
    x, fitted : (n,)
        The model's values, and those of least squares without cones (nothing along what is unseen).
    noise_factor : float
        See `Interval`.
    """

    F: Array
    g: Array
    blocks: tuple[NDArray[np.int_], ...]
    lower: Array
    upper: Array
    unseen: Array
    half: Array
    x: Array
    fitted: Array
    noise_factor: float


def problem_of(solution: Solution, o: Observations) -> ProfileProblem:
    """The linearised campaign at a solution."""
    model, view = solution.model, solution.identifiability
    x = model.x / model.scales
    directions = np.hstack([view.seen, view.hidden])
    weight = np.concatenate([view.weight, view.hidden_weight])
    along = directions.T @ x + (directions.T @ (solution.A.T @ solution.residual)) / weight**2
    fit = goodness(solution, o)
    lower, upper = bounds_outside_cones(model)
    return ProfileProblem(
        F=weight[:, None] * directions.T,
        g=weight * along,
        blocks=cone_blocks(model),
        lower=lower,
        upper=upper,
        unseen=view.blind,
        half=directions / weight,
        x=x,
        fitted=directions @ along,
        noise_factor=fit.chi2_per_dof if fit.rejected else 1.0,
    )


def bounds_outside_cones(model: Model) -> tuple[Array, Array]:
    """Bounds (n,), (n,) in units of scale of what no cone holds already."""
    lower = np.array([p.lower for p in model.parameters]) / model.scales
    upper = np.array([p.upper for p in model.parameters]) / model.scales
    inside = [i for block in cone_blocks(model) for i in block.ravel() if i >= 0]
    lower[inside], upper[inside] = -np.inf, np.inf
    return lower, upper


def parameters_of(model: Model, names: Sequence[str] | None = None) -> tuple[Combination, ...]:
    """Single parameters as combinations; all of them by default.

    Raises
    ------
    InputError
        If the model has no parameter of a name.
    """
    place = {name: i for i, name in enumerate(model.names)}
    for name in names or ():
        if name not in place:
            raise InputError(
                f"parameter '{name}': the model has none of this name; expected one of {', '.join(model.names)}."
            )
    unit = np.eye(model.x.size)
    chosen = list(place) if names is None else names
    return tuple(Combination(name, model.parameters[place[name]].unit, unit[place[name]]) for name in chosen)


def base_combinations(solution: Solution) -> tuple[Combination, ...]:
    """The base parameters: the combinations that the readings determine, named by what they add up."""
    model = solution.model
    found = base_of(solution.identifiability, model)
    return tuple(
        Combination(relation(model.names, row, int(i), _TERMS), model.parameters[int(i)].unit, row)
        for i, row in zip(found.base, found.si(model.scales), strict=True)
    )


def profile_intervals(
    solution: Solution,
    o: Observations,
    which: Sequence[str] | Sequence[Combination] | None = None,
    level: float = 0.95,
    processes: int | None = None,
) -> tuple[Interval, ...]:
    """Profile-likelihood intervals of parameters or linear combinations of them.

    Parameters
    ----------
    which : names of parameters or combinations
        All parameters by default.
    level : float
        Between 0 and 1.
    processes : int, optional
        How many share the work; by default as many as there are cores where it is worth starting them.

    Raises
    ------
    InputError
        If a parameter or level does not exist.
    UntrustworthyError
        If a conic program cannot be solved.
    """
    if not 0.0 < level < 1.0:
        raise InputError(f"level {level:g}: expected a probability between 0 and 1, 0.95 say.")
    chosen = combinations(solution.model, which)
    problem = problem_of(solution, o)
    C = np.array([c.weights * solution.model.scales for c in chosen]).reshape(len(chosen), -1)
    ends = extremes(problem, C, np.array([quantile(level)]), processes)[:, 0]
    return tuple(
        interval(problem, c, row, (float(low), float(high)), level)
        for c, row, (low, high) in zip(chosen, C, ends, strict=True)
    )


def profile_curves(
    solution: Solution,
    o: Observations,
    which: Sequence[str] | Sequence[Combination] | None = None,
    rises: Array | None = None,
    processes: int | None = None,
) -> tuple[Array, Array]:
    """The profile of chi-square: by how much it must rise for a value to reach so far.

    Returns
    -------
    rises : (s,)
        Grid of chi-square above its constrained minimum, in units of the noise factor.
    ends : (combinations, s, 2)
        Lowest and highest value within each rise, SI. A wall that does not move with the rise is a cone's.
    """
    grid = np.linspace(0.15, 3.0, 20) ** 2 if rises is None else np.asarray(rises, dtype=float)
    chosen = combinations(solution.model, which)
    C = np.array([c.weights * solution.model.scales for c in chosen]).reshape(len(chosen), -1)
    return grid, extremes(problem_of(solution, o), C, grid, processes)


def combinations(model: Model, which: Sequence[str] | Sequence[Combination] | None) -> tuple[Combination, ...]:
    """Names and combinations as combinations."""
    if which is None:
        return parameters_of(model)
    found: list[Combination] = []
    for one in which:
        found += [one] if isinstance(one, Combination) else parameters_of(model, [one])
    return tuple(found)


def interval(
    problem: ProfileProblem, named: Combination, c: Array, ends: tuple[float, float], level: float
) -> Interval:
    """An interval from its ends; `c` (n,) are the weights in units of scale."""
    unique = is_identified(problem, c)
    # What the solver leaves of a zero: its tolerance is relative to the width, or to a unit of scale.
    width = ends[1] - ends[0] if np.isfinite(ends).all() else float(np.linalg.norm(c))
    low, high = (0.0 if abs(end) < _ZERO * width else end for end in ends)
    unknown = float("nan")
    sigma = float(np.linalg.norm(problem.half.T @ c)) * float(np.sqrt(problem.noise_factor))
    profile = (low, high)
    status: Status = "unbounded"
    if unique:
        status = "identified"
        low, high = _no_narrower(problem, c, (low, high), sigma, level)
    elif np.isfinite(ends).all():
        status = "bounded, not identified"
    return Interval(
        name=named.name,
        unit=named.unit,
        value=float(c @ problem.x),
        low=low,
        high=high,
        profile=profile,
        status=status,
        level=level,
        sigma=sigma if unique else unknown,
        least_squares=float(c @ problem.fitted) if unique else unknown,
        noise_factor=problem.noise_factor,
    )


def _no_narrower(
    problem: ProfileProblem, c: Array, ends: tuple[float, float], sigma: float, level: float
) -> tuple[float, float]:
    """The hull of the profile's interval and of what (14) gives about least squares, cut to what the cones can reach.

    Where many cones are active at once the profile of a combination of mixed signs covers less than it says (the chi-square
    threshold is no bound there). Least squares knows no cones: its interval covers exactly, and cutting away what the truth
    cannot be takes nothing from that. Where no cone is near the two are the same.
    """
    reach = float(np.sqrt(quantile(level))) * sigma
    middle = float(c @ problem.fitted)
    low, high = middle - reach, middle + reach
    sign = _sign_on_cones(problem, c)
    low, high = (max(low, 0.0) if sign > 0 else low), (min(high, 0.0) if sign < 0 else high)
    return (min(ends[0], low), max(ends[1], high)) if low <= high else ends


def _sign_on_cones(problem: ProfileProblem, c: Array) -> int:
    """+1 if c^T x cannot be negative inside the cones, -1 if it cannot be positive, 0 otherwise."""
    outside = np.ones(c.size, dtype=bool)
    values = []
    for block in problem.blocks:
        inside = block >= 0
        outside[block[inside]] = False
        half = np.where(inside, c[np.maximum(block, 0)], 0.0) * np.where(np.eye(block.shape[0], dtype=bool), 1.0, 0.5)
        values.append(np.linalg.eigvalsh(half))
    size = float(np.abs(c).max(initial=0.0))
    if np.abs(c[outside]).max(initial=0.0) > 1e-9 * size or not values:
        return 0
    spectrum = np.concatenate(values)
    return int(spectrum.min() >= -1e-9 * size) - int(spectrum.max() <= 1e-9 * size)


def is_identified(problem: ProfileProblem, c: Array) -> bool:
    """Whether c^T x is unique without the cones."""
    return bool(np.linalg.norm(problem.unseen.T @ c) <= _UNIQUE * max(float(np.linalg.norm(c)), 1e-300))


def extremes(problem: ProfileProblem, C: Array, rises: Array, processes: int | None = None) -> Array:
    """Ends (k, s, 2) of k combinations C (k, n), in units of scale, for every one of s rises of chi-square."""
    if processes is None:
        processes = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        processes = processes if 2 * C.shape[0] * rises.size >= _WORTH_PROCESSES else 1
    parts = np.array_split(np.arange(C.shape[0]), max(1, min(processes, C.shape[0])))
    if len(parts) == 1:
        return _extremes(problem, C, rises)
    from joblib import Parallel, delayed

    # Clarabel's solver cannot be pickled: every process compiles its own from the plain arrays, once.
    done: list[Any] = Parallel(n_jobs=len(parts))(delayed(_extremes)(problem, C[own], rises) for own in parts)
    return np.concatenate(done)


def _extremes(problem: ProfileProblem, C: Array, rises: Array) -> Array:
    program = ConeRange(problem.F, problem.blocks, problem.lower, problem.upper)
    x = program.solve(problem.g)
    ends = np.empty((C.shape[0], rises.size, 2))
    for i, c in enumerate(C):
        if is_identified(problem, c):  # rounding along what is unseen is not evidence of anything
            c = c - problem.unseen @ (problem.unseen.T @ c)
        for j, rise in enumerate(rises):
            ends[i, j] = program.extreme_from(x, c, problem.g, float(rise) * problem.noise_factor)
    return ends
