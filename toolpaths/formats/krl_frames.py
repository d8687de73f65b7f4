"""Base and tool along a KRL program: set by statements, by the data of inline forms, or by one segment for itself."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

from toolpaths.formats.krl_points import FrameData
from toolpaths.formats.krl_statements import frame_data_name, frame_setting, frames_by_data, frames_with, stored_frame
from toolpaths.formats.krl_words import shown
from toolpaths.program import FrameSetting, Refusal

# Name of the present data of inline forms, and what the program has written into the controller's table of frames.
Told = tuple[str | None, tuple[tuple[tuple[str, str | None], tuple[float, ...] | None], ...]]
_STANDING = "the tool stands still (#TCP) and the arm carries the part, so poses mean something else"


class Frames:
    """The settings of base and tool so far.

    Attributes
    ----------
    settings
        Every change of base or tool.
    borrowed
        Whether the last motion had frames of its own (``SLIN .. WITH $BASE = ..``).
    """

    def __init__(self, data: Callable[[str], FrameData | None]) -> None:
        self.settings: list[FrameSetting] = []
        self.refusals: list[Refusal] = []
        self.borrowed = False
        self._data = data
        self._name: str | None = None
        self._table: dict[tuple[str, str | None], tuple[float, ...] | None] = {}
        self._last: dict[str, FrameSetting] = {}
        self._lasting: dict[str, FrameSetting] = {}

    def take_over(self, lasting: tuple[FrameSetting, ...], told: Told) -> None:
        """Go on with the frames of the piece before."""
        self.settings = list(lasting)
        self._lasting = {setting.what: setting for setting in lasting}
        self._last = dict(self._lasting)
        self._name, table = told
        self._table = dict(table)

    def hand_on(self) -> tuple[tuple[FrameSetting, ...], Told]:
        """What the next piece takes over."""
        return tuple(self._lasting.values()), (self._name, tuple(self._table.items()))

    def read(self, raw: bytes, start: int, end: int, line: int) -> str | None:
        """What a statement changes, if it is about frames: "base" or "tool"."""
        code = raw[start:end]
        name = frame_data_name(code)
        if name is not None:
            self._name = name
            return None
        if frames_by_data(code):
            changed = None
            for setting in self._from_data(self._name, line, shown(raw, start, end)):
                self._lasting[setting.what] = setting
                changed = self._put(setting) or changed
            return changed
        stored = stored_frame(raw, start, end)
        if stored is not None:
            self._table[stored[:2]] = stored[2]
            return None
        plain = frame_setting(raw, start, end, line)
        if plain is None:
            return None
        plain = self._looked_up(plain)
        self._lasting[plain.what] = plain
        self._put(plain, always=True)
        return plain.what

    def borrow(self, clause: bytes, line: int) -> str | None:
        """Frames that a segment sets for itself after WITH; the reason where they are not known."""
        found = frames_with(clause)
        self.give_back(line)
        for what, name, text in found:
            if what == "ipo_mode" and (name or text.upper().startswith("#BASE")):
                continue
            if not name:
                return f"{what} set for this motion alone ({text[:40]})"
        names = {name for _, name, _ in found if name}
        for name in sorted(names):
            for setting in self._from_data(name, line, f"WITH frames of {name}"):
                self.borrowed = True
                self._put(setting)
        return None

    def give_back(self, line: int) -> None:
        """The frames that last, after a motion that had its own."""
        if not self.borrowed:
            return
        self.borrowed = False
        for lasting in self._lasting.values():
            self._put(FrameSetting(**{**vars(lasting), "line": line}))

    def _from_data(self, name: str | None, line: int, text: str) -> list[FrameSetting]:
        data = self._data(name) if name else None
        if data is None:
            key = f"FDAT {(name or 'FDAT_ACT').upper()}"
            return [FrameSetting(line, what, "controller", None, text, key=key) for what in ("base", "tool")]
        if data.stands:
            self.refusals.append(Refusal(line, f"found {name}: {_STANDING}", carries_force=False, fatal=True))
        text = f"{text} ({name}: tool {data.tool}, base {data.base})"
        return [
            self._looked_up(FrameSetting(line, what, "controller", None, text, key=number))
            for what, number in (("base", data.base), ("tool", data.tool))
        ]

    def _looked_up(self, setting: FrameSetting) -> FrameSetting:
        """A frame of the controller's table with the numbers that the program itself has written there."""
        number = _number(setting)
        if setting.origin != "controller" or not {(setting.what, number), (setting.what, None)} & self._table.keys():
            return setting
        pose = None if (setting.what, None) in self._table else self._table.get((setting.what, number))
        return replace(setting, origin="expression" if pose is None else "literal", pose=pose, key=None)

    def _put(self, setting: FrameSetting, *, always: bool = False) -> str | None:
        before = self._last.get(setting.what)
        if not always and before is not None and _same(before, setting):
            return None
        self._last[setting.what] = setting
        self.settings.append(setting)
        return setting.what


def _same(one: FrameSetting, two: FrameSetting) -> bool:
    if one.origin != two.origin:
        return False
    if one.origin == "literal":
        return one.pose == two.pose
    return one.origin == "controller" and _number(one) == _number(two)


def _number(setting: FrameSetting) -> str:
    if setting.key is not None:
        return setting.key
    numbers = re.findall(r"\d+", setting.text)
    return numbers[-1] if numbers else setting.text
