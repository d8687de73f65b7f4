"""What `diagnose --fixed` says to people: what changed, from what to what, in units that people read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drake_stiffness.diagnosis.locate import short
from drake_stiffness.diagnosis.words import p_words
from drake_stiffness.intervals.interval import read_as

if TYPE_CHECKING:
    from rich.console import Console

    from drake_stiffness.diagnosis.recheck_job import Rechecked

MEANING = {
    "consistent": "the model is still true: these readings are within its uncertainty and the noise",
    "explained": "the model is no longer true; the changes below close the gap",
    "partly_explained": "the model is no longer true; the changes below close a part of the gap",
    "unexplained": "the model is no longer true, and no known change says why",
}
# So many values of an effect on the terminal, and in a sentence.
_LINES, _IN_A_SENTENCE = 4, 2
# A value that stands out of its uncertainty by this much has a change in percent.
_SURE = 3.0


@dataclass(frozen=True)
class ThenAndNow:
    """One value of an effect that changed or appeared, in the unit in which people read it.

    Attributes
    ----------
    name, unit : str
    then, sigma_then : float or None
        As stored; None where the stored model has it not, or where it is not determined by itself.
    now, sigma : float, float or None
    """

    name: str
    unit: str
    then: float | None
    sigma_then: float | None
    now: float
    sigma: float | None

    @property
    def change(self) -> float:
        return self.now - (self.then or 0.0)

    @property
    def share(self) -> float | None:
        """The change as a share of what was stored; None where that is not known well enough, or where either is negative."""
        if not self.then or not self.sigma_then or self.then < _SURE * self.sigma_then or self.now < 0:
            return None
        return self.now / self.then - 1.0

    @property
    def sure(self) -> float:
        """The change in units of its own uncertainty; 0 where that is not known."""
        square = (self.sigma or 0.0) ** 2 + (self.sigma_then or 0.0) ** 2
        return abs(self.change) / float(square**0.5) if self.sigma and square else 0.0


def then_and_now(entry: dict[str, Any]) -> list[ThenAndNow]:
    """Values of an entry of `effects`, in their own order."""
    out = []
    for name, p in entry["parameters"].items():
        factor, unit = read_as(p["unit"])
        then, sigma_then, sigma = (
            None if p.get(k) is None else p[k] * factor for k in ("value_then", "sigma_then", "sigma")
        )
        out.append(ThenAndNow(name, unit, then, sigma_then, p["value"] * factor, sigma))
    return out


def strongest(values: list[ThenAndNow], number: int) -> list[ThenAndNow]:
    """All of a few; of many those whose change is surest, surest first."""
    return values if len(values) <= number else sorted(values, key=lambda v: -v.sure)[:number]


def change_words(entry: dict[str, Any]) -> str:
    """A change in a sentence: kind, place, values then and now."""
    values = then_and_now(entry)
    shown = strongest(values, _IN_A_SENTENCE)
    words = [f"{v.name} {_from(v)}{_with_sigma(v.now, v.sigma)} {v.unit}{_share(v)}" for v in shown]
    more = f", and {len(values) - len(shown)} more" if len(values) > len(shown) else ""
    return f"{entry['kind'].replace('_', ' ')} at {entry['where']} {entry['change']} ({'; '.join(words)}{more})"


def show_recheck(console: Console, result: Rechecked) -> None:
    """For people; everything is in `--json` and `--report`."""
    found, document = result.recheck, result.document
    console.print(f"Verdict: {found.verdict} - {MEANING[found.verdict]}.")
    for entry in document["effects"]:
        others = ", ".join(f"{c['kind']} at {c['where']}" for c in entry["confounded_with"])
        beside = f"; cannot be told from {others}" if others else ""
        console.print(
            f"{entry['kind']} at {entry['where']} {entry['change']} ({entry['evidence']['sigma']:.1f} sigma{beside}):"
        )
        values = then_and_now(entry)
        shown = strongest(values, _LINES)
        for v in shown:
            console.print(f"  {v.name}: {_then(v)}now {_with_sigma(v.now, v.sigma)} {v.unit}{_share(v)}")
        if len(values) > len(shown):
            console.print(f"  and {len(values) - len(shown)} more, all in --json and --report")
    gap, before = document["gap"], found.before
    console.print(
        f"{found.postures} postures: {before.rms_mm:.4f} mm rms by the stored model (noise {gap['noise_shown_rms_mm']:.4f}), chi-square per "
        f"degree of freedom {before.chi2_per_dof:.3g}, {p_words(before.p_value)}; held out: {document['recheck']['held_out']}."
    )
    if found.changes:
        console.print(f"With the values of now: {gap['after_rms_mm']:.4f} mm rms{_held(document)}.")
    if found.verdict in ("partly_explained", "unexplained"):
        console.print(f"What remains: {document['where_in_words']['after']}.")
    if found.noise_ratio > 1:
        console.print(
            f"! The stored model's own campaign showed {found.noise_ratio:.2g} times its stated noise; readings are held against that."
        )


def _held(document: dict[str, Any]) -> str:
    gap = document["gap"]
    if gap["held_out_after_rms_mm"] is None:
        return ""
    return f"; held out {gap['held_out_after_rms_mm']:.4f} mm, {p_words(gap['held_out_p_value_after'])}"


def _then(v: ThenAndNow) -> str:
    if v.then is None:
        return ""
    if v.sigma_then is None:
        return f"then {short(v.then, 4)} (not determined by itself), "
    return f"then {_with_sigma(v.then, v.sigma_then)}, "


def _from(v: ThenAndNow) -> str:
    return "" if v.then is None else f"{short(v.then, 4)} -> "


def _with_sigma(value: float, sigma: float | None) -> str:
    return short(value, 4) + ("" if sigma is None else f" +- {short(sigma, 2)}")


def _share(v: ThenAndNow) -> str:
    return "" if v.share is None else f" ({100 * v.share:+.1f} %)"
