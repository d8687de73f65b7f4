"""The complete model from its identifiable part: what was removed or is not identified, as intervals from beam mechanics.

The source paper's open problem (4.3, 6). A campaign determines combinations L x = b of compliances within their noise; what it
leaves open is limited by the cones of passive springs and by the rules of `beam_mechanics` for sections within stated limits. All
of these are conic conditions, so the smallest and the largest value of every open entry are conic programs, and so is the
centre, which becomes its value. An interval holds for all entries together with the stated probability: the region of the
identified combinations is that of chi-square with as many degrees of freedom as there are combinations. Where the estimate itself was
held by a cone the region holds all the more, because a projection onto a convex set that contains the truth comes no farther from it.

A restored entry stays "restored, not identified": its group and standard deviation do not change.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.effects.compliance import LinkCompliance
from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.identifiability import analyse
from drake_stiffness.identification import Solution
from drake_stiffness.model import Model, Statistics
from drake_stiffness.observation import Observations, columns, measured, predicted
from drake_stiffness.restoration.beam_mechanics import LinkBeam, link_beams
from drake_stiffness.restoration.completion import complete
from drake_stiffness.restoration.evidence import Evidence, evidence_of_readings, evidence_of_statistics
from drake_stiffness.restoration.program import Extreme, RestorationProgram
from drake_stiffness.restoration.rules import program_rules, usual_sizes
from drake_stiffness.restoration.sections import Sections
from drake_stiffness.rotations import Array
from drake_stiffness.semidefinite import smallest_eigenvalue, spring_parameters
from drake_stiffness.sensitivity import has_finite_differences
from drake_stiffness.statistics import goodness, held_out_errors, rms_mm, statistics
from drake_stiffness.task import Task

IDENTIFIED = ("G1+", "G1~")
LABEL = "restored, not identified"
CONFIDENCE = 0.95
# What is smaller than this, in units of scale, is rounding.
_ROUNDING = 1e-12
# A departure below this, in sigma of all combinations together, is the solver's.
_NONE = 1e-4
# A larger one is worth a word.
_DOUBTFUL = 3.0
# Room for a centre where the rules only just touch what was identified, in the same unit.
_ROOM = 0.1
# Rounds of linearisation where the campaign is at hand, and the step at which they stop, sigma of all readings together.
_ROUNDS, _STANDS = 6, 0.05


@dataclass(frozen=True, eq=False)
class Restoration:
    """A complete model.

    Attributes
    ----------
    model : Model
        Every link matrix positive definite; `model.restored` lists the restored entries.
    number : (m,)
        Which parameters were restored.
    low, high : (m,)
        Their intervals, SI; infinite where nothing bounds an entry.
    rules : tuple of m pairs of texts
        What holds the lower and the upper end, the strongest rule first.
    departure : float
        By how much the identified combinations had to move, in sigma of all of them together; 0 where they did not.
    radius : float
        Of the region of the identified combinations, in the same unit.
    smallest : dict of link to float
        Smallest eigenvalue of its matrix over the largest, each component in units of its scale; positive.
    notes : tuple of str
        What to look at: links that no rule was used for, limits that hardly agree with what was identified.
    """

    model: Model
    number: NDArray[np.int_]
    low: Array
    high: Array
    rules: tuple[tuple[str, str], ...]
    departure: float
    radius: float
    smallest: dict[str, float]
    notes: tuple[str, ...]

    label = LABEL

    def to_dict(self) -> dict[str, Any]:
        """The result for programs."""
        return {
            "restored": list(self.model.restored),
            "departure_sigma": self.departure,
            "region_sigma": self.radius,
            "smallest_eigenvalue_ratio": self.smallest,
            "notes": list(self.notes),
        }


def restore(
    model: Model, sections: Sections, o: Observations | None = None, *, confidence: float = CONFIDENCE
) -> Restoration:
    """Restore what a model lacks or does not identify.

    Parameters
    ----------
    model : Model
        Identified, with statistics; perhaps reduced (joints without springs, links with masks).
    sections : Sections
        Limits of link sections.
    o : Observations, optional
        What it was identified from. Needed for reduced models only: what a reduction took away was absorbed by what it kept, and
        the readings alone tell them apart. With them the identified part is that of the complete model.
    confidence : float
        Of all intervals together.

    Raises
    ------
    InputError
        If the model has no statistics or no link spring, is reduced and the readings are missing, or sections do not fit the arm.
    UntrustworthyError
        If limits of sections contradict what was identified; the message names link and rule.
    """
    whole, new = complete(model)
    _check(model, whole, new, o)
    springs = np.flatnonzero(spring_parameters(whole))
    beams, notes = link_beams(whole, sections)
    if o is None:
        program = _program(whole, evidence_of_statistics(whole), beams, springs, confidence)
        departure = _to_centre(program, beams)
        x = _with_springs(whole, springs, program.y_of())
        final = replace(whole, x=x, statistics=_shifted(whole, x))
    else:
        departure = np.inf
        for _ in range(_ROUNDS):
            evidence = evidence_of_readings(whole, o)
            off = evidence.rows @ (whole.x[springs] / whole.scales[springs] - evidence.centre)
            if np.linalg.norm(off) < departure + _STANDS and np.isfinite(departure):
                break
            program = _program(whole, evidence, beams, springs, confidence)
            departure = _to_centre(program, beams)
            whole = replace(whole, x=_with_springs(whole, springs, program.y_of()))
        final = replace(whole, statistics=_statistics(whole, o))
    assert final.statistics is not None
    number = np.array([i for i in springs if final.statistics.group[i] not in IDENTIFIED], dtype=int)
    place = {int(i): k for k, i in enumerate(springs)}
    typical = np.abs(final.x) / final.scales
    ends = [[program.extreme(place[int(i)], sign, float(typical[i])) for sign in (1.0, -1.0)] for i in number]
    low, high = (np.array([pair[k].value for pair in ends]).reshape(-1) * final.scales[number] for k in (0, 1))
    rules = tuple((_words(a), _words(b)) for a, b in ends)
    if departure > _DOUBTFUL:
        notes.append(
            f"limits of sections pull the identified combinations by {departure:.1f} sigma of all together ({program.radius:.1f} would be "
            "refused): one of them is likely false, or a link is no straight beam."
        )
    fit = final.fit | {
        "min_eigenvalue": smallest_eigenvalue(final),
        "restoration": {"departure_sigma": departure, "region_sigma": program.radius, "confidence": confidence},
    }
    final = replace(final, fit=fit, restored=_entries(final, number, low, high, rules))
    return Restoration(final, number, low, high, rules, departure, program.radius, _smallest(final), tuple(notes))


def held_out(model: Model, restored: Model, task: Task) -> tuple[float, float]:
    """Root mean square error on held-out postures before and after, mm."""
    m = task.held_out()
    before, after = (rms_mm(held_out_errors(one, m, task.displacement)) for one in (model, restored))
    return before, after


def _check(model: Model, whole: Model, new: NDArray[np.bool_], o: Observations | None) -> None:
    if model.statistics is None:
        raise InputError(
            "the model has no statistics, so nothing tells what it identified; take one that `identify` wrote."
        )
    if not any(isinstance(effect, LinkCompliance) for effect in whole.effects):
        raise InputError(
            "the model has no link springs, and its cell names none: there is nothing that beam mechanics could restore."
        )
    if any(getattr(effect, "template_name", "") == "full" for effect in whole.effects):
        raise InputError(
            "the model has links with the template 'full', whose matrices need not be symmetric; identify with template symmetric or beam."
        )
    if new.any() and o is None:
        raise InputError(
            f"the model is reduced: {int(new.sum())} compliances were taken away, and what they did was absorbed by those that were "
            "kept. Give the campaign it was identified from (--campaign CAMPAIGN.yaml); its readings tell them apart."
        )


def _program(
    model: Model, evidence: Evidence, beams: list[LinkBeam], springs: NDArray[np.int_], confidence: float
) -> RestorationProgram:
    from scipy.special import chdtri  # inverse survival function of chi-square

    usual = usual_sizes(model, springs, evidence.centre)
    count = evidence.rows.shape[0]
    radius = float(np.sqrt(chdtri(count, 1.0 - confidence))) if count else 0.0
    return RestorationProgram(evidence, program_rules(model, beams, springs, usual), usual, radius)


def _to_centre(program: RestorationProgram, beams: list[LinkBeam]) -> float:
    """Solve for the centre; how far the identified combinations moved."""
    nearest = program.nearest()
    if not nearest <= program.radius:
        raise UntrustworthyError(_blame(program, beams, nearest))
    if nearest < _NONE and program.centre(0.0):
        return 0.0
    if not program.centre(nearest + _ROOM):
        raise UntrustworthyError(
            "limits of sections and what was identified leave no room for positive definite springs; widen the limits."
        )
    return program.departure()


def _blame(program: RestorationProgram, beams: list[LinkBeam], nearest: float) -> str:
    """Which rules, left out alone or with all others of their link, would end the contradiction."""
    far = (
        f"they would have to move by {nearest:.1f} sigma (all combinations together; {program.radius:.1f} is the limit)"
        if np.isfinite(nearest)
        else "the limits contradict each other"
    )
    head = f"limits of sections contradict what was identified: {far}. "
    single = [rule.name for i, rule in enumerate(program.rules) if rule.link and _helps(program, [i])]
    if single:
        return (
            head + f"Without {' or without '.join(single[:3])} they agree. Mend the limits of that link, or its length."
        )
    links = [
        beam.link
        for beam in beams
        if _helps(program, [i for i, rule in enumerate(program.rules) if rule.link == beam.link])
    ]
    if links:
        return (
            head + f"Without the limits of {' or without those of '.join(links)} they agree: that link is no such beam."
        )
    return (
        head + "No single link is the cause: check units (metres) and `default`, or whether the campaign fits at all."
    )


def _helps(program: RestorationProgram, left_out: list[int]) -> bool:
    without = np.zeros(len(program.rules), dtype=bool)
    without[left_out] = True
    return program.nearest(without) <= program.radius


def _with_springs(model: Model, springs: NDArray[np.int_], y: Array) -> Array:
    """All parameters: springs as given, frames and geometry moved so that combinations with them stay."""
    x = model.x.copy()
    change = y - x[springs] / model.scales[springs]
    x[springs] = y * model.scales[springs]
    s = model.statistics
    others = np.setdiff1d(np.arange(x.size), springs)
    if s is not None and others.size:
        seen = np.linalg.svd(s.null_space, full_matrices=True)[0][:, s.null_space.shape[1] :].T
        x[others] -= np.linalg.lstsq(seen[:, others], seen[:, springs] @ change, rcond=1e-9)[0] * model.scales[others]
    return x


def _shifted(model: Model, x: Array) -> Statistics:
    """The statistics with least squares where it was, though the model moved."""
    s = model.statistics
    assert s is not None
    if s.shift is None:
        return s
    change = (model.x - x) / model.scales
    fitted = change - s.null_space @ (s.null_space.T @ change)
    return replace(s, shift=s.shift + np.where(np.abs(fitted) > _ROUNDING, fitted, 0.0) * model.scales)


def _statistics(model: Model, o: Observations) -> Statistics:
    """Groups and covariance of the complete model on the readings."""
    A = columns(o, model)
    view = analyse(A, coarse=has_finite_differences(model))
    solution = Solution(model, view, A, measured(o) - predicted(o, model), 1, "", (), 0.0)
    return statistics(solution, o, goodness(solution, o))[0]


def _smallest(model: Model) -> dict[str, float]:
    found = {}
    for effect, values in zip(model.effects, model.values, strict=True):
        if isinstance(effect, LinkCompliance):
            scale = effect.component_scales
            eigen = np.linalg.eigvalsh(effect.matrix(values) / np.outer(scale, scale))
            found[effect.link_name()] = float(eigen[0] / eigen[-1])
    return found


def _words(end: Extreme) -> str:
    return " and ".join(end.rules) if end.rules else "what was identified"


def _entries(
    model: Model, number: NDArray[np.int_], low: Array, high: Array, rules: tuple[tuple[str, str], ...]
) -> tuple[dict[str, Any], ...]:
    """What `model.json` says of restored entries."""
    return tuple(
        {
            "name": model.names[i],
            "low": float(a),
            "high": float(b),
            "value": float(model.x[i]),
            "unit": model.parameters[i].unit,
            "label": LABEL,
            "from": f"low: {rule[0]}; high: {rule[1]}",
        }
        for i, a, b, rule in zip(number, low, high, rules, strict=True)
    )
