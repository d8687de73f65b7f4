"""A plan as a KUKA KRL program: drives the postures, stops at every load step, names experiment, step and load.

Plain KRL that runs on every controller since KR C1 (no option package, no message library): the message is a character
array that can be shown on the pendant, and the same words stand as comments where the program pointer rests. All of
it is ASCII. The motions are point to point between axis angles, so they need no base and no tool frame; the
controller's load data decide how far it lets the arm sag, which is why they head the list of what must be checked.
"""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm
from drake_stiffness.campaign import Measurements
from drake_stiffness.errors import InputError
from drake_stiffness.rotations import Array
from drake_stiffness.shop.axis_words import AxisWord, default_words, word_values
from drake_stiffness.shop.load_words import NO_LOAD, load_words
from drake_stiffness.shop.visiting_order import postures

# KUKA: names have at most 24 characters, letters, digits and underscores, a letter first.
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,23}")
_MESSAGE_LENGTH = 80
# Long enough for the arm to stop swinging, and a stop of the advance run, so that messages are not ahead of the motion.
_SETTLE_S = 2.0


@dataclass(frozen=True)
class ProgramOptions:
    """How a program drives.

    Attributes
    ----------
    speed_percent : float
        Of the axes' largest speeds, 1 .. 50.
    tool_number : int or None
        Entry of TOOL_DATA and LOAD_DATA to switch on; None leaves it to the operator.
    via : (n,) or None
        Posture to pass between experiments, rad or m.
    """

    speed_percent: int = 10
    tool_number: int | None = None
    via: Array | None = None


def plan_program(
    m: Measurements,
    arm: Arm,
    name: str,
    order: NDArray[np.int_] | None = None,
    words: tuple[AxisWord, ...] | None = None,
    options: ProgramOptions | None = None,
) -> bytes:
    """The KRL source.

    Parameters
    ----------
    m : Measurements
        A plan: postures and loads.
    name : str
        Of the program, as DEF says it; the file must be called `name.src`.
    order : (experiments,), optional
        From `visiting_order`; default as planned.
    words : tuple of AxisWord, optional
        Which word drives which joint; default `default_words`.

    Raises
    ------
    InputError
        If the name is none a controller takes.
    """
    options = options or ProgramOptions()
    check_name(name)
    if not 1 <= options.speed_percent <= 50:
        raise InputError(
            f"speed: found {options.speed_percent} %; expected 1 to 50 % of the axes' speeds for a first run of "
            "untried motions."
        )
    words = words or default_words(arm)
    order = np.arange(len(m.experiments)) if order is None else order
    q = postures(m)
    text = word_values(q, words, arm)
    lines = [*_header(name, options), *_checks(m, arm, words, options)]
    via = None if options.via is None else _target(words, word_values(options.via[None], words, arm)[0])
    for place, e in enumerate(order.tolist(), start=1):
        experiment = ascii_text(m.experiments[e])
        lines += ["", f"; ---- {place} of {order.size}: experiment {experiment}"]
        if via is not None:
            lines += ["; safe posture", via]
        lines += [_target(words, text[e]), f"WAIT SEC {_SETTLE_S:.1f}"]
        loaded = False
        for case in np.flatnonzero(m.cases.experiment == e):
            load = load_words(m.cases.wrench[:, case], arm.gravity)
            loaded = load != NO_LOAD
            what = "put the load on, read, start" if loaded else "no load on, read, start"
            lines += _stop(f"{experiment} step {int(m.cases.step[case])}", load, what)
        if loaded:
            lines += _stop(experiment, "take the load off", "then start: the arm moves")
    if via is not None:
        lines += ["", "; safe posture", via]
    lines += ["", *_stop("plan", "all experiments done", "end"), "END"]
    return ("\r\n".join(lines) + "\r\n").encode("ascii")


def _stop(where: str, what: str, then: str) -> list[str]:
    """A stop: the message for the pendant, and the same words where the program pointer rests."""
    text = f"{where}: {what}"
    if len(text) > _MESSAGE_LENGTH:  # a name without end; step and load must stay readable
        text = f"{where[: max(_MESSAGE_LENGTH - len(what) - 5, 8)]}...: {what}"[:_MESSAGE_LENGTH]
    return [f'DS_TEXT[]="{text}"', f"HALT ; {text}; {then}"]


def check_name(name: str) -> None:
    """Raise InputError for a program name that a controller refuses."""
    if not _NAME.fullmatch(name):
        raise InputError(
            f"program name '{name}': a KRL program has a name of 1 to 24 letters, digits and underscores, a letter "
            "first (the file is called like the program); rename the file."
        )


def ascii_text(text: str) -> str:
    """A name in printable ASCII without quotes: accents dropped, what has no ASCII letter becomes '?'."""
    plain = unicodedata.normalize("NFKD", text)
    plain = "".join(c for c in plain if not unicodedata.combining(c))
    return "".join("'" if c == '"' else c if " " <= c <= "~" else "?" for c in plain)


def _header(name: str, options: ProgramOptions) -> list[str]:
    lines = [
        "&ACCESS RVP",
        "&REL 1",
        f"DEF {name}( )",
        f"DECL CHAR DS_TEXT[{_MESSAGE_LENGTH}]",
        ";FOLD INI",
        "  ;FOLD BASISTECH INI",
        "    GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )",
        "    INTERRUPT ON 3",
        "    BAS (#INITMOV,0 )",
        "  ;ENDFOLD (BASISTECH INI)",
        ";ENDFOLD (INI)",
        f"BAS (#VEL_PTP,{options.speed_percent})",
        "BAS (#ACC_PTP,20)",
    ]
    return lines if options.tool_number is None else [*lines, f"BAS (#TOOL,{options.tool_number})"]


def _checks(m: Measurements, arm: Arm, words: tuple[AxisWord, ...], options: ProgramOptions) -> list[str]:
    """What a person must check before the start button, as comments at the top."""
    centre = ", ".join(f"{1e3 * c:.1f}" for c in arm.p_ETool)
    table = ", ".join(
        f"{w.word}={'-' if w.sign < 0 else ''}{ascii_text(arm.joint_names[w.joint])}"
        + (f"{w.offset:+g}" if w.offset else "")
        for w in words
    )
    way = "straight from posture to posture" if options.via is None else "over the safe posture"
    load = (
        f"TOOL_DATA[{options.tool_number}] and LOAD_DATA[{options.tool_number}] are switched on here and must hold"
        if options.tool_number is not None
        else "The load data that are switched on must hold"
    )
    return [
        "; Measuring program: drives the postures of a plan, stops at every load step.",
        f"; {len(m.experiments)} experiments, {m.cases.number} steps. At every HALT: apply the load, read all points,",
        "; then press start. DS_TEXT[] names experiment, step and load (monitor: variable, single).",
        "; CHECK BEFORE THE FIRST RUN, in T1:",
        f"; 1. {load} the tool of the cell file:",
        f";    {arm.tool_mass_kg:.2f} kg, centre of mass {centre} mm in the flange frame, without the test load.",
        f"; 2. Nothing stands in the way: motions go {way} (PTP, paths of the tip are curved),",
        ";    and nobody has checked them for collisions. Weights must not swing or touch: take them off to drive.",
        f"; 3. Joints: {table}; signs and zeros as in the robot model.",
        "; 4. Mastering, brakes released while reading or not: the same for all steps, and noted.",
    ]


def _target(words: tuple[AxisWord, ...], values: Array) -> str:
    """One point-to-point motion to axis angles; all words are written, nothing is left from the motion before."""
    kind = "E6AXIS: " if any(w.word.startswith("E") for w in words) else ""
    return "PTP {" + kind + ", ".join(f"{w.word} {printed(v)}" for w, v in zip(words, values, strict=True)) + "}"


def printed(value: float) -> str:
    """A number with up to six decimals, at least one, and no negative zero."""
    text = f"{value:.6f}".rstrip("0")
    text = text + "0" if text.endswith(".") else text
    return "0.0" if text == "-0.0" else text
