"""Which word of a robot program drives which joint, and how its number relates to the model's joint position."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from drake_stiffness.arm import Arm
from drake_stiffness.errors import InputError
from drake_stiffness.rotations import Array

ROBOT_WORDS = tuple(f"A{n}" for n in range(1, 7))
EXTERNAL_WORDS = tuple(f"E{n}" for n in range(1, 7))
_OFFSET = re.compile(r"[+-]\d+(\.\d*)?|")


@dataclass(frozen=True)
class AxisWord:
    """A program word and its joint: word = sign * joint + offset, in deg (revolute) or mm (prismatic)."""

    word: str
    joint: int
    sign: int = 1
    offset: float = 0.0


def default_words(arm: Arm) -> tuple[AxisWord, ...]:
    """Revolute joints are A1 .. A6 in the order of the chain; prismatic ones and what is left over are E1, E2, ...

    Raises
    ------
    InputError
        If there are more than twelve joints.
    """
    axes = [j for j in range(arm.num_joints) if not arm.prismatic[j]][: len(ROBOT_WORDS)]
    others = [j for j in range(arm.num_joints) if j not in axes]
    if len(others) > len(EXTERNAL_WORDS):
        raise InputError(
            f"the arm has {arm.num_joints} joints; a KRL program drives A1 .. A6 and E1 .. E6, twelve at most."
        )
    robot = [AxisWord(word, joint) for word, joint in zip(ROBOT_WORDS, axes, strict=False)]
    return (*robot, *(AxisWord(word, joint) for word, joint in zip(EXTERNAL_WORDS, others, strict=False)))


def read_words(texts: Iterable[str], arm: Arm) -> tuple[AxisWord, ...]:
    """Words as a user writes them, `A2=joint_2`, `A1=-joint_1`, `A2=joint_2-90` (deg or mm), over the default ones.

    Raises
    ------
    InputError
        If one is not of this form, names a joint the arm does not have, or a joint or a word is taken twice.
    """
    texts = list(texts)
    if not texts:
        return default_words(arm)
    given = [_read(text, arm) for text in texts]
    for what, taken in (("word", [w.word for w in given]), ("joint", [arm.joint_names[w.joint] for w in given])):
        for name in taken:
            if taken.count(name) > 1:
                raise InputError(f"--axis: the {what} '{name}' is given twice; keep one.")
    named, used = {w.joint for w in given}, {w.word for w in given}
    kept = [w for w in default_words(arm) if w.joint not in named]
    for word in kept:
        if word.word in used:
            raise InputError(
                f"--axis: '{word.word}' is given to another joint, but nothing says which word drives "
                f"'{arm.joint_names[word.joint]}' now; give every joint its word."
            )
    places = {word: place for place, word in enumerate((*ROBOT_WORDS, *EXTERNAL_WORDS))}
    return tuple(sorted([*given, *kept], key=lambda w: places[w.word]))


def _read(text: str, arm: Arm) -> AxisWord:
    word, equals, right = (part.strip() for part in text.partition("="))
    word = word.upper()
    if not equals or word not in (*ROBOT_WORDS, *EXTERNAL_WORDS):
        raise InputError(
            f"--axis: found '{text}'; expected a word A1 .. A6 or E1 .. E6, '=' and a joint, like A2=joint_2, "
            "A1=-joint_1 or A2=joint_2-90 (offset in deg or mm)."
        )
    sign = -1 if right.startswith("-") else 1
    name = right.lstrip("+-")
    for joint in sorted(arm.joint_names, key=len, reverse=True):
        rest = name.removeprefix(joint).replace(" ", "")
        if name.startswith(joint) and _OFFSET.fullmatch(rest):
            return AxisWord(word, arm.joint_names.index(joint), sign, float(rest or 0.0))
    raise InputError(f"--axis: '{text}': no joint of that name; the arm has {', '.join(arm.joint_names)}.")


def word_values(q: Array, words: tuple[AxisWord, ...], arm: Arm) -> Array:
    """(E, words) what the words say for postures q (E, n), deg or mm."""
    unit = np.where(arm.prismatic, 1e3, 180 / np.pi)
    joints = [w.joint for w in words]
    sign, offset = np.array([w.sign for w in words]), np.array([w.offset for w in words])
    return (q * unit)[:, joints] * sign + offset
