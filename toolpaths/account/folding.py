"""One account of a long program out of the accounts of its pieces: sums and extremes are exact, per-point series are thinned."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolpaths.account.evenness import Evenness
from toolpaths.account.tally import Tally
from toolpaths.program import Program
from toolpaths.result import Compensation

Floats = NDArray[np.float64]
Ints = NDArray[np.int_]

# So many points of a long program are kept for pictures.
KEPT = 20_000
_TALLY = "tally"


def tallied(values: Floats) -> dict[str, Any]:
    """Stands for a summary while pieces are folded."""
    return {_TALLY: Tally.of(values)}


def give_bins(first: dict[str, Any], later: dict[str, Any]) -> None:
    """Let the tallies of the first piece hold the bins of a later one: they are what takes room."""
    for key, value in list(later.items()):
        if isinstance(value, Tally):
            later[key] = value.give_bins(first[key])
        elif isinstance(value, dict):
            give_bins(first[key], value)


def thinned(result: Compensation, most: int) -> Compensation:
    """A piece with every so-and-so-many-th point only, the ends and the largest values among them; without its bytes."""
    N = result.rows.size
    keep = np.arange(N)
    if max(most, 64) < N:
        size = np.linalg.norm(result.correction_mm, axis=1)
        peaks = [int(values.argmax()) for values in (size, result.before_mm, result.after_mm)]
        keep = np.unique([*range(0, N, -(-N // max(most, 64))), *peaks, N - 1])
    program = rows_of(result.program, result.rows[keep])
    rows = np.arange(keep.size)
    small = replace(result, program=program, parts=(b"",), rows=rows)
    if keep.size < N:
        same = ("program", "process", "rows", "parts")
        changes = {f.name: _taken(getattr(small, f.name), N, keep) for f in fields(small) if f.name not in same}
        small = replace(small, **changes)
    return replace(small, path=replace(small.path, rows=rows))


def rows_of(program: Program, rows: Ints) -> Program:
    """Some rows of a program, without its bytes."""
    taken = {f.name: _taken(getattr(program, f.name), len(program), rows) for f in fields(program) if f.name != "also"}
    return replace(program, **{**taken, "also": program.also[:0], "unit": program.unit, "raw": b"", "resume": None})


def _taken(value: Any, number: int, keep: Ints) -> Any:
    """A tree of dataclasses with the points `keep` of every array that has `number` of them along its first or last axis."""
    if isinstance(value, np.ndarray):
        axis = _axis(value, number)
        return value if axis is None else value.take(keep, axis=axis)
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **{f.name: _taken(getattr(value, f.name), number, keep) for f in fields(value) if f.init})
    return value


def _axis(value: NDArray[Any], number: int) -> int | None:
    if value.ndim and value.shape[0] == number:
        return 0
    return value.ndim - 1 if value.ndim and value.shape[-1] == number else None


def _joined(values: Sequence[Any], numbers: Sequence[int]) -> Any:
    """The pieces' trees one after the other; `numbers` says how many points each has."""
    first = values[0]
    if isinstance(first, np.ndarray):
        axes = (0, first.ndim - 1) if first.ndim else ()
        along = (a for a in axes if all(v.shape[a] == number for v, number in zip(values, numbers, strict=True)))
        axis = next(along, None)
        return first if axis is None else np.concatenate(values, axis=axis)
    if is_dataclass(first) and not isinstance(first, type):
        own = [f.name for f in fields(first) if f.init]
        return replace(first, **{name: _joined([getattr(value, name) for value in values], numbers) for name in own})
    return first


@dataclass(frozen=True, eq=False, kw_only=True)
class LongCompensation(Compensation):
    """The account of a program that was corrected in pieces: series are thinned, `facts` hold for all of it.

    Attributes
    ----------
    facts : what `to_dict` says
    written : path of the corrected program, not yet under its name; None where none was wanted
    sha256 : of the program as it was and of the corrected one
    """

    facts: dict[str, Any]
    written: Path | None
    sha256: tuple[str, str]

    def to_dict(self, summary: Callable[[Floats], dict[str, Any]] | None = None) -> dict[str, Any]:
        """For `--json`."""
        return {**self.facts, "notes": self.notes}

    @property
    def lines(self) -> int:
        """Lines of the program."""
        return int(self.facts["lines"])

    @property
    def digests(self) -> tuple[str, str]:
        """See `Compensation`."""
        return self.sha256

    def files(self, output: Path) -> list[tuple[Path, Any]]:
        """The corrected program as a file that waits to be renamed."""
        return [] if self.written is None else [(output, self.written)]


def folded(
    results: Sequence[Compensation],
    facts: Sequence[dict[str, Any]],
    borders: Sequence[tuple[Evenness, Ints]],
    written: Path | None,
    sha256: tuple[str, str],
) -> LongCompensation:
    """One account of all pieces.

    Parameters
    ----------
    results
        Thinned, in the order of the program.
    facts
        What each piece says of itself, summaries as `tallied`.
    borders
        Where a piece goes on without a break: see `evenness.across`.
    """
    programs = [result.program for result in results]
    program = _joined(programs, [len(piece) for piece in programs])
    alike = [replace(result, program=programs[0]) for result in results]
    joined: Compensation = _joined(alike, [result.rows.size for result in results])
    said = fold_facts(facts, [step.to_dict(line) for step, line in borders])
    best = results[0].account.causes.best
    for result in results[1:]:
        best = best + result.account.causes.best
    said["joints_only_mm"]["best_possible_rms"] = best.left_mm
    known = {f.name: getattr(joined, f.name) for f in fields(Compensation)}
    known |= {
        "program": program,
        "rows": np.arange(len(program)),
        "path": replace(joined.path, rows=np.arange(len(program))),
        "contraction": said["largest_contraction"],
        "steps": said["iterations"],
        "quantum_mm": said["half_printed_digit_mm"],
        "refusals": tuple(r for result in results for r in result.refusals),
        "insertions": tuple(i for result in results for i in result.insertions),
        "notes": fold_notes([*(r.notes for r in results), *(step.notes(line) for step, line in borders)]),
    }
    return LongCompensation(**known, facts=said, written=written, sha256=sha256)


_SUMS = ("corrected_points", "lines")
_LARGEST = ("unsupported_share", "iterations", "largest_contraction", "half_printed_digit_mm")
_LISTS = ("refused", "inserted", "turning_points", "linearised")


def fold_facts(facts: Sequence[dict[str, Any]], borders: Sequence[dict[str, Any]] = ()) -> dict[str, Any]:
    """What pieces say of themselves, and of the steps between them (kinks alone), as said of all of them."""
    counts = np.array([fact["corrected_points"] for fact in facts], dtype=float)
    before: list[Tally] = [fact["uncompensated_mm"][_TALLY] for fact in facts]
    out = _tree(facts)
    out |= {key: sum(fact[key] for fact in facts) for key in _SUMS}
    out |= {key: max(fact[key] for fact in facts) for key in _LARGEST}
    out |= {key: [entry for fact in facts for entry in fact.get(key, [])] for key in _LISTS}
    moved, left = out["uncompensated_mm"]["mean"], out["residual_mm"]["mean"]
    out["percent_compensated"] = 100 * (1 - left / moved) if moved > out["half_printed_digit_mm"] else float("nan")
    out["causes"] = _fold_causes([fact["causes"] for fact in facts], counts, np.array([b.total for b in before]))
    out["evenness"] = _with_borders(_fold_evenness([fact["evenness"] for fact in facts], counts), borders)
    nearest = [fact["reserve"] for fact in facts]
    out["reserve"] = {
        **min(nearest, key=lambda reserve: reserve["limit_margin"]),
        "singularity_margin": min(reserve["singularity_margin"] for reserve in nearest),
    }
    return out


def _tree(values: Sequence[Any]) -> Any:
    """The first of several trees, with what is tallied in all of them summed up and said."""
    first = values[0]
    if not isinstance(first, dict):
        return first
    out = {key: _tree([value[key] for value in values]) for key in first if key != _TALLY}
    if _TALLY in first:
        total: Tally = first[_TALLY]
        for value in values[1:]:
            total = total + value[_TALLY]
        out = {**total.summary(), **out}
    return out


def _fold_causes(causes: Sequence[list[dict[str, Any]]], counts: Floats, deflected: Floats) -> list[dict[str, Any]]:
    """Shares are of the summed deflection, lengths means over points."""
    share, mean, first = dict[Any, float](), dict[Any, float](), dict[Any, dict[str, Any]]()
    whole = deflected.sum()
    for piece, count, size in zip(
        causes, counts / counts.sum(), deflected / whole if whole else deflected, strict=True
    ):
        for cause in piece:
            name = cause["kind"], cause["where"]
            first.setdefault(name, cause)
            share[name] = share.get(name, 0.0) + size * float(np.nan_to_num(cause["share"]))
            mean[name] = mean.get(name, 0.0) + count * cause["mean_mm"]
    found = [{**cause, "share": share[name], "mean_mm": mean[name]} for name, cause in first.items()]
    last = causes[0][-1]["kind"]
    return sorted(found, key=lambda cause: (cause["kind"] == last, -abs(cause["share"])))


def _fold_evenness(parts: Sequence[dict[str, Any]], counts: Floats) -> dict[str, Any]:
    def of(key: str) -> Floats:
        """What is known of it: a piece of one point, or without a blend radius, knows nothing of some keys."""
        values = np.array([part[key] for part in parts], dtype=float)
        return values if np.isnan(values).all() else values[np.isfinite(values)]

    def mean(key: str) -> float:
        values = np.array([part[key] for part in parts], dtype=float)
        known = np.isfinite(values)
        return float(np.average(values[known], weights=counts[known])) if known.any() else float("nan")

    return {
        **parts[0],
        "largest_mm_per_mm": max(part["largest_mm_per_mm"] for part in parts),
        "median_spacing_mm": mean("median_spacing_mm"),
        "kink_lines": [line for part in parts for line in part["kink_lines"]],
        "largest_change_within_a_blend_mm": float(of("largest_change_within_a_blend_mm").max()),
        "smallest_blend_radius_mm": float(of("smallest_blend_radius_mm").min()),
        "largest_blend_radius_mm": float(of("largest_blend_radius_mm").max()),
        **{key: mean(key) for key in parts[0] if key.startswith("share_of_")},
    }


def _with_borders(evenness: dict[str, Any], borders: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What pieces say of kinks, and the steps between them."""
    said = [evenness, *borders]
    return {
        **evenness,
        "largest_mm_per_mm": max(part["largest_mm_per_mm"] for part in said),
        "kink_lines": sorted({line for part in said for line in part["kink_lines"]}),
    }


def fold_notes(notes: Sequence[Sequence[str]]) -> list[str]:
    """Notes of all pieces; of those that differ in numbers alone the one that says the most, and how many say the like."""
    found: dict[str, tuple[str, int]] = {}
    said: dict[str, set[str]] = {}
    for piece in notes:
        for note in piece:
            shape = re.sub(r"\d[\d.e+-]*", "#", note)
            most, times = found.get(shape, (note, 0))
            found[shape] = note if _up_to(note) > _up_to(most) else most, times + 1
            said.setdefault(shape, set()).add(note)
    return [
        most if len(said[shape]) == 1 else f"{most} (and the like in {times - 1} more pieces of the program)"
        for shape, (most, times) in found.items()
    ]


def _up_to(note: str) -> float:
    match = re.search(r"up to (\d+(?:\.\d+)?)", note)
    return float(match[1]) if match else 0.0
