"""Verdicts on identified values: the ratio (20) alone passes what sign, collinearity and held-out readings refute.

On real data a model that lacks an effect fits anyway: some compliance takes the effect's place, with a small standard deviation,
a ratio of ten, and an absurd value. Three witnesses that the ratio does not hear are asked here:

- the sign: a base parameter made of compliances only is not negative, whether least squares says so or the cone had to hold it;
- collinearity: whether the rest of the model can nearly imitate its column, so that what is missing flows into it;
- held-out readings: whether they are explained better when the effect is left out and the rest fitted again (linearised).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.base_parameters import relation
from drake_stiffness.effects.compliance import Spring
from drake_stiffness.groups import Groups
from drake_stiffness.identifiability import analyse
from drake_stiffness.identification import Solution
from drake_stiffness.observation import Observations, columns, measured, predicted
from drake_stiffness.rotations import Array
from drake_stiffness.sensitivity import has_finite_differences
from drake_stiffness.statistics import GoodnessOfFit, posture_of_rows

# A sign is sure beyond this many standard deviations; so is a difference of held-out errors beyond this many standard errors.
SURE = 3.0
# Share of a column that other columns imitate, and correlation of two estimates, from which on collinearity is a reason.
IMITATED, CORRELATED = 0.95, 0.8
# Held-out chi-square per row over that of the fit (and what the parameters' own noise explains) that is a reason.
WORSE = 1.5
# A held-out error must be lower by this factor before an effect is blamed for it.
LOWER_BY = 1.02
# Held-out postures that such a comparison needs at least.
_POSTURES = 5


@dataclass(frozen=True)
class Verdict:
    """Why an identified value must not be trusted.

    Attributes
    ----------
    what : str
        A parameter, a combination, an effect, or `the model`.
    number : str
        Its value with sigma, unit and ratio; may be empty.
    reasons : tuple of str
    """

    what: str
    number: str
    reasons: tuple[str, ...]

    def line(self) -> str:
        """As `identify` says it."""
        return f"NOT TRUSTWORTHY: {self.what}{self.number and ' = ' + self.number}: {'; '.join(self.reasons)}."


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Held-out readings against the model: whitened residuals and columns, references taken off.

    Attributes
    ----------
    residual : (rows,)
    A : (rows, n)
        Per unit of scale.
    posture : (rows,) int
    freedom : int
        Rows less the references that were eliminated.
    """

    residual: Array
    A: Array
    posture: NDArray[np.int_]
    freedom: int

    def by_posture(self, change: Array) -> Array:
        """Sum of squares of each posture once the parameters are changed, in units of scale."""
        return np.asarray(np.bincount(self.posture, weights=(self.residual - self.A @ change) ** 2), dtype=float)


def held_out(solution: Solution, o: Observations) -> HeldOut:
    """The linearisation of held-out readings."""
    residual = measured(o) - predicted(o, solution.model)
    return HeldOut(residual, columns(o, solution.model), posture_of_rows(o), max(o.rows - o.references, 1))


def verdicts(solution: Solution, groups: Groups, fit: GoodnessOfFit, held: HeldOut | None) -> list[Verdict]:
    """Everything that must not be trusted, with all reasons found.

    Parameters
    ----------
    held : HeldOut or None
        Without held-out readings the third witness is silent.
    """
    compared = {} if held is None else compare(solution, held)
    found: list[Verdict] = []
    named = set()
    for k in _negative(solution, groups):
        label = _effect_of(solution, int(groups.found.base[k]))
        named.add(label)
        witnesses = (_sign(solution, groups, k), _imitation(solution, groups, k))
        heard = (compared[label].words(),) if label in compared else ()
        found.append(Verdict(_name(groups, k), _number(groups, k), (*witnesses, *heard, *_missing(fit))))
    for i in _carried_away(solution):
        reason = (
            "the noise hides it, and its value is no estimate: the constraint on other springs moved it there, by more than "
            "the readings bear"
        )
        value = f"{solution.model.x[i]:.3g} {solution.model.parameters[i].unit}"
        found.append(Verdict(solution.model.names[i], value, (reason, *_missing(fit))))
    found += [
        Verdict(label, "", (outcome.words(), *_missing(fit)))
        for label, outcome in compared.items()
        if outcome.better_without and label not in named
    ]
    worse = () if held is None else _worse(solution, fit, held)
    return [*found, *([Verdict("the model", "", worse)] if worse else [])]


def _negative(solution: Solution, groups: Groups) -> list[int]:
    """Base parameters that are sums of compliances only, and negative beyond doubt in least squares."""
    lower = np.array([p.lower for p in solution.model.parameters])
    found, v = [], groups.values
    for k, row in enumerate(groups.found.matrix):
        members = np.flatnonzero(row)
        passive = (lower[members] == 0.0).all() and (row[members] > 0).all()
        if passive and not v.hidden[k] and v.least_squares[k] < -SURE * v.sigma[k]:
            found.append(k)
    return found


def _name(groups: Groups, k: int) -> str:
    return relation(groups.names, groups.matrix[k], int(groups.found.base[k]), most=4)


def _number(groups: Groups, k: int) -> str:
    v = groups.values
    unit = groups.units[int(groups.found.base[k])]
    return f"{v.least_squares[k]:.3g} +- {v.sigma[k]:.2g} {unit} (ratio {groups.ratio[k]:.2g})"


def _sign(solution: Solution, groups: Groups, k: int) -> str:
    held = groups.values.model[k]
    if held > -1e-3 * groups.values.sigma[k]:
        return (
            f"sign: least squares makes it negative beyond doubt, and only the constraint holds it at {max(held, 0.0):.2g} (which moves the "
            f"fit by {solution.departure:.3g} sigma of all readings together)"
        )
    return "sign: negative beyond doubt, and no spring gives way against its load"


def _imitation(solution: Solution, groups: Groups, k: int) -> str:
    """How much of a base parameter's column the others imitate: sqrt(1 - 1 / (M_kk C_kk)), the multiple correlation."""
    view, L = solution.identifiability, groups.found.matrix
    plain = float(L[k] @ (view.covariance() + view.hidden_covariance()) @ L[k])
    column = float(np.linalg.norm(solution.A[:, groups.found.base[k]])) ** 2
    share = float(np.sqrt(max(1.0 - 1.0 / max(column * plain, 1.0), 0.0)))
    sigma = np.sqrt(np.maximum(np.diag(groups.values.covariance), 1e-300))
    correlation = groups.values.covariance[k] / (sigma * sigma[k])
    correlation[k] = 0.0
    mates = [j for j in np.argsort(-np.abs(correlation)).tolist() if abs(correlation[j]) > CORRELATED][:2]
    if share < IMITATED and not mates:
        return f"collinearity: no objection (other parameters imitate {100 * share:.0f} % of its column)"
    said = f"collinearity: other parameters imitate {100 * share:.1f} % of its column"
    if mates:
        said += ", and its estimate correlates " + " and ".join(
            f"{correlation[j]:.2f} with {groups.base_names[j]}" for j in mates
        )
    return said


def _missing(fit: GoodnessOfFit) -> tuple[str, ...]:
    if not fit.rejected:
        return ()
    return (
        f"chi-square per degree of freedom is {fit.chi2_per_dof:.3g}: something is missing in the model, and what it does goes into what is "
        "fitted",
    )


def _carried_away(solution: Solution) -> list[int]:
    """Parameters that stand along directions the noise hides by more than the readings bear (they are not fitted)."""
    view, model = solution.identifiability, solution.model
    along = view.hidden.T @ (model.x / model.scales)
    far = np.flatnonzero(np.abs(along) * view.hidden_weight > SURE)
    return sorted({int(np.abs(view.hidden[:, k]).argmax()) for k in far})


def _effect_of(solution: Solution, parameter: int) -> str:
    """The name under which an effect is left out: a spring's place, or the kind of geometric errors."""
    for effect, own in zip(solution.model.effects, solution.model.slices, strict=True):
        if own.start <= parameter < own.stop:
            return _label(effect)
    raise IndexError(parameter)


def _label(effect: object) -> str:
    if isinstance(effect, Spring):
        return effect.names[0].split(".")[0]
    return str(getattr(effect, "kind", ""))


def _left_out(solution: Solution) -> dict[str, NDArray[np.bool_]]:
    """What is left out in turn: every spring, and every kind of geometric errors as a whole; parameters of each."""
    model = solution.model
    parts: dict[str, NDArray[np.bool_]] = {}
    for effect, own in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, Spring) or effect.station == "arm":
            parts.setdefault(_label(effect), np.zeros(model.x.size, dtype=bool))[own] = True
    return parts


@dataclass(frozen=True)
class Comparison:
    """Held-out chi-square per degree of freedom with an effect, and without it, the rest fitted again."""

    with_it: float
    without: float
    better_without: bool

    def words(self) -> str:
        """As a reason, or as a witness that has nothing to say against it."""
        numbers = (
            f"{self.with_it:.3g} per degree of freedom with it, {self.without:.3g} without it and the rest fitted again"
        )
        if self.better_without:
            return f"held out: chi-square of held-out readings is {numbers}"
        return f"held out: no objection (chi-square {numbers})"


def compare(solution: Solution, held: HeldOut) -> dict[str, Comparison]:
    """Every spring and every kind of geometric error left out in turn; empty where a constraint moved the fit.

    An effect is worse than none if held-out postures say so beyond doubt: the mean fall of their sums of squares is more than
    `SURE` standard errors, and worth `LOWER_BY`.
    """
    with_all = held.by_posture(np.zeros(held.A.shape[1]))
    if with_all.size < _POSTURES or solution.departure > 1e-2:
        return {}
    coarse = has_finite_differences(solution.model)
    found = {}
    for name, part in _left_out(solution).items():
        without = held.by_posture(refitted_without(solution, part, coarse))
        gain = with_all - without
        error = float(gain.std(ddof=1)) / np.sqrt(gain.size)
        better = bool(gain.mean() > SURE * error and with_all.sum() > LOWER_BY * without.sum())
        found[name] = Comparison(
            float(with_all.sum()) / held.freedom, float(without.sum()) / held.freedom, better and error > 0
        )
    return found


def refitted_without(solution: Solution, part: NDArray[np.bool_], coarse: bool) -> Array:
    """Change of all parameters (n,), in units of scale, when some become zero and the rest is fitted again (linearised)."""
    x = solution.model.x / solution.model.scales
    change = np.where(part, -x, 0.0)
    rest = solution.A[:, ~part]
    if rest.shape[1]:
        view = analyse(rest, coarse=coarse)
        residual = solution.residual - solution.A @ change
        change[~part] = view.seen @ view.pseudo_inverse_seen(rest, residual)
    return change


def _worse(solution: Solution, fit: GoodnessOfFit, held: HeldOut) -> tuple[str, ...]:
    """Held-out chi-square against that of the fit, with the parameters' own noise taken into account."""
    squares = held.by_posture(np.zeros(held.A.shape[1]))
    if squares.size < _POSTURES or not np.isfinite(fit.chi2_per_dof):
        return ()
    half = held.A @ (solution.identifiability.seen / solution.identifiability.weight)
    rows = np.bincount(held.posture)
    spread = np.bincount(held.posture, weights=(half**2).sum(axis=1))
    expected = fit.chi2_per_dof * (rows * held.freedom / held.residual.size + spread)
    excess = squares - expected
    error = float(excess.std(ddof=1)) / np.sqrt(excess.size)
    if excess.mean() <= SURE * error or squares.sum() <= WORSE * expected.sum():
        return ()
    return (
        f"held out: chi-square of held-out readings is {squares.sum() / held.freedom:.3g} per degree of freedom, {squares.sum() / expected.sum():.2g} "
        f"times what fitted readings ({fit.chi2_per_dof:.3g}) and the noise of the parameters let expect; the fit does not carry over to other "
        "postures",
    )
