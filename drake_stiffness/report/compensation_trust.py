"""What a corrected program rests on: intervals, causes, evenness, turning points, the controller, and what a probe found."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from drake_stiffness.report import compensation_plots as plots
from drake_stiffness.report import page as h

if TYPE_CHECKING:
    from toolpaths.account.blending import Blending
    from toolpaths.result import Compensation

_CONTROLLER = {
    "loads_set": "load data of tool and spindle set on the controller",
    "tool_data_set": "TCP on the controller is that of the model",
    "absolute_accuracy": "absolute-accuracy option on",
    "blend_radius_mm": "blend radius, mm",
}
_LINES = 30


def trust_sections(result: Compensation, level: int) -> h.Markup:
    """Sections between what was changed and how much to believe."""
    parts = [
        h.section("Predicted residual and its interval", *_interval(result), level=level),
        h.section("What bends the tool aside", *_causes(result), level=level),
        h.section("New kinks, limits, turning points", *_evenness(result), level=level),
        h.section("What the controller decides", *_controller(result), level=level),
    ]
    if result.learnt is not None:
        parts.append(h.section("What the probe found", *_probe(result), level=level))
    return h.join(*parts)


def _interval(result: Compensation) -> list[h.Markup]:
    i, s = result.account.interval, plots.path_mm(result.target_mm)
    picture = plots.interval_figure(s, result.after_mm, i.low_mm, i.high_mm)
    rows = [
        (label, *(h.number(value) for value in _spread(values)))
        for label, values in (
            ("residual predicted, as printed", result.after_mm),
            ("lower end of the 95 % interval", i.low_mm),
            ("upper end of the 95 % interval", i.high_mm),
            ("sigma: parameters of the model", i.parameters_mm),
            ("sigma: process force", i.force_mm),
            ("sigma: form of the model", i.form_mm),
            ("sigma: jumps of backlash", i.jump_mm),
        )
    ]
    caption = (
        "The band is where the real residual lies with 95 % probability at any one point, if nothing happens that the list below leaves "
        "out. Errors of model and force are nearly the same at all points, so the mean over the program is no surer than a single point."
    )
    return [
        h.figure(picture, caption, "Predicted residual with its interval along the path"),
        h.table(("mm", "mean", "95th percentile", "largest"), rows, align="lrrr"),
        h.paragraph("In the interval: ", ", ".join(i.carries), ". Not in it: ", ", ".join(i.lacks), "."),
    ]


def _spread(values: np.ndarray) -> tuple[float, float, float]:
    known = values[np.isfinite(values)]
    if not known.size:
        return (float("nan"),) * 3
    return float(known.mean()), float(np.percentile(known, 95)), float(known.max())


def _causes(result: Compensation) -> list[h.Markup]:
    causes, listed = result.account.causes, result.account.causes_list()
    rows = [
        (
            f"{cause['where']}{'' if cause['told_apart'] else ' *'}",
            str(cause["kind"]).replace("_", " "),
            f"{100 * float(str(cause['share'])):.1f} %",
            h.bar(abs(float(str(cause["share"])))),
            h.number(float(str(cause["mean_mm"]))),
        )
        for cause in listed
    ]
    mine = float(np.sqrt((causes.joints_only_mm**2).mean()))
    best = causes.best_joints_only_mm
    text = (
        f"A correction by the joint springs of this model alone would leave {h.length(mine)} rms, this one "
        f"{h.length(float(np.sqrt((result.after_mm**2).mean())))}. Joint springs fitted to this very program, which no campaign "
        f"could do better, would leave {h.length(best)}: they take over what links do here, and are wrong for another posture or force."
    )
    star = (
        " * The campaign shows this part in sums with others only: the share by itself is a convention, that of the sum is not."
        if any(not cause["told_apart"] for cause in listed)
        else ""
    )
    return [
        h.table(
            ("part", "kind", "share of the deflection", "", "mean, mm"),
            rows,
            align="llrlr",
            caption="Along its own direction, superposed.",
        ),
        h.paragraph(text, star),
    ]


def _evenness(result: Compensation) -> list[h.Markup]:
    e, b, r, line = result.account.evenness, result.account.blending, result.account.reserve, result.line
    d = e.to_dict(line)
    kinks = [str(k) for k in line[e.kinks].tolist()]
    blended, (low, high) = b.overlapping, b.limits_mm
    rows = [
        (
            "largest change of the correction, mm per mm of path",
            h.number(float(str(d["largest_mm_per_mm"]))),
            f"bound {e.bound:g}",
        ),
        ("points with a new kink", str(e.kinks.size), "line " + ", ".join(kinks[:_LINES]) if kinks else "nowhere"),
        ("median distance of points, mm", h.number(float(str(d["median_spacing_mm"]))), ""),
        (
            "steps shorter than two blend radii",
            h.UNKNOWN if not np.isfinite(blended) else f"{100 * blended:.0f} %",
            "the controller rounds over points there"
            if blended > 0
            else ""
            if blended == 0
            else "neither program nor process.yaml says a blend radius",
        ),
        (
            "blend radius, mm",
            h.UNKNOWN if np.isnan(high) else h.number(high) if low == high else f"{h.number(low)} to {h.number(high)}",
            _blend_source(b),
        ),
        (
            "change of the correction within one blend, mm, at most",
            h.number(b.within_mm) if np.isfinite(b.within_mm) else h.UNKNOWN,
            "so much of it may be rounded away" if b.within_mm > 0 else "",
        ),
        (
            "nearest joint limit once corrected",
            h.UNKNOWN if not r.joint else f"{h.number(r.limit_margin)} {r.unit}",
            f"{r.joint}, line {r.line}" if r.joint else "the arm has no limits",
        ),
        ("singularity margin once corrected", h.number(r.singularity_margin), "refused below 0.005"),
    ]
    parts = [h.table(("", "value", "where"), rows, align="lrl")]
    turns = [t for t in result.account.turning.to_list(line) if t["lines"]]
    if turns:
        found = [
            (
                t["where"],
                str(t["kind"]).replace("_", " "),
                h.number(float(str(t["size_mm"]))),
                ", ".join(map(str, list(t["lines"])[:_LINES])),  # type: ignore[call-overload]
            )
            for t in turns
        ]
        parts.append(h.table(("joint", "effect", "moves the tool by, mm", "turns at line"), found, align="llrl"))
    return parts


def _blend_source(blending: Blending) -> str:
    """Who says the blend radius."""
    if np.isfinite(blending.stated_mm):
        return "as stated in process.yaml"
    if blending.all_said:
        return "said by the program at every point"
    own = np.isfinite(blending.said_mm).mean()
    said = [f"said by the program at {100 * own:.0f} % of the points"] if own else []
    said += [f"depends on speed at {100 * blending.by_speed:.0f} %"] if blending.by_speed else []
    return "; ".join(said)


def _controller(result: Compensation) -> list[h.Markup]:
    stated = result.process.controller.model_dump()
    words = {True: "yes", False: "no", None: "not stated"}
    rows = [
        (text, words[stated[key]] if isinstance(stated[key], bool) or stated[key] is None else f"{stated[key]:g}")
        for key, text in _CONTROLLER.items()
    ]
    low, high = result.account.blending.limits_mm
    if stated["blend_radius_mm"] is None and np.isfinite(high):
        rows[-1] = (rows[-1][0], f"not stated; the program says {low:g} to {high:g}")
    return [
        h.table(("as stated in process.yaml (controller)", ""), rows),
        h.paragraph(
            "Hardly any of this is in the program, and each decides whether a correction of tenths of a millimetre lands: a wrong load moves the "
            "controller's own sag model, a wrong TCP every oriented point, and blending rounds over points that lie close."
        ),
    ]


def _probe(result: Compensation) -> list[h.Markup]:
    learnt = result.learnt
    assert learnt is not None
    d = learnt.to_dict()
    rows = [
        ("measured", h.number(d["measured_rms_mm"])),
        ("after what the model explains", h.number(d["after_model_rms_mm"])),
        ("after shift, turn and force", h.number(d["rest_rms_mm"])),
        ("noise of a coordinate", h.number(learnt.noise_mm)),
    ]
    shift = ", ".join(f"{v:.3f} ± {s:.3f}" for v, s in zip(learnt.shift_mm, learnt.shift_sigma_mm, strict=True))
    turn = ", ".join(f"{v:.2f} ± {s:.2f}" for v, s in zip(learnt.turn_mrad, learnt.turn_sigma_mrad, strict=True))
    named = [
        ("shift of the workpiece, mm", shift),
        ("turn of the workpiece, mrad", turn),
        ("error of the force", f"{100 * learnt.force_error:+.1f} ± {100 * learnt.force_error_sigma:.1f} %"),
    ]
    picture = plots.probe_figure(
        learnt.probe.deviation_mm, learnt.probe.deviation_mm - learnt.explained_mm, learnt.rest_mm, learnt.places.order
    )
    return [
        h.figure(
            picture,
            "Length of the deviation at the probed places, in the order of the path.",
            "Deviations at probed places",
        ),
        h.table(("deviation, mm", "rms"), rows, align="lr"),
        h.table(("named cause", "value, one sigma"), named),
        h.bullets(note for note in learnt.notes),
    ]
