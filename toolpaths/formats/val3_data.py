"""Staubli VAL3 data files ``.dtx``: points, frames and tools with the byte spans of their numbers; speeds."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

import numpy as np

from toolpaths.conventions import STAUBLI
from toolpaths.formats.reading import NUMBER, Status, Target
from toolpaths.program import NO_STATUS

WORDS = (b"x", b"y", b"z", b"rx", b"ry", b"rz")
DATA_FILE = re.compile(rb"<Database\b[^>]*VAL3/Data|<Data\s[^>]*xsi:type=")
_COMMENT = re.compile(rb"<!--.*?(?:-->|\Z)", re.DOTALL)
_DATA_TAG = re.compile(rb"<(/?)Data\b([^<>]*)>")
_VALUE = re.compile(rb"<Value\s([^<>]*?)/?>")
_ATTRIBUTE = re.compile(rb"([\w:]+)\s*=\s*\"([^\"]*)\"")
_NUMBER = re.compile(NUMBER)
_BITS = ((b"lefty", b"righty"), (b"epositive", b"enegative"), (b"wpositive", b"wnegative"))
# A speed limit that is none.
_UNLIMITED = 9999.0

Pose = tuple[float, ...]


class Data(NamedTuple):
    """What the data files hold, by element name such as ``p[0]``.

    Attributes
    ----------
    points
        Targets with their frame as ("base", name), or why an element is no literal pose.
    frames, tools
        X, Y, Z (mm), RX, RY, RZ (deg) and the element they are stated in; None where a number is not literal.
    feeds, blends
        Of motion descriptors: tool speed limit, mm/min; distance before the point at which the path is left, mm.
    """

    points: dict[bytes, Target | str]
    frames: dict[bytes, tuple[Pose, bytes] | None]
    tools: dict[bytes, tuple[Pose, bytes] | None]
    feeds: dict[bytes, float]
    blends: dict[bytes, float]


def read_data(files: list[tuple[int, bytes]]) -> Data:
    """Read data files, each with the offset at which its bytes count on."""
    data = Data({}, {}, {}, {}, {})
    for offset, raw in files:
        text = _COMMENT.sub(lambda found: b" " * len(found[0]), raw)
        about: dict[bytes, bytes] = {}
        start = 0
        for tag in _DATA_TAG.finditer(text):
            name, kind = about.get(b"name", b""), about.get(b"type", b"")
            if tag[1] and kind in (b"pointRx", b"frame", b"tool", b"mdesc"):
                for value in _VALUE.finditer(text, start, tag.start()):
                    _element(data, kind, name, value, offset)
            closed = tag[1] or tag[2].endswith(b"/")
            about, start = {} if closed else dict(_ATTRIBUTE.findall(tag[2])), tag.end()
    return data


def _element(data: Data, kind: bytes, name: bytes, value: re.Match[bytes], offset: int) -> None:
    fields = {found[1]: found for found in _ATTRIBUTE.finditer(value.string, *value.span(1))}
    key = fields.get(b"key")
    element = b"%s[%s]" % (name, key[2] if key is not None else b"0")
    if kind == b"mdesc":
        limit = _number(fields.get(b"tmax"))
        data.feeds[element] = limit * 60 if limit is not None and limit < _UNLIMITED else math.nan
        leave = _number(fields.get(b"leave"))
        off = b"blend" in fields and fields[b"blend"][2].lower() == b"off"
        data.blends[element] = 0.0 if off else math.nan if leave is None else leave
        return
    father = _element_name(fields[b"fatherId"][2]) if b"fatherId" in fields else b"world[0]"
    if kind == b"pointRx":
        again = element in data.points
        data.points[element] = "which is stored twice" if again else _point(element, fields, father, offset)
        return
    # A number that is not written is zero.
    numbers = [_number(fields[word]) if word in fields else 0.0 for word in WORDS]
    known = [number for number in numbers if number is not None]
    (data.frames if kind == b"frame" else data.tools)[element] = (
        (tuple(known), father) if len(known) == len(WORDS) else None
    )


def _point(element: bytes, fields: dict[bytes, re.Match[bytes]], father: bytes, offset: int) -> Target | str:
    missing = [word.decode() for word in WORDS if word not in fields]
    if missing:
        return f"whose {', '.join(missing)} {'is' if len(missing) == 1 else 'are'} not written (it counts as zero; write it)"
    wrong = [word.decode() for word in WORDS if _number(fields[word]) is None]
    if wrong:
        return f"whose {', '.join(wrong)} is no number"
    spans = tuple((fields[word].start(2) + offset, fields[word].end(2) + offset) for word in WORDS)
    tokens = tuple(fields[word][2] for word in WORDS)
    return Target(
        tokens,
        spans,
        status=_status(fields),
        point=element,
        frame=(("base", father.decode("ascii", "backslashreplace")),),
    )


def _status(fields: dict[bytes, re.Match[bytes]]) -> Status:
    shoulder, elbow, wrist = (
        names.index(fields[word][2]) if word in fields and fields[word][2] in names else -1
        for word, names in zip((b"shoulder", b"elbow", b"wrist"), _BITS, strict=True)
    )
    found = (shoulder, elbow, wrist)
    return found if found != NO_STATUS else NO_STATUS


def _number(found: re.Match[bytes] | None) -> float | None:
    return float(found[2]) if found is not None and _NUMBER.fullmatch(found[2]) is not None else None


def _element_name(name: bytes) -> bytes:
    return name if name.endswith(b"]") else name + b"[0]"


def in_root(frames: dict[bytes, tuple[Pose, bytes] | None], element: bytes, root: bytes) -> Pose | None:
    """X, Y, Z (mm) and RX, RY, RZ (deg) of a frame or tool in its root (``world[0]``, ``flange[0]``), None where not all is literal."""
    R, p = np.eye(3), np.zeros(3)
    for _ in range(20):
        if element == root:
            return (*p.tolist(), *STAUBLI.near(R[None], np.zeros((1, 3)))[0].tolist())
        found = frames.get(element)
        if found is None:
            return None
        pose, element = np.array(found[0]), found[1]
        turn = STAUBLI.rotation(pose[None, 3:])[0]
        R, p = turn @ R, turn @ p + pose[:3]
    return None
