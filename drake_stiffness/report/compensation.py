"""The report of `compensate`: how far the force bends the arm off the path, what was changed, how much to believe."""

from __future__ import annotations

import hashlib
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

import drake_stiffness
from drake_stiffness.report import compensation_plots as plots
from drake_stiffness.report import page as h
from drake_stiffness.report.compensation_trust import trust_sections
from drake_stiffness.report.limits import limits

if TYPE_CHECKING:
    from drake_stiffness.model import Model
    from toolpaths.result import Compensation

# So many refused lines, inserted words and notes are listed.
_LISTED = 200


def compensation_report(result: Compensation, model: Model) -> str:
    """The page of `compensate --report`; needs neither Drake nor cvxpy.

    Parameters
    ----------
    result : Compensation
        From `toolpaths.job.compensate`.
    model : Model
        The model that made it.

    Returns
    -------
    str
        A self-contained HTML page.
    """
    program = result.program
    return h.page(
        f"Compensation of {PurePath(program.path).name}",
        f"{program.dialect.upper()} program, {result.rows.size} corrected points on {result.to_dict()['lines']} lines.",
        h.verdict(answer(result)),
        callouts(result, model),
        body(result, model, level=2),
        _provenance(result, model),
        footer=f"Made by drake-stiffness {drake_stiffness.__version__}.",
    )


def answer(result: Compensation) -> str:
    """The verdict in plain sentences."""
    d = result.to_dict()
    before, after, sigma = d["uncompensated_mm"], d["residual_mm"], d["model_sigma_mm"]["mean"]
    parts = [
        f"The model predicts that the process force pushes the tool {h.length(before['mean'])} off its path on average "
        f"({h.length(before['max'])} at most)."
    ]
    if np.isfinite(d["percent_compensated"]):
        parts.append(
            f"With the corrected program {h.length(after['mean'])} remain ({h.length(after['max'])} at most), that is "
            f"{d['percent_compensated']:.2f} % compensated by the model's own reckoning."
        )
    else:
        parts.append("That is less than half a printed digit: the program could not hold a correction.")
    high = d["residual_interval_mm"]["high"]["p95"]
    if np.isfinite(sigma):
        parts.append(
            f"The model itself is uncertain by {h.length(sigma, 2)} (1 sigma). With all that is stated, the residual stays below "
            f"{h.length(high, 2)} at a point with 95 % probability; that leaves out {', '.join(result.account.interval.lacks)}, so a part "
            "will show more."
        )
    else:
        parts.append("How uncertain the model itself is, is not known: it carries no statistics.")
    if result.refusals:
        parts.append(
            f"{_count(len({r.line for r in result.refusals}), 'line was', 'lines were')} left uncorrected (listed below)."
        )
    return " ".join(parts)


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"


def callouts(result: Compensation, model: Model) -> h.Markup:
    """What must not be overlooked: refused lines, inserted words, notes, a model that did not fit its own campaign."""
    found = []
    forced = [r for r in result.refusals if r.carries_force]
    if forced:
        lines = sorted({r.line for r in forced})
        shown = ", ".join(map(str, lines[:12])) + (f" and {len(lines) - 12} more" if len(lines) > 12 else "")
        found.append(
            h.callout(
                "Not corrected:",
                f"motions under force on line {shown}.",
                "There the tool deviates as without compensation.",
            )
        )
    if result.insertions:
        count = _count(len(result.insertions), "line", "lines")
        found.append(
            h.callout("Words inserted:", f"on {count}, because the correction needs words that were not written.")
        )
    found += [h.callout("Note:", note) for note in result.notes[:_LISTED]]
    if model.fit.get("noise_rejected"):
        text = "the model does not explain its own campaign to the stated noise."
        found.append(
            h.callout("Weak model:", text, "Its uncertainty below was widened for that; see the identification report.")
        )
    return h.join(*found)


def body(result: Compensation, model: Model, level: int) -> h.Markup:
    """Everything between the verdict and the provenance, with headings from `level` on."""
    return h.join(
        _tiles(result),
        h.section("How far off, before and after", *_deviation(result), level=level),
        h.section("What was changed", *_correction(result), level=level),
        *([] if result.spin is None else [h.section("Turning the tool about its axis", *_spin(result), level=level)]),
        trust_sections(result, level),
        h.section("How much of this to believe", *limits(result, model), level=level),
        _lines(result, level),
        h.section("Conventions", _conventions(result), level=level),
    )


def _tiles(result: Compensation) -> h.Markup:
    d = result.to_dict()
    return h.tiles(
        [
            (h.length(d["uncompensated_mm"]["mean"]), "mean deviation uncompensated, predicted"),
            (h.length(d["residual_mm"]["mean"]), "mean deviation compensated, as printed, predicted"),
            (h.length(d["correction_mm"]["max"]), "largest correction"),
            (h.length(d["half_printed_digit_mm"]), "half a printed digit: the finest step the program can take"),
            (h.length(d["model_sigma_mm"]["mean"], 2), "uncertainty of the model, 1 sigma"),
        ]
    )


def _deviation(result: Compensation) -> list[h.Markup]:
    d = result.to_dict()
    s = plots.path_mm(result.target_mm)
    picture = plots.deviation_figure(s, result.before_mm, result.one_shot_mm, result.after_mm, result.sigma_mm)
    caption = (
        "Distance of the tool centre point from where the program wants it, as the model predicts it, along the corrected points (mind "
        "the logarithmic axis). Amber: the deviation subtracted once. Blue: the mirror iteration run to its end, with the numbers as they "
        "are printed in the program; it cannot get below the printed digits. Where the blue line lies under the dashed one, better "
        "printing or more iterations gain nothing: the model's own uncertainty is larger."
    )
    rows = [
        (label, *(h.number(d[key][k]) for k in ("mean", "rms", "p95", "max")))
        for label, key in (
            ("uncompensated, predicted", "uncompensated_mm"),
            ("after one shot", "one_shot_residual_mm"),
            ("converged, as printed", "residual_mm"),
            ("joint springs of this model alone", "joints_only_mm"),
            ("correction applied", "correction_mm"),
            ("uncertainty of the model (1 sigma)", "model_sigma_mm"),
        )
    ]
    header = ("mm", "mean", "RMS", "95th percentile", "largest")
    return [
        h.figure(picture, caption, "Predicted deviation along the path, logarithmic"),
        h.table(header, rows, align="lrrrr"),
        h.paragraph(
            f"{h.number(d['percent_compensated'], 5)} % of the mean deviation is compensated in {d['iterations']} iterations; each step "
            f"shrinks the rest to {h.number(d['largest_contraction'], 2)} of it or less."
            if np.isfinite(d["percent_compensated"])
            else "No deviation is predicted that the printed digits could hold."
        ),
    ]


def _correction(result: Compensation) -> list[h.Markup]:
    picture, view = plots.top_view_figure(
        result.target_mm, result.correction_mm, np.isnan(result.account.evenness.spacing_mm)
    )
    s = plots.path_mm(result.target_mm)
    largest = np.abs(result.correction_mm).max(axis=0)
    mean = result.correction_mm.mean(axis=0)
    rows = [
        (
            axis,
            h.number(float(mean[c])),
            h.number(float(result.correction_mm[:, c].min())),
            h.number(float(result.correction_mm[:, c].max())),
        )
        for c, axis in enumerate("xyz")
    ]
    at = int(np.linalg.norm(result.correction_mm, axis=1).argmax())
    where = ", ".join(f"{p:.1f}" for p in result.target_mm[at])
    return [
        h.figure(
            picture,
            f"The path in the program's base frame, {view}. The corrected program aims where the arrows point, so that the force brings the "
            "tool back to the line.",
            "Path coloured by the size of the correction",
            width=86,
        ),
        h.figure(
            plots.correction_figure(s, result.correction_mm, result.force_N),
            "Above: what the numbers of the program move by. Below: the force on the tool that was assumed. Steps in the correction without "
            "a step in the force come from the posture (a turn of the wrist, for example) and deserve a look.",
            "Components of correction and force along the path",
        ),
        h.table(("correction, mm", "mean", "smallest", "largest"), rows, align="lrrr"),
        h.paragraph(
            f"The largest correction is on line {int(result.line[at])}, at ({where}) mm. Half a printed digit is "
            f"{result.quantum_mm:g} mm beside components of up to {h.number(float(largest.max()))} mm."
        ),
    ]


def _spin(result: Compensation) -> list[h.Markup]:
    """What `--spin stiffest` did and what it buys."""
    spin = result.spin
    assert spin is not None
    rows = [
        (label, h.number(float(values.mean())), h.number(float(values.max())))
        for label, values in (("as programmed", spin.kept_mm), ("as turned", spin.chosen_mm))
    ]
    picture = plots.spin_figure(plots.path_mm(result.target_mm), spin.kept_mm, spin.chosen_mm, spin.angle_rad)
    return [
        h.paragraph(f"{spin.why[:1].upper()}{spin.why[1:]}."),
        h.figure(
            picture,
            "Above: deflection by the process force before any correction, with the tool as programmed and as turned (linear). Below: the "
            "turn about the tool's own axis, which the cut does not feel.",
            "Deflection along the path as programmed and as turned, and the turn",
        ),
        h.table(("predicted deflection, mm", "mean", "largest"), rows, align="lrr"),
    ]


def _lines(result: Compensation, level: int) -> h.Markup:
    parts: list[h.Markup] = []
    if result.refusals:
        rows = [(r.line, "yes" if r.carries_force else "no", r.reason) for r in result.refusals[:_LISTED]]
        parts.append(_listing(("line", "under force", "why it was left as it was"), rows, len(result.refusals)))
    if result.insertions:
        inserted = [(i.line, ", ".join(i.words), i.text.strip()) for i in result.insertions[:_LISTED]]
        parts.append(_listing(("line", "words", "inserted text"), inserted, len(result.insertions)))
    arcs = result.program.replaced
    if arcs:
        moves = [
            (a.line, a.before, f"{a.new_line} to {a.new_line + a.after.count(chr(10))}", a.after)
            for a in arcs[:_LISTED]
        ]
        parts.append(_listing(("line", "arc", "lines now", "straight moves"), moves, len(arcs)))
    if result.notes:
        parts.append(h.bullets(result.notes[:_LISTED]))
    if not parts:
        parts.append(h.paragraph("Every motion under force was corrected; nothing was refused, inserted or noted."))
    return h.section("Lines that need attention", *parts, level=level)


def _listing(header: tuple[str, ...], rows: list[Any], total: int) -> h.Markup:
    more = f"The first {len(rows)} of {total}." if total > len(rows) else ""
    return h.table(header, rows, caption=more, align="r" + "l" * (len(header) - 1))


def _conventions(result: Compensation) -> h.Markup:
    return h.bullets(
        [
            "Corrections and target points are in the base frame that the program is written in; forces in the axes of the world.",
            "A deviation is the distance between the tool centre point under force and the pose the program asked for. "
            + (
                "Sag under weight counts (reference: rigid)."
                if result.process.reference == "rigid"
                else "What counts is loaded minus unloaded-with-weight at the same commanded joints (reference: unloaded)."
            ),
            _force_law(result),
            "Linear and circular motions carry force; point-to-point motions and rapids do not and are never changed.",
            "Only the numbers of pose words change; every other byte of the program stays.",
        ]
    )


def _provenance(result: Compensation, model: Model) -> h.Markup:
    made = model.provenance
    files: list[tuple[object, object, object]] = [
        ("program", PurePath(result.program.path).name, _digest(result.digests[0])),
        ("corrected program", "(output)", _digest(result.digests[1])),
        ("process", result.process.path.name, _sha(result.process.path.read_bytes())),
    ]
    files += [
        (
            f"model: {what}",
            entry.get("file", ""),
            h.join(h.Markup('<span class="mono">'), entry.get("sha256", ""), h.Markup("</span>")),
        )
        for what, entry in made.get("inputs", {}).items()
    ]
    text = (
        f"Model identified by {made.get('program', 'an unknown program')}, {made.get('time', 'time unknown')}, seed of the hold-out "
        f"{made.get('seed') if made.get('seed') is not None else 'none'}. Inverse kinematics: {result.method}."
    )
    return h.section("Provenance", h.paragraph(text), h.table(("what", "file", "SHA-256"), files))


def _force_law(result: Compensation) -> str:
    """Where the force came from."""
    force = result.process.force
    if force.milling is not None:
        return force.milling.in_words
    if force.constant is None:
        return f"The force is from the table {force.table}, one row per corrected motion."
    parts = [f"{value:g}" for value in force.constant.wrench]
    return f"The force is constant in {force.constant.frame} axes: ({', '.join(parts[:3])}) N, ({', '.join(parts[3:])}) N m."


def _sha(data: bytes) -> h.Markup:
    return _digest(hashlib.sha256(data).hexdigest())


def _digest(hexadecimal: str) -> h.Markup:
    return h.Markup(f'<span class="mono">{hexadecimal}</span>')
