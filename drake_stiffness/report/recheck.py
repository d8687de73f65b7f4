"""The page of `diagnose --fixed`: is the stored model still true, and if not, what changed, from what to what."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from drake_stiffness.diagnosis.locate import by_part
from drake_stiffness.diagnosis.recheck import ENOUGH_POSTURES, FEWEST_TO_LEAVE_OUT
from drake_stiffness.diagnosis.recheck_words import ThenAndNow, change_words, then_and_now
from drake_stiffness.diagnosis.signatures import Scene
from drake_stiffness.diagnosis.words import p_words, searched
from drake_stiffness.observation import measured, predicted
from drake_stiffness.report import diagnosis_plots as plots
from drake_stiffness.report import page as h
from drake_stiffness.report.diagnosis import SHAPE_CAPTION, WHERE_CAPTION, class_part, constant, interval_words
from drake_stiffness.report.diagnosis_arm import arm_section
from drake_stiffness.report.diagnosis_evidence import fates, ruled_out_section, suspects_section
from drake_stiffness.report.diagnosis_shape import shapes_between
from drake_stiffness.report.notes import provenance
from drake_stiffness.report.recheck_next import next_steps
from drake_stiffness.report.recheck_plots import MOST, then_and_now_figure

if TYPE_CHECKING:
    from drake_stiffness.diagnosis.recheck import Change
    from drake_stiffness.diagnosis.recheck_job import Rechecked

# What is left after the changes is more than noise below this.
_MORE_THAN_NOISE = 0.01
_HOW = (
    "beside the stored model's own uncertainty: what it has as a change of its values, what it has not as something new"
)


def recheck_report(result: Rechecked) -> str:
    """The page of `diagnose --fixed --report`.

    Parameters
    ----------
    result : Rechecked
        From `drake_stiffness.diagnosis.recheck_job.recheck_campaign`.

    Returns
    -------
    str
        A self-contained HTML page.
    """
    found, made = result.recheck, result.model.provenance
    document = result.document
    named = [change.named for change in found.changes]
    stored, now = found.left.scene.model, found.settled.model
    arm = (
        () if found.verdict == "consistent" else (arm_section(stored, now, found.left.scene.o, _about_arrows(result)),)
    )
    return h.page(
        f"Is {_name(result)} still true?",
        f"{result.task.campaign.measurements}, cell {result.task.campaign.cell}; {_stored(result)}. Nothing was fitted anew but what "
        "changed.",
        h.verdict(answer(result)),
        *_callouts(result),
        _tiles(result),
        _gap(result),
        *(_change(result, change, entry) for change, entry in zip(found.changes, document["effects"], strict=True)),
        h.section("What to do next", h.bullets(next_steps(document))),
        _where(result),
        *arm,
        suspects_section(found.first, fates(named, {}), document["rejected"], "the stored model", _HOW),
        ruled_out_section(document, " Of what the stored model has, the size is that of a change."),
        provenance(made, result.model.fit, level=2),
        footer=f"Made by {made.get('program', 'drake-stiffness')}.",
    )


def answer(result: Rechecked) -> str:
    """Still true, or what changed, in plain sentences."""
    found, gap = result.recheck, result.document["gap"]
    before, noise = found.before, h.length(gap["noise_shown_rms_mm"])
    number = "one posture" if found.postures == 1 else f"{found.postures} postures"
    read = f"At {number} the stored model is {h.length(before.rms_mm)} rms off; noise alone leaves {noise} ({p_words(before.p_value)})."
    if found.verdict == "consistent":
        return f"Still true. {read} All of it is within the model's own uncertainty and the noise."
    parts = ["No longer true."]
    if found.changes:
        parts += [f"{_sentence(change_words(e))}{_class_words(e)}." for e in result.document["effects"]]
    else:
        parts.append("No effect that is known, changed or new, says why.")
    parts.append(read)
    if found.changes:
        held = f"; {h.length(found.after.rms_mm)} for every posture by the others" if found.after else ""
        parts.append(f"With what changed: {h.length(gap['after_rms_mm'])} rms{held}.")
    if found.verdict in ("partly_explained", "unexplained"):
        parts.append(f"What remains: {result.document['where_in_words']['after']}.")
    return " ".join(parts)


def _name(result: Rechecked) -> str:
    return Path(result.document["recheck"]["model"]).name


def _stored(result: Rechecked) -> str:
    time = str(result.stored.provenance.get("time", ""))[:10]
    return f"stored model {_name(result)}{f' of {time}' if time else ''}"


def _class_words(entry: dict[str, Any]) -> str:
    """What these readings cannot tell a change from, for the answer: the class is the answer, not its member."""
    others = [f"{c['kind'].replace('_', ' ')} at {c['where']}" for c in entry["confounded_with"]]
    if not others:
        return ""
    return f", or one of {len(others)} that these readings cannot tell from it: {', '.join(others)}"


def _sentence(words: str) -> str:
    return words[:1].upper() + words[1:]


def _callouts(result: Rechecked) -> list[h.Markup]:
    found, told = result.recheck, result.document["recheck"]
    out = []
    if told["set_up_anew"]:
        out.append(
            h.callout(
                "SET UP ANEW:",
                f"{', '.join(told['set_up_anew'])}.",
                "The campaign says that these are unknown, so they were fitted to its readings and count as no change.",
            )
        )
    if found.noise_ratio > 1:
        out.append(
            h.callout(
                "NOISIER THAN STATED.",
                f"The stored model's own campaign showed {found.noise_ratio:.2g} times its stated noise; these readings are held against that.",
                "Changes below it are not seen. Something may have been missing in the model from the beginning: diagnose its campaign.",
            )
        )
    if found.after is None:
        out.append(
            h.callout(
                "NOT CONFIRMED ON OTHER POSTURES.",
                f"There are {found.postures}; fewer than {FEWEST_TO_LEAVE_OUT}, so none could be left out.",
                "What changed was found and judged on the same readings.",
            )
        )
    elif found.changes and found.after.p_value < _MORE_THAN_NOISE:
        out.append(
            h.callout(
                "A LITTLE MORE THAN NOISE IS LEFT.",
                f"Every posture predicted by the others: {p_words(found.after.p_value)}; see Where the gap is.",
                "What changed has nearly the form that was named, or something small changed besides. Its value is good to about what is left.",
            )
        )
    for name, why in found.last.faults.items():
        out.append(h.callout(f"NOT TRIED: {name}.", f"It failed: {why}.", "All other suspects were tried."))
    return out


def _tiles(result: Rechecked) -> h.Markup:
    found, gap = result.recheck, result.document["gap"]
    before = found.before
    whose = "its own campaign showed" if found.noise_ratio > 1 else "stated"
    after: tuple[tuple[str, str], ...] = ()
    if found.changes:
        after = ((h.number(gap["after_rms_mm"]), "with what changed, mm rms"),)
    return h.tiles(
        (
            (h.number(before.rms_mm), "by the stored model, mm rms"),
            *after,
            (h.number(gap["noise_shown_rms_mm"]), f"noise alone ({whose}), mm rms"),
            (h.number(before.chi2_per_dof), "chi-square / dof by the stored model"),
            (p_words(before.p_value).removeprefix("p ").removeprefix("= "), "p-value if it were still true"),
            (str(found.postures), "postures"),
        )
    )


def _gap(result: Rechecked) -> h.Markup:
    found, gap = result.recheck, result.document["gap"]
    rows: dict[str, tuple[float | None, float | None]] = {
        "all readings": (found.before.rms_mm, gap["after_rms_mm"]) if found.changes else (None, found.before.rms_mm)
    }
    text = (
        f"The stored model saw none of these readings. Chi-square per degree of freedom, its own uncertainty counted, is "
        f"{h.number(found.before.chi2_per_dof)} (1 is noise)"
    )
    if found.changes and found.after is not None:
        rows["every posture by the others"] = (None, found.after.rms_mm)
        text += (
            f". With what changed, every posture predicted from the stored model and the other postures: "
            f"{h.number(found.after.chi2_per_dof)} ({p_words(found.after.p_value)}, that of the worst posture, their number paid for)"
        )
    shown = gap["noise_shown_rms_mm"] if found.noise_ratio > 1 else None
    caption = "Before: the stored model. After: with the values of now. " if found.changes else ""
    return h.section(
        "The gap",
        h.figure(
            plots.gap_bars(rows, gap["noise_rms_mm"], shown, "noise of the model's own campaign"),
            f"{caption}Readings may come out a little below the noise, because their unloaded reference takes up some of it.",
            "Bars of the gap before and after",
        ),
        h.paragraph(f"{text}."),
    )


def _change(result: Rechecked, change: Change, entry: dict[str, Any]) -> h.Markup:
    found, values = result.recheck, then_and_now(entry)
    base, final = found.left.scene.model, found.settled.model
    then = None if change.appeared else base.values[change.number]
    pictures = shapes_between(found.left.scene.o, base, final, final.effects[change.number], then)
    evidence = entry["evidence"]
    lines = [
        f"It explains {h.number(evidence['sigma'])} sigma of these readings, the stored model's uncertainty counted "
        f"({p_words(evidence['p_value'])}; {evidence['level']:.1g} was needed after the search over all suspects was paid for)."
    ]
    if found.postures >= ENOUGH_POSTURES:
        lines.append(
            f"Postures that a fit did not see are predicted better by {h.number(evidence['cross_validated_gain'])} in chi-square."
        )
    whose = "the effect" if change.appeared else "its change"
    many = f" The {MOST} surest of {len(values)} values." if len(values) > MOST else ""
    several = (
        " Where several values have one unit, their change since then is drawn."
        if len(values) > 1 and not change.appeared
        else ""
    )
    return h.section(
        f"{entry['change'].capitalize()}: {entry['kind'].replace('_', ' ')} at {entry['where']}",
        class_part(entry),
        _values_table(entry, values, change),
        h.figure(
            then_and_now_figure(values),
            f"With 95 % intervals; hollow where nothing is known of the value by itself.{several}{many}",
            f"Values then and now, {entry['kind']} at {entry['where']}",
        ),
        h.paragraph(" ".join(lines)),
        h.figure(
            plots.shape_figure(pictures),
            f"Each dot is a load step. Left: what {whose} does (black) and {SHAPE_CAPTION}",
            f"Residual against what explains it, {entry['kind']} at {entry['where']}",
        ),
    )


def _values_table(entry: dict[str, Any], values: list[ThenAndNow], change: Change) -> h.Markup:
    """Values then and now with their intervals, and constants that were searched or stand as stored."""
    constants = searched(entry)
    if change.appeared:
        rows = [
            (v.name, h.number(v.now, 4), h.number(v.sigma, 2), interval_words(v.now, v.sigma, 4), v.unit)
            for v in values
        ]
        rows += [(name, constant(value), "", "searched, not fitted", unit) for name, value, unit in constants]
        return h.table(("unknown", "now", "sigma", "95 %", "unit"), rows, align="lrrll")
    both = [
        (v.name, h.number(v.then, 4), interval_words(v.then or 0.0, v.sigma_then, 4), h.number(v.now, 4), interval_words(v.now, v.sigma, 4), _by(v), v.unit)
        for v in values
    ]  # fmt: skip
    both += [(name, constant(value), "as stored", "", "", "", unit) for name, value, unit in constants]
    return h.table(("unknown", "then", "95 %", "now", "95 %", "change", "unit"), both, align="lrlrlrl")


def _by(v: ThenAndNow) -> str:
    """A change with its sign, in percent where the stored value is known well enough for that."""
    share = f" ({100 * v.share:+.1f} %)" if v.share is not None else ""
    return f"{'+' if v.change > 0 else ''}{h.number(v.change)}{share}"


def _where(result: Rechecked) -> h.Markup:
    found, words = result.recheck, result.document["where_in_words"]
    o = found.left.scene.o
    dof = o.rows - o.references

    def places(model: Any) -> dict[str, list[Any]]:
        return by_part(Scene(model, o), measured(o) - predicted(o, model), dof)

    before = places(found.left.scene.model)
    after = places(found.settled.model) if found.changes else {}
    text = f"{_sentence(words['before'])}."
    if found.changes:
        text = f"Before: {words['before']}. After: {words['after']}."
    return h.section(
        "Where the gap is",
        h.paragraph(text),
        h.figure(
            plots.where_figure(before, after),
            f"All {WHERE_CAPTION}",
            "Residuals by joint, direction, level, branch, point, step, time and posture",
        ),
    )


def _about_arrows(result: Rechecked) -> str:
    if result.recheck.changes:
        return " with what changed"
    return " with everything moved as far as the stored model's uncertainty allows"
