"""The beam prior: links are more or less prismatic beams, which decides what the data leave open.

A cantilever along x of length l whose section is constant has (seed eq. 24 with the values of beam theory)

    k26 = k66 l / 2,   k22 = k66 l^2 / 3,   k35 = -k55 l / 2,   k33 = k55 l^2 / 3,   k11 = 0,   k44 = 1.3 (k55 + k66) / 2

(shear and axial give neglected, torsion that of a closed thin-walled section). Real links are tapered and bent, so each
relation is an observation of zero with a standard deviation: a share of what a typical link's compliance gives in that unit.
It is added to the data's rows, and the semidefinite least squares solved again at the loaded equilibrium. What only the prior
decides is not identified: groups and standard deviations stay those of the data.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from drake_stiffness.arm import Arm
from drake_stiffness.effects.compliance import LinkCompliance
from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.identification import Solution
from drake_stiffness.intervals.cone_program import ConeLeastSquares
from drake_stiffness.intervals.profile import bounds_outside_cones
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations, columns, measured, predicted
from drake_stiffness.rotations import Array
from drake_stiffness.semidefinite import cone_blocks
from drake_stiffness.sensitivity import has_finite_differences

# Torsion over bending of a closed thin-walled square section: E I / (G J) with nu = 0.3.
_TWIST = 1.3
_MAX_ITERATIONS = 40
_STANDS = 1e-4
# Below this step, in sigma of all readings together, the last linearisation serves to the end.
_NEAR = 1.0


def prior_rows(model: Model, spread: float, typical: float) -> Array:
    """Rows P such that P x ~ 0 with unit variance, x in units of scale.

    Parameters
    ----------
    spread : float
        Standard deviation of a relation as a share of a typical link's entry.
    typical : float
        Rotational compliance of a typical link, rad/(N m).

    Returns
    -------
    (relations, n); relations that need entries the model has not are left out.
    """
    place = {name: i for i, name in enumerate(model.names)}
    rows = []
    for effect in model.effects:
        if not isinstance(effect, LinkCompliance):
            continue
        length, axis = signed_length(model.arm, effect)
        size = max(abs(length), 0.05)
        for terms, power in _relations(length):
            row = np.zeros(len(place))
            names = {f"{effect.link_name()}.{_turned(name, axis)}": factor for name, factor in terms.items()}
            if not names.keys() <= place.keys():
                continue
            for name, factor in names.items():
                row[place[name]] = factor * model.scales[place[name]]
            rows.append(row / (spread * typical * size**power))
    return np.array(rows).reshape(len(rows), len(place))


def signed_length(arm: Arm, effect: LinkCompliance) -> tuple[float, int]:
    """A link's extent along its long axis (negative where it runs against it), m, and which axis that is."""
    number = effect.site(arm)[1]
    along = arm.R_PF[number].T @ arm.p_PF[number]
    axis = "xyz".index(effect.beam_axis) if effect.template_name == "beam" else int(np.abs(along).argmax())
    return float(along[axis]), axis


def _relations(length: float) -> list[tuple[dict[str, float], int]]:
    """Relations for a beam along x, and the power of the length that their unit carries."""
    return [
        ({"k26": 1.0, "k66": -length / 2}, 1),
        ({"k22": 1.0, "k66": -(length**2) / 3}, 2),
        ({"k35": 1.0, "k55": length / 2}, 1),
        ({"k33": 1.0, "k55": -(length**2) / 3}, 2),
        ({"k44": 1.0, "k55": -_TWIST / 2, "k66": -_TWIST / 2}, 0),
        ({"k11": 10.0}, 2),
    ]


def _turned(name: str, axis: int) -> str:
    """An entry for a beam along x, permuted cyclically to another axis."""
    i, j = sorted((k % 3 + axis) % 3 + 3 * (k // 3) for k in (int(name[1]) - 1, int(name[2]) - 1))
    return f"k{i + 1}{j + 1}"


def typical_compliance(model: Model) -> float:
    """Median over links of their mean rotational compliance, rad/(N m); links that stand at zero do not count."""
    means = []
    for effect, x in zip(model.effects, model.values, strict=True):
        if isinstance(effect, LinkCompliance):
            means.append(float(np.diag(effect.matrix(x))[3:].mean()))
    positive = [m for m in means if m > 0]
    return float(np.median(positive)) if positive else 1e-7


def fit_with_prior(
    solution: Solution, o: Observations, spread: float = 0.5, progress: Callable[[str], None] = lambda text: None
) -> Solution:
    """Fit again with the beam prior, started at a fit without it.

    Parameters
    ----------
    solution : Solution
        Of the same model by the semidefinite program.
    spread : float
        See `prior_rows`; 0.5 lets tapered and stepped links in.

    Raises
    ------
    InputError
        If the spread is not positive.
    UntrustworthyError
        If the outer iteration does not come to rest.
    """
    if not (np.isfinite(spread) and spread > 0):
        raise InputError(f"spread of the beam prior: found {spread}; expected a number above 0, say 0.5.")
    model, y = solution.model, measured(o)
    P = prior_rows(model, spread, typical_compliance(model))
    blocks, (lower, upper) = cone_blocks(model), bounds_outside_cones(model)
    program, A, step, coarse = None, solution.A, np.inf, has_finite_differences(model)
    for iteration in range(1, _MAX_ITERATIONS + 1):
        if program is None or (coarse and step > _NEAR):
            A = columns(o, model) if coarse else A
            program = ConeLeastSquares(np.vstack([A, P]), blocks, lower, upper)
        x = model.x / model.scales
        residual = y - predicted(o, model)
        new = program.solve(np.concatenate([A @ x + residual, np.zeros(len(P))]))
        step = float(np.linalg.norm(A @ (new - x)))
        progress(f"beam prior, iteration {iteration}: readings move by {step:.2g} sigma")
        model = model.with_x(new * model.scales)
        if step < _STANDS:
            break
    else:
        raise UntrustworthyError(f"the fit with the beam prior does not come to rest (last step {step:.2g} sigma).")
    return replace(
        solution,
        model=model,
        A=A,
        residual=y - predicted(o, model),
        iterations=iteration,
        solver="CLARABEL, semidefinite least squares with beam prior",
    )
