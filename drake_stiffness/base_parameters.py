"""Base parameters: the combinations that readings determine, chosen by a rank-revealing factorisation (seed 4.1, groups G2, G3).

Columns of unit length are taken one after the other until the rank behind the singular-value gap is reached: joints first, then
diagonal entries of links, then other entries, then instruments and geometry. What is left depends on what was taken,
A_i = sum_j A_j S_ji, so for every parameter vector

    A x = A_base (L x)      with L = (I, S):   beta_j = x_j + sum_i S_ji x_i,

and no reading depends on anything but beta = L x. A base parameter with the parameters that flow into it is a subgroup of G3 in
the words of the paper: one of them can be determined if the rest are given.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.effects.compliance import JointCompliance, LinkCompliance
from drake_stiffness.identifiability import Identifiability
from drake_stiffness.identification import Solution
from drake_stiffness.model import Model
from drake_stiffness.rotations import Array

# Inside a class, columns that stand out this much from those taken before go first; then weaker ones. So nothing nearly
# dependent is taken while something independent is left, and among equals the order of the chain keeps relations short.
_STANDING_OUT = (0.1, 1e-2, 1e-3, 1e-5, 1e-7)


@dataclass(frozen=True, eq=False)
class BaseMap:
    """The map from all parameters to a base set, in units of the parameters' scales.

    Attributes
    ----------
    base : (r,) int
        Parameters chosen, in the model's order.
    matrix : (r, n)
        L in beta = L x: identity at the base, zero at G2.
    """

    base: NDArray[np.int_]
    matrix: Array

    def si(self, scales: Array) -> Array:
        """The same map (r, n) between SI values."""
        return self.matrix * scales[self.base][:, None] / scales

    def partners(self) -> tuple[tuple[int, ...], ...]:
        """For every parameter those it shares a relation with: a base parameter and what flows into it."""
        found: list[set[int]] = [set() for _ in range(self.matrix.shape[1])]
        for j, row in zip(self.base.tolist(), self.matrix, strict=True):
            for i in np.flatnonzero(row).tolist():
                if i != j:
                    found[i].add(j)
                    found[j].add(i)
        return tuple(tuple(sorted(partners)) for partners in found)


@dataclass(frozen=True, eq=False)
class BaseValues:
    """What the readings say of the base parameters, SI.

    Attributes
    ----------
    least_squares : (r,)
        From unconstrained least squares on what is fitted.
    model : (r,)
        L x of the model as it stands (it differs where a constraint is active).
    covariance : (r, r)
        Seed eq. (14) (or what takes its place where the noise is rejected) on the base, hidden directions included.
    sigma : (r,)
        Infinite where nothing that counts is seen.
    hidden : (r,) bool
        Whether most of the variance is what the noise hides: the value is no estimate then.
    """

    least_squares: Array
    model: Array
    covariance: Array
    sigma: Array
    hidden: NDArray[np.bool_]


def priority(model: Model) -> NDArray[np.int_]:
    """(n,) in which order parameters are taken into a base: joints, diagonals of links, their other entries, the rest.

    Of the rest, effects of one parameter (a zero offset) go before those of several (a frame).
    """
    classes: list[int] = []
    for effect in model.effects:
        number = len(effect.parameters)
        if isinstance(effect, JointCompliance):
            classes += [0]
        elif isinstance(effect, LinkCompliance):
            classes += [1 if i == j else 2 for i, j in effect.template.entries]
        else:
            classes += [3 if number == 1 else 4] * number
    return np.array(classes, dtype=int)


def base_of(view: Identifiability, model: Model) -> BaseMap:
    """The base set of a model and the map to it."""
    base = np.array(select(view.unit, priority(model), view.algebraic_rank), dtype=int)
    return BaseMap(base, mapping(view, base))


def select(unit: Array, classes: NDArray[np.int_], rank: int) -> list[int]:
    """`rank` independent columns of a matrix with unit columns, lower classes first, sorted.

    Greedy Gram-Schmidt with reorthogonalisation. Inside a class the columns that stand out most from those taken go first, in
    steps of decades, and inside a decade those that come first.
    """
    chosen: list[int] = []
    rest = unit.copy()
    floors = (*_STANDING_OUT, 0.0)
    for number in sorted(set(classes.tolist())):
        own = np.flatnonzero(classes == number).tolist()
        last = number == classes.max()
        for floor in floors if last else floors[:-1]:
            for i in own:
                if len(chosen) == rank:
                    return sorted(chosen)
                size = float(np.linalg.norm(rest[:, i]))
                if i in chosen or size <= floor:
                    continue
                chosen.append(i)
                direction = rest[:, i] / size
                for _ in range(2):
                    rest -= np.outer(direction, direction @ rest)
    return sorted(chosen)


def mapping(view: Identifiability, base: NDArray[np.int_]) -> Array:
    """L (r, n) in units of scale for a given base; shares below the tolerance of the gap are zero.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the least-squares solver fails.
    """
    share, *_ = np.linalg.lstsq(view.unit[:, base], view.unit, rcond=None)
    share[np.abs(share) < view.tolerance] = 0.0
    share[:, view.zero] = 0.0
    share[:, base] = np.eye(base.size)
    return np.asarray(share * view.length / view.length[base][:, None])


def base_values(solution: Solution, found: BaseMap, covariance: Array) -> BaseValues:
    """Values and standard deviations of the base parameters.

    Parameters
    ----------
    covariance : (n, n)
        Of the identifiable combinations, SI, as `model.Statistics` has it.
    """
    view, model = solution.identifiability, solution.model
    x = model.x / model.scales
    fitted = x + view.seen @ view.pseudo_inverse_seen(solution.A, solution.residual)
    unit = model.scales[found.base]
    scaled = found.matrix @ (covariance / np.outer(model.scales, model.scales)) @ found.matrix.T
    variance = np.diag(scaled).copy()
    hidden = np.diag(found.matrix @ view.hidden_covariance() @ found.matrix.T) > 0.5 * np.diag(
        found.matrix @ (view.covariance() + view.hidden_covariance()) @ found.matrix.T
    )
    faint = np.abs(found.matrix @ view.faint).max(axis=1, initial=0.0) > 1e-6
    return BaseValues(
        least_squares=found.matrix @ fitted * unit,
        model=found.matrix @ x * unit,
        covariance=scaled * np.outer(unit, unit),
        sigma=np.where(faint, np.inf, np.sqrt(np.maximum(variance, 0.0)) * unit),
        hidden=hidden | faint,
    )


def relation(names: tuple[str, ...], coefficients: Array, first: int, most: int | None = None) -> str:
    """A combination in words: `joint_2 + link_1.k55 - 0.8696 link_2.k35`, at most so many terms."""
    others = [i for i in np.flatnonzero(coefficients).tolist() if i != first]
    shown = others if most is None or len(others) <= most else others[: most - 1]
    terms = [f"{'-' if coefficients[i] < 0 else '+'} {_factor(coefficients[i])}{names[i]}" for i in shown]
    left = len(others) - len(shown)
    return " ".join([names[first], *terms, *([f"+ ... ({left} more)"] if left else [])])


def _factor(coefficient: float) -> str:
    """The size of a coefficient, nothing where it is one."""
    text = f"{abs(coefficient):.4g}"
    return "" if text == "1" else f"{text} "


def merges(names: tuple[str, ...], coefficients: Array, first: int) -> str:
    """`joint_2 merges with link_1.k55 and link_2.k55`; the empty text where nothing merges."""
    return said(names[first], (names[i] for i in np.flatnonzero(coefficients).tolist() if i != first))


def said(name: str, partners: Iterable[str]) -> str:
    """Who merges with whom in a sentence."""
    others = list(partners)
    if not others:
        return ""
    listed = others[0] if len(others) == 1 else f"{', '.join(others[:-1])} and {others[-1]}"
    return f"{name} merges with {listed}"
