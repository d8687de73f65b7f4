"""A plan as a sheet of paper: what to hang at which posture, a box to tick, room to write. Self-contained HTML."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm
from drake_stiffness.campaign import Measurements
from drake_stiffness.report.page import Markup, join
from drake_stiffness.rotations import Array
from drake_stiffness.shop.axis_words import AxisWord, default_words, word_values
from drake_stiffness.shop.load_words import direction_words, kilograms, size_words
from drake_stiffness.shop.visiting_order import postures

# A4 upright. The head of the table comes again on every sheet; an experiment is not torn apart.
_STYLE = """
@page { size: A4 portrait; margin: 12mm 11mm 14mm; @bottom-right { content: counter(page) " / " counter(pages);
  font: 8pt Arial, sans-serif; } }
* { box-sizing: border-box; }
body { font: 9.5pt/1.3 "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; color: #000; max-width: 188mm;
  margin: 6mm auto; }
h1 { font-size: 15pt; margin: 0 0 1mm; overflow-wrap: anywhere; }
p { margin: 1mm 0; } .soft { color: #444; }
.head { display: grid; grid-template-columns: repeat(4, 1fr); gap: 2mm 5mm; margin: 4mm 0 3mm; }
.head div { border-bottom: .3mm solid #000; height: 8mm; font-size: 8pt; color: #444; }
table { border-collapse: collapse; width: 100%; table-layout: fixed; font-variant-numeric: tabular-nums; }
thead { display: table-header-group; } tbody { break-inside: avoid; }
th { text-align: left; font-size: 8pt; border-bottom: .4mm solid #000; padding: 1mm; vertical-align: bottom; }
td { border-bottom: .15mm solid #888; padding: 1mm; height: 7.5mm; vertical-align: middle; overflow-wrap: anywhere; }
td.posture { background: #eee; border-top: .4mm solid #000; height: auto; print-color-adjust: exact;
  -webkit-print-color-adjust: exact; }
.posture b { font-size: 10.5pt; margin-right: 3mm; } .posture span { white-space: nowrap; margin-right: 2.5mm; }
.right { text-align: right; } .step { width: 10mm; } .force { width: 20mm; } .mass { width: 19mm; }
.tick { width: 9mm; } .time { width: 19mm; } .warm { width: 15mm; } .none { color: #444; } .way { width: 48mm; }
td:nth-child(n + 5) { border-left: .15mm solid #bbb; }
.box { display: inline-block; width: 4.5mm; height: 4.5mm; border: .3mm solid #000; vertical-align: middle; }
@media print { body { margin: 0; max-width: none; } }
"""
_WRITTEN = ("Date", "Operator", "Tracker, force sensor", "Room temperature, start / end")
_COLUMNS = (
    ("step", "step"),
    ("force", "load, N"),
    ("mass", "hang, kg"),
    ("way", "direction (world axes)"),
    ("tick", "done"),
    ("time", "time"),
    ("warm", "temp. °C"),
    ("", "remarks"),
)


def load_sheet(
    m: Measurements,
    arm: Arm,
    title: str,
    order: NDArray[np.int_] | None = None,
    words: tuple[AxisWord, ...] | None = None,
) -> str:
    """The page as text.

    Parameters
    ----------
    m : Measurements
        A plan: postures and loads.
    order : (experiments,), optional
        From `visiting_order`, the same as the robot program's; default as planned.
    words : tuple of AxisWord, optional
        Program words of the joints, so that the sheet shows what the pendant shows.
    """
    words = words or default_words(arm)
    order = np.arange(len(m.experiments)) if order is None else order
    shown = word_values(postures(m), words, arm)
    heaviest = float(np.linalg.norm(m.cases.wrench[:3], axis=0).max(initial=0.0))
    head = join(*(join(Markup("<div>"), what, Markup("</div>")) for what in _WRITTEN))
    names = join(*(join(Markup(f'<th class="{mark}">'), name, Markup("</th>")) for mark, name in _COLUMNS))
    bodies = [
        _experiment(m, arm, e, f"{place} of {order.size}", _posture(words, shown[e], arm))
        for place, e in enumerate(order.tolist(), start=1)
    ]
    facts = (
        f"{len(m.experiments)} experiments, {m.cases.number} steps, largest force {size_words(heaviest)} N "
        f"({kilograms(heaviest, arm.gravity)})."
    )
    return join(
        Markup('<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>'),
        title,
        Markup(f"</title><style>{_STYLE}</style></head>\n<body><h1>"),
        title,
        Markup('</h1>\n<p class="soft">'),
        facts,
        Markup("</p>\n<p>"),
        "At every stop of the program: hang the load, wait until nothing swings, read all points, tick the box. The "
        "load acts at the load point of the cell file, in the world's axes (those of the robot's base). Kilograms "
        "are what hangs for the force; the weight of arm and tool is no part of it, that of hooks and slings is.",
        Markup(f'</p>\n<div class="head">{head}</div>\n<table><thead><tr>{names}</tr></thead>\n'),
        *bodies,
        Markup("</table></body></html>\n"),
    )


def _posture(words: tuple[AxisWord, ...], values: Array, arm: Arm) -> Markup:
    """The axis values of an experiment, none of them broken at the end of a line."""
    units = [" mm" if arm.prismatic[w.joint] else "°" for w in words]
    cells = (f"{w.word} {v + 0.0:.2f}{unit}" for w, v, unit in zip(words, values, units, strict=True))
    return join(*(join(Markup("<span>"), cell, Markup("</span> ")) for cell in cells))


def _experiment(m: Measurements, arm: Arm, e: int, place: str, posture: Markup) -> Markup:
    """One experiment: its posture, then a row for every step."""
    rows: list[object] = [
        Markup(f'<tbody><tr><td class="posture" colspan="{len(_COLUMNS)}"><b>'),
        m.experiments[e],
        Markup("</b>"),
        posture,
        Markup('<span class="soft">'),
        f"({place})",
        Markup("</span></td></tr>\n"),
    ]
    for case in np.flatnonzero(m.cases.experiment == e):
        rows += _step(int(m.cases.step[case]), m.cases.wrench[:, case], arm.gravity, float(m.cases.time_s[case]))
    return join(*rows, Markup("</tbody>\n"))


def _step(step: int, wrench: Array, gravity: Array, time_s: float) -> list[object]:
    """A row: step, load in words, and room to write; a planned time stands where the time is written."""
    force, moment = float(np.linalg.norm(wrench[:3])), float(np.linalg.norm(wrench[3:]))
    way = direction_words(wrench[:3], gravity) if force > 0 else "no load"
    if moment > 0:
        turn = f"{size_words(moment)} N m about {direction_words(wrench[3:], np.zeros(3))}"
        way = f"{way}; {turn}" if force > 0 else turn
    mark = ' class="none"' if force == 0 and moment == 0 else ""
    planned = "" if math.isnan(time_s) else f"({time_s:.6g} s)"
    return [
        Markup(f"<tr><td>{step}</td><td class='right'>"),
        size_words(force),
        Markup("</td><td class='right'>"),
        kilograms(force, gravity).removesuffix(" kg") if force > 0 else "0",
        Markup(f"</td><td{mark}>"),
        way.replace(" deg ", "° "),
        Markup('</td><td><span class="box"></span></td><td class="soft">'),
        planned,
        Markup("</td><td></td><td></td></tr>\n"),
    ]
