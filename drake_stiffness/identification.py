"""Identification: weighted least squares (seed eqs. 11-14) and the semidefinite program, around the loaded equilibrium.

Both work on the compressed system. A = Q R once; R has as many rows as unknowns, so what the solver sees does not grow with
the number of readings. The directions that A does not see are split off first (null space, exact in the linear theory); the
rest is solved, and the outer iteration repeats with residuals of the loaded equilibrium until the parameters stand.

The solvers themselves are in `semidefinite`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from drake_stiffness.effects.compliance import LinkCompliance, Spring
from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.identifiability import Identifiability, analyse, relinearised
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations, columns, measured, predicted
from drake_stiffness.rotations import Array
from drake_stiffness.semidefinite import Linearised, spring_parameters
from drake_stiffness.sensitivity import has_finite_differences
from drake_stiffness.start import with_joints_held, with_something_to_turn
from drake_stiffness.structure import acts_on_joints

Method = Literal["sdp", "least-squares"]

MOST_ITERATIONS = 60
# The parameters stand when the fitted readings move by less than this, in units of noise over all readings together.
_STANDS = 1e-5
# After the last iteration this is still small enough: no parameter moves by more than a hundredth of its own sigma.
_LAST_STEP = 1e-2
# What is smaller than this, in units of scale, is rounding.
_ROUNDING = 1e-12
# Below this step, in the same unit, the last linearisation serves to the end.
_NEAR = 1.0
# An unseen parameter of which a unit of scale turns out to move all readings by more than this deserves a second start.
_NEWLY_SEEN = 1.0


@dataclass(frozen=True, eq=False)
class Solution:
    """What an identification found.

    Attributes
    ----------
    model : Model
        With values; statistics are added by `statistics`.
    identifiability : Identifiability
        Rank, seen and unseen directions.
    A : (rows, n)
        Whitened observation matrix per unit scale at the solution.
    residual : (rows,)
        (measured - predicted) / sigma at the loaded equilibrium.
    iterations : int
    solver : str
    active : tuple of names
        Springs whose positive-semidefinite constraint is active.
    departure : float
        How far the constraints moved the fit from least squares, in sigma of all readings together.
    """

    model: Model
    identifiability: Identifiability
    A: Array
    residual: Array
    iterations: int
    solver: str
    active: tuple[str, ...]
    departure: float


def identify(
    model: Model,
    o: Observations,
    method: Method = "sdp",
    progress: Callable[[str], None] = lambda text: None,
    most_iterations: int = MOST_ITERATIONS,
) -> Solution:
    """Fit a model's parameters to observations.

    Parameters
    ----------
    model : Model
        With start values (`start.starting_model` finds a tracker frame if one is wanted).
    method : 'sdp' or 'least-squares'
    most_iterations : int
        Of every outer iteration. Fits that only ask whether a suspect helps give up sooner; it is a number of steps and no time,
        so that the answer does not depend on the machine.

    Raises
    ------
    InputError
        If `sdp` is asked of a `full` template, which has no cone, or of a mask that no positive-semidefinite matrix has.
    UntrustworthyError
        If the outer iteration does not come to rest.
    """
    if method == "sdp":
        _refuse_without_cone(model)
    springs, effects = spring_parameters(model), model.effects
    bends = [isinstance(effect, Spring) or acts_on_joints(effect) for effect in model.effects]
    if any(map(acts_on_joints, effects)) and springs.any():
        # Springs alone, and no positions: hardware then only varies what a joint's spring seems to be.
        only = model.subset([isinstance(effect, Spring) for effect in effects])
        bent = _iterate(only, replace(o, displacement=True), "least-squares", progress, most_iterations).model
        model = with_something_to_turn(model, bent)
        if method == "sdp":
            free = model.subset(bends) if o.displacement else model
            bent = _iterate(free, o, "least-squares", progress, most_iterations).model
            model = with_joints_held(model, bent)
    if o.displacement and any(bends) and not all(bends):
        # What a tracker's tilt or a zero offset does to displacements shows only on an arm that bends: springs first.
        x, own = model.x.copy(), np.repeat(bends, [len(effect.parameters) for effect in model.effects])
        x[springs] = _iterate(model.subset(bends), o, method, progress, most_iterations).model.x[springs[own]]
        model = model.with_x(x)
    solution = _iterate(model, o, method, progress, most_iterations)
    if not springs.all():
        # The same for what shows in positions only once springs are there, a payload for one.
        length = np.linalg.norm(columns(o, solution.model), axis=0)
        if (solution.identifiability.zero & (length > _NEWLY_SEEN)).any():
            solution = _iterate(solution.model, o, method, progress, most_iterations)
    return replace(solution, model=replace(solution.model, effects=effects))


def _iterate(
    model: Model, o: Observations, method: Method, progress: Callable[[str], None], most_iterations: int
) -> Solution:
    """The outer iteration; what is seen is decided at the model it starts from."""
    natural = np.repeat(
        [isinstance(e, Spring) or acts_on_joints(e) for e in model.effects], [len(e.parameters) for e in model.effects]
    )
    y = measured(o)
    constant = not has_finite_differences(model)
    A, view, program = np.empty((0, 0)), None, None
    size, damping = np.inf, 1.0
    for iteration in range(1, most_iterations + 1):
        if view is None or program is None or (not constant and size > _NEAR):
            progress(f"iteration {iteration}: observation matrix of {o.rows} rows, {model.x.size} unknowns")
            A = columns(o, model)
            view = analyse(A, coarse=not constant) if view is None else relinearised(view, A)
            program = Linearised(model, view)
        residual = y - predicted(o, model)
        x = model.x / model.scales
        # Where the data leave something open: springs and hardware of least norm, and for frames and geometry the least step (their zero
        # has no meaning, and jumping along what the data do not see would undo the linearisation).
        program.anchor = np.where(natural, 0.0, x)
        z = view.seen.T @ x + view.pseudo_inverse_seen(A, residual)
        new = program.semidefinite(z) if method == "sdp" else program.regularised(z)
        before, size = size, float(np.linalg.norm(view.weight * (view.seen.T @ (new - x))))
        progress(f"iteration {iteration}: parameters move by {size:.3g} sigma")
        # Steps that do not shrink overshoot; half way is still inside every cone, because cones are convex.
        damping = max(0.5 * damping, 0.125) if size > 0.95 * before else min(1.4 * damping, 1.0)
        new = x + damping * (new - x)
        new[np.abs(new) < _ROUNDING] = 0.0
        model = model.with_x(new * model.scales)
        if size < _STANDS or (size < 1e-3 and size > 0.5 * before):
            break
    if view is None or program is None or size > _LAST_STEP:
        raise UntrustworthyError(
            f"the parameters do not come to rest in {most_iterations} iterations (last step {size:.3g} sigma of all readings "
            "together); the start may be far off, or a tracker frame, unit or sign is wrong."
        )
    residual = y - predicted(o, model)
    active: tuple[str, ...] = ()
    if method == "sdp":
        active = program.active(model.x / model.scales)
    else:
        z = view.seen.T @ (model.x / model.scales) + view.pseudo_inverse_seen(A, residual)
        model = model.with_x(program.least_squares(z) * model.scales)
        residual = residual - A @ (model.x / model.scales - new)
    solver = program.solver if method == "sdp" else "QR"
    return Solution(model, view, A, residual, iteration, solver, active, program.departure)


def _refuse_without_cone(model: Model) -> None:
    for effect in model.effects:
        if getattr(effect, "template_name", None) == "full":
            raise InputError(
                f"link '{effect.where}' has the template 'full' (36 independent entries): a matrix that need not be symmetric has no "
                "positive-semidefinite cone, so method sdp cannot be used. Take template: symmetric, or --method least-squares."
            )
        lacking = effect.template.unsupported if isinstance(effect, LinkCompliance) else ()
        if lacking:
            raise InputError(
                f"link '{effect.where}' has entries off the diagonal without {', '.join(lacking)}: no positive-semidefinite matrix has "
                "this pattern. Add the diagonal entries, or take method least-squares."
            )
