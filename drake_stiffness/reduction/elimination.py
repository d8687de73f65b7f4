"""Which parameters a linear system can carry: ratios of value to noise (seed eq. 20), and dropping what falls below a threshold.

Everything works on one linearisation, in units of the noise and of the parameters' scales. What is never dropped (frames,
geometry, protected parameters) is projected out first, so that it takes part in every fit and every standard deviation. The
rest stands and falls in *candidates*: a compliance alone, any other elastic effect as a whole, because half a gravity
compensator means nothing. A candidate's ratio is the root of what chi-square grows by when it is taken away and all the rest
is fitted again; for one parameter that is exactly |value| / sigma of seed eqs. (14), (20).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.base_parameters import priority, select
from drake_stiffness.effects.compliance import Spring
from drake_stiffness.errors import InputError
from drake_stiffness.identifiability import HIDDEN_BELOW, numerical_rank
from drake_stiffness.identification import Solution
from drake_stiffness.observation import Observations, measured, predicted
from drake_stiffness.rotations import Array
from drake_stiffness.sensitivity import has_finite_differences

# A column that keeps less than this of its length outside what is always kept is redundant (difference quotients are good to 1e-9).
_REDUNDANT = 1e-7


@dataclass(frozen=True, eq=False)
class Candidates:
    """A linear system in what may be dropped.

    Attributes
    ----------
    names : tuple of m names
    groups : tuple of m int arrays
        Columns of each candidate.
    A : (r, n)
        Compressed columns, what is always kept projected out.
    g : (r,)
        What is to be explained when none of the candidates is there.
    part : (m, r)
        Contribution to `g` that vanishes with a candidate that is no spring; zero for springs, whose columns say it all.
    classes : (n,) int
        In which order columns are taken into a base (`base_parameters.priority`).
    coarse : bool
        Whether columns are difference quotients.
    always : tuple of names
        What is kept whatever its ratio.
    """

    names: tuple[str, ...]
    groups: tuple[NDArray[np.int_], ...]
    A: Array
    g: Array
    part: Array
    classes: NDArray[np.int_]
    coarse: bool
    always: tuple[str, ...]

    def take(self, which: Iterable[int]) -> tuple[Array, Array]:
        """Columns and right-hand side of a model with these candidates only."""
        chosen = list(which)
        cols = np.concatenate([np.zeros(0, dtype=int), *(self.groups[i] for i in chosen)])
        return self.A[:, cols], self.g - self.part[chosen].sum(axis=0)


def candidates(solution: Solution, o: Observations, protect: Iterable[str] = ()) -> Candidates:
    """The linear system at a solution.

    Parameters
    ----------
    protect : iterable of names
        Parameters (`joint_2`, `link_2.k26`) or effects (`gravity_compensator`, or `where.kind`) that are always kept.

    Raises
    ------
    InputError
        If a protected name is none of the model's.
    """
    protect, model = tuple(protect), solution.model
    known = {*model.names, *(e.kind for e in model.effects), *(f"{e.where}.{e.kind}" for e in model.effects)}
    for name in protect:
        if name not in known:
            raise InputError(f"protect: found '{name}'; the model has {', '.join(model.names)}.")
    A, x = solution.A, model.x / model.scales
    reading = measured(o) - solution.residual
    names: list[str] = []
    groups: list[NDArray[np.int_]] = []
    parts: list[Array] = []
    kept, always = np.zeros(x.size, dtype=bool), []
    g = solution.residual
    for number, (effect, own) in enumerate(zip(model.effects, model.slices, strict=True)):
        indices, stem = np.arange(own.start, own.stop), f"{effect.where}.{effect.kind}"
        if isinstance(effect, Spring):
            g = g + A[:, own] @ x[own]
            for i in indices:
                if model.names[i] in protect or effect.kind in protect or stem in protect:
                    kept[i] = True
                    always.append(model.names[i])
                else:
                    names.append(model.names[i])
                    groups.append(np.array([i]))
                    parts.append(np.zeros_like(g))
        elif effect.station != "spring" or {effect.kind, stem, *effect.names} & set(protect):
            kept[own] = True
            always += effect.names
        else:
            without = model.subset([i != number for i in range(len(model.effects))])
            part = reading - predicted(o, without)
            names.append(stem)
            groups.append(indices)
            parts.append(part)
            g = g + part
    part = np.array(parts).reshape(len(names), g.size)
    A, g, part = _without(A[:, kept], A, g, part)
    whole = np.column_stack([A[:, ~kept], part.T, g])
    R, free, place = np.asarray(np.linalg.qr(whole, mode="r")), int((~kept).sum()), np.cumsum(~kept) - 1
    return Candidates(
        names=tuple(names),
        groups=tuple(place[group] for group in groups),
        A=R[:, :free],
        g=R[:, -1],
        part=R[:, free:-1].T,
        classes=priority(model)[~kept],
        coarse=has_finite_differences(model),
        always=tuple(always),
    )


def _without(fixed: Array, A: Array, g: Array, part: Array) -> tuple[Array, Array, Array]:
    """Take the range of some columns off everything."""
    length = np.linalg.norm(fixed, axis=0)
    if not (length > 0).any():
        return A, g, part
    U, s, _ = np.linalg.svd(fixed[:, length > 0] / length[length > 0], full_matrices=False)
    U = U[:, s > 1e-9 * s[0]]
    rest = A - U @ (U.T @ A)
    rest[:, np.linalg.norm(rest, axis=0) < _REDUNDANT * np.linalg.norm(A, axis=0)] = 0.0
    return rest, g - U @ (U.T @ g), part - (part @ U) @ U.T


def base(system: Candidates) -> tuple[list[int], list[int]]:
    """A complete non-redundant set (the algebraic reduction of seed 4.2), and the redundant candidates.

    The columns of `base_parameters.select`: joints first, then diagonal entries, then the rest. A candidate of which no column is
    needed merges with those that are (group G3) or moves nothing (G2).
    """
    length = np.linalg.norm(system.A, axis=0)
    live = length > HIDDEN_BELOW  # what the noise hides is not fitted either
    unit = np.where(live, system.A / np.where(live, length, 1.0), 0.0)
    singular = np.linalg.svd(unit[:, live], compute_uv=False)
    rank, _ = numerical_rank(singular, system.coarse)
    taken = set(select(unit, system.classes, rank))
    chosen = [i for i, group in enumerate(system.groups) if taken & set(group.tolist())]
    return chosen, [i for i in range(len(system.groups)) if i not in chosen]


def ratios(system: Candidates, which: list[int]) -> Array:
    """|value| / sigma of every candidate in `which` (seed eq. 20), fitted together.

    For a candidate of several columns the root of the growth of chi-square without it.
    """
    A, g = system.take(which)
    if not which:
        return np.zeros(0)
    length = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    U, s, Vt = np.linalg.svd(A / length, full_matrices=False)
    inverse = np.where(s > 1e-12 * s.max(initial=0.0), 1.0 / np.maximum(s, 1e-300), 0.0)
    value = Vt.T @ (inverse * (U.T @ g))
    sigma = np.linalg.norm(Vt.T * inverse, axis=1)
    out, column = np.empty(len(which)), 0
    whole = float(g @ g - ((U[:, inverse > 0].T @ g) ** 2).sum())
    for row, i in enumerate(which):
        size = system.groups[i].size
        if size == 1 and not system.part[i].any():
            out[row] = abs(value[column]) / sigma[column] if sigma[column] > 0 else 0.0
        else:
            out[row] = np.sqrt(max(_chi2(*system.take([j for j in which if j != i])) - whole, 0.0))
        column += size
    return out


def _chi2(A: Array, g: Array) -> float:
    x = np.linalg.lstsq(A, g, rcond=None)[0]
    return float(((g - A @ x) ** 2).sum())


@dataclass(frozen=True)
class Fall:
    """A candidate that was dropped, and the ratio at which it fell (NaN where it was redundant)."""

    name: str
    ratio: float


def drop_at_once(system: Candidates, start: list[int], upper: float, inflation: float) -> tuple[list[int], list[Fall]]:
    """M3 as printed (seed 4.3): one fit of everything, then all below the threshold go together.

    Parameters
    ----------
    inflation : float
        Factor on every sigma (1 where the stated noise explains the residuals).
    """
    ratio = ratios(system, start) / inflation
    kept = [i for i, r in zip(start, ratio, strict=True) if r >= upper]
    falls = [Fall(system.names[i], float(r)) for i, r in zip(start, ratio, strict=True) if r < upper]
    return kept, falls


def drop_in_turn(
    system: Candidates,
    start: list[int],
    upper: float,
    inflation: float,
    progress: Callable[[str], None] = lambda text: None,
) -> tuple[list[int], list[Fall]]:
    """The worst goes, the rest is fitted again, until all that is left is above the threshold."""
    kept, falls = list(start), []
    while kept:
        ratio = ratios(system, kept) / inflation
        worst = int(ratio.argmin())
        if ratio[worst] >= upper:
            break
        falls.append(Fall(system.names[kept[worst]], float(ratio[worst])))
        progress(f"dropping {falls[-1].name} at ratio {falls[-1].ratio:.2g}, {len(kept) - 1} left")
        kept.pop(worst)
    return kept, falls
