"""The report of `inspect`: what the arm is, where its springs stand, how many unknowns that makes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import drake_stiffness
from drake_stiffness.report import page as h
from drake_stiffness.report.arm_picture import arm_figure

if TYPE_CHECKING:
    from drake_stiffness.inspection import Inspection


def inspection_report(result: Inspection, cell_path: Path) -> str:
    """The page of `inspect --report`.

    Parameters
    ----------
    result : Inspection
        From `drake_stiffness.inspection.inspect_cell`.
    cell_path : Path
        The cell.yaml it describes.

    Returns
    -------
    str
        A self-contained HTML page.
    """
    from drake_stiffness.cell import read_cell
    from drake_stiffness.files import sha256

    cell = read_cell(cell_path)
    files = [("cell", cell_path), ("robot", cell.robot_path)]
    rows = [
        (what, path.name, h.Markup(f'<span class="mono">{sha256(path)}</span>'))
        for what, path in files
        if path.is_file()
    ]
    return h.page(
        f"Inspection of {cell_path.name}",
        f"Robot description {cell.robot_path.name}, flange '{cell.robot.flange}'. What the arm is before anything is measured.",
        h.verdict(_answer(result)),
        _picture(result, np.array(cell.tool.tcp.position_m)),
        _chain(result),
        _springs(result),
        _counts(result),
        _load(cell),
        _conventions(result),
        h.section("Provenance", h.table(("input", "file", "SHA-256"), rows)),
        footer=f"Made by drake-stiffness {drake_stiffness.__version__}.",
    )


def _answer(result: Inspection) -> str:
    arm, kept = result.arm, sum(s["unknowns"] for s in result.springs)
    joints = sum(s["kind"] == "joint" for s in result.springs)
    links = len(result.springs) - joints
    text = (
        f"The arm has {arm.num_joints} joints and {arm.num_joints + 1} links (the base link counts). This cell puts springs in "
        f"{joints} joints and {links} links, which makes {kept} unknown compliances."
    )
    rank = _rank_of_cell(result)
    if rank is not None:
        text += (
            f" Of the {rank['parameters']} unknowns of the complete {rank['template']} model, measurements of these reference points "
            f"under forces at this load point can determine at most {rank['rank']} independent combinations."
        )
    return text


def _rank_of_cell(result: Inspection) -> dict[str, Any] | None:
    used = {s.get("template") for s in result.springs if s["kind"] == "link"}
    return next((e for e in result.identifiable if e["template"] in used and e["load"] == "force"), None)


def _sprung(result: Inspection) -> list[bool]:
    names = {s["name"] for s in result.springs if s["kind"] == "link"}
    return [link in names for link in result.arm.link_names]


def _picture(result: Inspection, tcp: np.ndarray) -> h.Markup:
    source, postures = arm_figure(result.arm, _sprung(result), tcp)
    shown = ", ".join(
        f"{joint['name']} {q * (1e3 if joint['unit'] == 'mm' else 180 / np.pi):.0f} {joint['unit']}"
        for joint, q in zip(result.joints, postures[1], strict=True)
    )
    caption = (
        "The arm as sticks in the world frame. Black dashed: joint axes J1, J2, ... (numbers as in the table below). Grey: links L0 "
        "(base), L1, ... Small tripods: frames of the link springs, x red-orange, y green, z blue. Amber: tool, up to the tool centre "
        f"point. Left: all joints at zero, which may lie outside the limits. Right: {shown}. Check that axes and lengths are those of "
        "your robot."
    )
    return h.section("The arm", h.figure(source, caption, "Stick picture of the arm at zero and at a bent posture"))


def _chain(result: Inspection) -> h.Markup:
    rows = []
    for i, joint in enumerate(result.joints):
        limits = f"{_limit(joint['lower'])} .. {_limit(joint['upper'])} {joint['unit']}"
        axis = " ".join(f"{a:.3g}" for a in np.round(joint["axis"], 6) + 0.0)
        place = ", ".join(f"{p:.3f}" for p in np.round(joint["position_at_zero_m"], 6) + 0.0)
        carries = f"L{i + 1} {result.arm.link_names[i + 1]}"
        mass = f"{result.arm.mass_kg[i + 1]:.4g}"
        rows.append((f"J{i + 1}", joint["name"], joint["type"], axis, limits, place, carries, mass))
    header = ("", "joint", "type", "axis", "limits", "place at zero, m", "moves link", "mass, kg")
    caption = (
        f"From the base L0 {result.arm.link_names[0]} to the flange. The axis is given in the joint's parent-side frame; places are in "
        "the world."
    )
    return h.section("Chain", h.table(header, rows, caption=caption, align="lllllllr"))


def _limit(value: float) -> str:
    return f"{value:g}" if np.isfinite(value) else "no limit"


def _springs(result: Inspection) -> h.Markup:
    if not result.springs:
        return h.section("Springs of this cell", h.paragraph("None: the cell keeps no springs; the arm is rigid."))
    rows = []
    for s in result.springs:
        template = s.get("template") or h.UNKNOWN
        if s.get("beam_axis"):
            template = f"{template}, long axis {s['beam_axis']}"
        names = ", ".join(name.rsplit(".", 1)[-1] for name in s["parameters"]) if s["kind"] == "link" else "k"
        rows.append((s["name"], s["kind"], s["frame"], template, s["unknowns"], names))
    header = ("spring", "kind", "acts in", "template", "unknowns", "which")
    caption = (
        "k11 .. k66 are entries of the 6x6 compliance matrix: 1 to 3 translations, 4 to 6 rotations of the spring frame; k26 is the "
        "translation along y that a moment about z causes."
    )
    return h.section("Springs of this cell", h.table(header, rows, caption=caption, align="llllrl"))


def _counts(result: Inspection) -> h.Markup:
    c, links, joints = result.counts, result.arm.num_joints + 1, result.arm.num_joints
    rows = [
        ("complete", f"{links} x 36 + {joints}", c["complete"], "every entry of every 6x6 matrix its own unknown"),
        ("symmetric", f"{links} x 21 + {joints}", c["symmetric"], "matrices symmetric, as energy demands"),
        ("beam", f"{links} x 8 + {joints}", c["beam"], "links as prismatic beams: 8 entries kept"),
    ]
    parts = [
        h.paragraph(
            f"For springs in all {links} links and {joints} joints, whatever this cell keeps (this cell: "
            f"{sum(s['unknowns'] for s in result.springs)} unknowns)."
        ),
        h.table(("template", "sum", "unknowns", "meaning"), rows, align="llrl"),
    ]
    if result.identifiable:
        parts.append(_ranks(result))
    else:
        parts.append(
            h.paragraph(
                "How many of these a measurement can tell apart is computed with ",
                _code("inspect --identifiability"),
                ".",
            )
        )
    return h.section("How many unknowns", *parts)


def _ranks(result: Inspection) -> h.Markup:
    kinds = {"wrench": "forces and moments", "force": "forces only"}
    rows = [
        (
            e["template"],
            kinds.get(e["load"], e["load"]),
            e["parameters"],
            e["rank"],
            h.UNKNOWN if e["algebraic_rank"] is None else e["algebraic_rank"],
            e["parameters"] - e["rank"],
            "full rank" if e["singular_gap"] is None else h.number(e["singular_gap"], 2),
        )
        for e in result.identifiable
    ]
    caption = (
        "What measurements can show: rank of the observation matrix over 200 random postures inside the limits, at this cell's load "
        "point and reference points. Unknowns beyond the rank are determined in combination only, however much is measured. The gap is "
        "the drop between the smallest singular value that counts and the largest that does not: 1e6 and more is unmistakable. The rank by "
        "algebra uses no posture: unknowns of the links less the matrices that turning (or sliding) a joint leaves unchanged, which its two "
        "links share; it supposes three reference points that are not on one line."
    )
    header = ("template", "load", "unknowns", "rank", "rank by algebra", "never separable", "singular-value gap")
    special = [
        f"{e['template']}, {kinds.get(e['load'], e['load'])}: less than other points would show. {e['special_points']}"
        for e in result.identifiable
        if e["special_points"]
    ]
    return h.join(h.table(header, rows, caption=caption, align="llrrrrr"), h.bullets(special) if special else "")


def _load(cell: Any) -> h.Markup:
    def vector(v: Any) -> str:
        return ", ".join(f"{x:g}" for x in v)

    rows = [
        ("gravity, world", f"{vector(cell.gravity_m_per_s2)} m/s²"),
        (
            "tool mass, centre of mass (flange frame)",
            f"{cell.tool.mass_kg:g} kg at {vector(cell.tool.center_of_mass_m)} m",
        ),
        ("tool centre point (flange frame)", f"{vector(cell.tool.tcp.position_m)} m"),
        ("load point (flange frame)", f"{vector(cell.load_point_m)} m"),
        *((f"reference point {name} (flange frame)", f"{vector(p)} m") for name, p in cell.reference_points_m.items()),
    ]
    return h.section("Tool, load and reference points", h.table(("what", "value"), rows))


def _conventions(result: Inspection) -> h.Markup:
    lines = result.to_dict()["conventions"]
    return h.section("Conventions", h.bullets(line[0].upper() + line[1:] + "." for line in lines))


def _code(text: str) -> h.Markup:
    return h.join(h.Markup('<span class="mono">'), text, h.Markup("</span>"))
