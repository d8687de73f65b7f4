"""Tables of an identified model: parameters with their groups, compliance matrices, what every joint showed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from drake_stiffness.effects.compliance import JointCompliance, LinkCompliance, Spring
from drake_stiffness.model import Model
from drake_stiffness.report import page as h
from drake_stiffness.report.evidence import joint_torques, spring_name

if TYPE_CHECKING:
    from drake_stiffness.effects.effect import Parameter
    from drake_stiffness.jobs import Identified

GROUPS = {
    "G1+": "determined by itself, more than 5 standard deviations from zero",
    "G1~": "determined by itself, 2 to 5 standard deviations from zero: borderline",
    "G1-": "determined by itself, but not told from zero (less than 2 standard deviations)",
    "G2": "not seen: no reading depends on it; its value is no evidence",
    "G3": "only a combination with others is determined; the value by itself is a convention (least norm)",
}

# Values below this, in units of a typical size, are a solver's zero.
NOTHING = 1e-6
# A G3 parameter without partners takes part in a direction that is not exactly redundant, but below the noise.
MIXED = "mixed with others along a direction that the noise hides"
# A bar is full at this many standard deviations.
_FULL_BAR = 20.0
# Torques below this (N m, or N along a slide) count as none.
_NO_TORQUE = 1e-6


def in_engineering_units(parameter: Parameter, joint: bool) -> tuple[float, str]:
    """Factor and unit in which a parameter is shown: joints in millionths, links in billionths, lengths in mm."""
    if joint:
        return {"rad/(N m)": (1e6, "µrad/(N m)"), "m/N": (1e6, "µm/N")}.get(parameter.unit, (1.0, parameter.unit))
    known = {
        "rad/(N m)": (1e9, "nrad/(N m)"),
        "rad/N": (1e9, "nrad/N"),
        "m/N": (1e9, "nm/N"),
        "m": (1e3, "mm"),
        "rad": (1e3, "mrad"),
    }
    return known.get(parameter.unit, (1.0, parameter.unit))


def shorten(names: Sequence[str], most: int = 3) -> str:
    """A list of parameters, those of one link together, cut after a few links."""
    owners: dict[str, list[str]] = {}
    for name in names:
        owner, dot, entry = name.rpartition(".")
        owners.setdefault(owner if dot else name, []).extend([entry] if dot else [])
    shown = [f"{owner} ({', '.join(entries)})" if entries else owner for owner, entries in list(owners.items())[:most]]
    rest = sum(max(len(entries), 1) for entries in list(owners.values())[most:])
    return ", ".join(shown) + (f" and {rest} more" if rest else "")


def parameter_table(model: Model, springs: bool, caption: str) -> h.Markup:
    """Values, standard deviations and groups of the springs' parameters, or of all others."""
    s = model.statistics
    rows = []
    for effect, own in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, Spring) != springs:
            continue
        joint = isinstance(effect, JointCompliance)
        for i, name, parameter in zip(range(own.start, own.stop), effect.names, effect.parameters, strict=True):
            factor, unit = in_engineering_units(parameter, joint)
            sigma = float(s.sigma[i]) if s is not None else float("nan")
            group = s.group[i] if s is not None else h.UNKNOWN
            merged = s.merged_with[i] if s is not None else ()
            value: object = h.number(_nonzero(model, i) * factor, 4)
            if group in ("G2", "G3"):
                value = h.join(h.Markup('<span class="soft">'), value, h.Markup("</span>"))
            ratio = abs(float(model.x[i])) / sigma if sigma > 0 else float("nan")
            share: object = (
                h.join(h.bar(ratio / _FULL_BAR), " ", h.number(ratio, 2)) if np.isfinite(ratio) else h.UNKNOWN
            )
            rows.append(
                (
                    name,
                    value,
                    h.number(sigma * factor, 2),
                    unit,
                    share,
                    group,
                    shorten(merged) or (MIXED if group == "G3" else ""),
                )
            )
    header = ("parameter", "value", "sigma", "unit", "value / sigma", "group", "cannot be told from")
    return h.table(header, rows, caption=caption, align="lrrllcl")


def _nonzero(model: Model, i: int) -> float:
    """A parameter's value, a solver's zero as zero."""
    return float(model.x[i]) if abs(model.x[i]) > NOTHING * model.scales[i] else 0.0


def group_table(model: Model) -> h.Markup:
    """How many parameters are in which group, and what the groups mean."""
    s = model.statistics
    if s is None:
        return h.paragraph("The model carries no statistics.")
    rows = [(name, s.group.count(name), meaning) for name, meaning in GROUPS.items()]
    return h.table(("group", "parameters", "meaning"), rows, align="lrl")


def matrices(model: Model) -> h.Markup:
    """Every link's 6x6 compliance matrix, shaded by size (blue positive, orange negative)."""
    found = [
        (e, e.matrix(x)) for e, x in zip(model.effects, model.values, strict=True) if isinstance(e, LinkCompliance)
    ]
    scaled = [np.abs(k) / np.outer(e.component_scales, e.component_scales) for e, k in found]
    largest = max((float(k.max()) for k in scaled), default=0.0)
    parts = [_matrix(spring_name(e), k, size / (largest or 1.0)) for (e, k), size in zip(found, scaled, strict=True)]
    return h.join(h.Markup('<div class="matrices">'), *parts, h.Markup("</div>"))


def _matrix(name: str, k: np.ndarray, size: np.ndarray) -> h.Markup:
    """One matrix in 1e-9 SI; depth of colour on a logarithmic scale of three decades."""
    wrench = ("fx", "fy", "fz", "mx", "my", "mz")
    moved = ("dx", "dy", "dz", "rx", "ry", "rz")
    lines = [
        h.join(
            h.Markup("<tr><th></th>"),
            *(h.join(h.Markup("<th>"), w, h.Markup("</th>")) for w in wrench),
            h.Markup("</tr>"),
        )
    ]
    for i in range(6):
        cells = []
        for j in range(6):
            depth = 0.0 if size[i, j] <= 1e-3 else 0.55 * (1 + np.log10(size[i, j]) / 3)
            colour = "0,114,178" if k[i, j] > 0 else "213,94,0"
            style = f' style="background:rgba({colour},{depth:.2f})"' if depth > 0.01 else ""
            text = "·" if k[i, j] == 0 else h.number(float(k[i, j]) * 1e9 if size[i, j] > NOTHING else 0.0, 3)
            cells.append(h.join(h.Markup(f'<td class="right"{style}>'), text, h.Markup("</td>")))
        lines.append(h.join(h.Markup("<tr><th>"), moved[i], h.Markup("</th>"), *cells, h.Markup("</tr>\n")))
    title = h.join(h.Markup("<caption><b>"), name, h.Markup("</b></caption>"))
    return h.join(
        h.Markup('<div class="scroll"><table>'), title, h.Markup("<tbody>"), *lines, h.Markup("</tbody></table></div>")
    )


def joint_table(result: Identified) -> h.Markup:
    """Joint by joint: the torques the campaign put on it, and what that revealed."""
    model, displacement = result.model, result.campaign.quantity == "displacement"
    tau = joint_torques(model, result.measurements, displacement)
    rows = []
    for i, name in enumerate(model.arm.joint_names):
        unit = "N" if model.arm.prismatic[i] else "N m"
        reach = f"{h.number(float(tau[i].min()), 3)} .. {h.number(float(tau[i].max()), 3)} {unit}"
        if np.abs(tau[i]).max() < _NO_TORQUE:
            reach = "none"
        rows.append((name, reach, *_revealed(model, name, reach == "none")))
    what = "that the applied loads add to the weight" if displacement else "from weight and loads"
    caption = f"Torque about the joint's axis {what}, smallest and largest of the campaign, and what the readings say of its spring."
    return h.table(("joint", "torque in this campaign", "compliance", "revealed?"), rows, caption=caption)


def _revealed(model: Model, joint: str, no_torque: bool) -> tuple[object, object]:
    """Compliance with its sigma, and the answer in words."""
    place = next((i for i, e in enumerate(model.effects) if isinstance(e, JointCompliance) and e.where == joint), None)
    s = model.statistics
    if place is None:
        return h.UNKNOWN, "held rigid in this model: nothing is said of it"
    i = model.slices[place].start
    factor, unit = in_engineering_units(model.parameters[i], joint=True)
    value = h.number(_nonzero(model, i) * factor, 3)
    if s is None:
        return f"{value} {unit}", h.UNKNOWN
    known = f"{value} ± {h.number(float(s.sigma[i]) * factor, 2)} {unit}"
    partners = f"only together with {shorten(s.merged_with[i])}" if s.merged_with[i] else "not by itself: " + MIXED
    negative = " A negative compliance is not physical." if model.x[i] < 0 else ""
    answers: dict[str, tuple[str, str]] = {
        "G1+": (known, "yes"),
        "G1~": (known, "borderline: 2 to 5 standard deviations from zero"),
        "G1-": (known, "NO: cannot be told from zero"),
        "G3": (f"({value} {unit})", partners),
    }
    reason = "no load turns this joint" if no_torque else "its torques are too small to show in the readings"
    shown, answer = answers.get(s.group[i], (h.UNKNOWN, f"NO: {reason}"))
    if answer.startswith("NO"):
        return shown, h.join(h.Markup("<b>"), answer, h.Markup("</b>"), "." + negative)
    return shown, answer + "." + negative
