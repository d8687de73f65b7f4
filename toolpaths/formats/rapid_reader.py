"""Goes through an ABB RAPID module statement by statement: moves, the points they go to, and what else uses those."""

from __future__ import annotations

import re

from toolpaths.conventions import QUATERNION
from toolpaths.formats import rapid_words as words
from toolpaths.formats.reading import Continued, NeedsWhole, Reading, Target, Unreadable, arguments, shown
from toolpaths.program import NO_STATUS


class Reader(Reading):
    """One module, on a copy of all modules of the program whose comments and strings are blanks.

    Parameters
    ----------
    raw, code
        All modules one after the other, as they are and as code alone.
    start, end
        Where this one stands.
    """

    # Speed and tool are looked up anew.
    MODAL = ("routine", "conf_off", "points", "speeds", "zones", "local", "frame_data", "assigned")

    def __init__(self, raw: bytes, code: bytes, start: int, end: int) -> None:
        super().__init__(raw, QUATERNION, start)
        self.code = code
        self.start, self.end = start, end
        self.outside: dict[bytes, Target | str] = {}
        self.local: set[bytes] = set()
        self.points: dict[tuple[bytes, bytes], Target | str] = {}
        self.frame_data: dict[bytes, words.Frame | None] = {}
        self.speeds: dict[bytes, float] = {}
        self.zones: dict[bytes, float] = {}
        self.assigned: set[bytes] = set()
        self.routine = b""
        self.conf_off = False
        self._conf: dict[bytes, tuple[int, int, int] | None] = {}
        self._axes: tuple[bytes, tuple[float, ...] | None] = (b"", None)
        self._tool = self._speed = self._zone = b""
        self.unusable: list[int] = []

    def read(self) -> None:
        code, at, size = self.code, self.start, self.end
        at += 3 if self.raw.startswith(b"\xef\xbb\xbf", at) else 0
        while at < size:
            match = words.MOVE_LITERAL.match(code, at, size)
            if match is not None:
                target = self.literal(match, 2, None)
                if target is not None:
                    self.to(match.start(1))
                    self.move(match, target, match[11], match[12], match[13])
                    at = match.end()
                    continue
            match = words.MOVE_NAMED.match(code, at, size)
            if match is not None:
                point = self.point(match[2])
                if isinstance(point, Target):
                    self.to(match.start(1))
                    self.move(match, point, match[3], match[4], match[5])
                    at = match.end()
                    continue
            match = words.DECLARED.match(code, at, size)
            if match is not None:
                self.to(match.start(1))
                self.note_local(match.start(), match.start(1), match[1])
                self.declare(match[1], self.literal(match, 2, self.key(match[1])) or "whose robtarget is not literal")
                at = match.end()
                continue
            match = words.BLOCK.match(code, at, size)
            if match is not None:
                self.routine = (match["routine"] or self.routine).upper()
                self.rows.forget()
                at = match.end()
                continue
            semicolon = code.find(b";", at, size)
            end = size if semicolon < 0 else semicolon
            self.statement(at, end)
            at = end + 1

    def called(self, point: object) -> tuple[object, ...]:
        """The name without the routine it belongs to."""
        assert isinstance(point, tuple)
        return (point[1],)

    def key(self, name: bytes) -> tuple[bytes, bytes]:
        return self.routine, name.upper()

    def point(self, name: bytes) -> Target | str:
        """A declared point, or why there is none."""
        local = self.points.get(self.key(name))
        if local is None and self.routine:
            local = self.points.get((b"", name.upper()))
        if local is None:
            local = self.outside.get(name.upper())
        return (
            local
            if local is not None
            else (
                "which is not declared in this file before it is used (or give the module that declares it with --with FILE)"
            )
        )

    def note_local(self, start: int, name_at: int, name: bytes) -> None:
        """A name that other modules do not see."""
        if b"LOCAL" in self.code[start:name_at].upper().split():
            self.local.add(name.upper())

    def declare(self, name: bytes, what: Target | str) -> None:
        key = self.key(name)
        self.points[key] = f"which is declared twice (again in line {self.line})" if key in self.points else what

    def literal(self, match: re.Match[bytes], first: int, point: object) -> Target | None:
        """Target of a match whose groups from `first` on are a robtarget."""
        groups = match.groups()
        conf, axes = groups[first + 6], groups[first + 7]
        if conf not in self._conf:
            if len(self._conf) > 1000:
                self._conf.clear()
            self._conf[conf] = words.status(conf)
        bits = self._conf[conf]
        if axes != self._axes[0]:
            self._axes = axes, words.externals(axes)
        external = self._axes[1]
        if bits is None or external is None:
            return None
        return Target(groups[first - 1 : first + 6], match.regs[first : first + 7], external, bits, point)

    def move(self, match: re.Match[bytes], target: Target, speed: bytes, zone: bytes, tool: bytes) -> None:
        """An ordinary linear or joint move."""
        self.has_motion = True
        kind = match[1].upper().decode()
        if tool != self._tool:
            self.use(tool, match.start(1))
        if speed != self._speed:
            self._speed, self.rows.feed_mm_per_min = speed, words.feed(speed, self.speeds)
        if zone != self._zone:
            self._zone, self.rows.blend_mm = zone, words.blend(zone, self.zones)
        self.go(kind, "point", target, force=kind == "MOVEL")

    def go(self, kind: str, role: str, target: Target, *, force: bool) -> None:
        if force and self.conf_off and target.status != NO_STATUS:
            target = target._replace(status=NO_STATUS)
        self.add(kind, role, target, force=force)
        if not any(self.rows.values[3:7]):
            self.unusable.append(len(self.rows) - 1)
            self.refuse(target.spans[3][0], "a quaternion of length zero", force=force, row=len(self.rows) - 1)

    def statement(self, start: int, end: int) -> None:
        """Any statement up to its semicolon that is no ordinary move."""
        code = self.code
        text = code[start:end].strip()
        if not text:
            return
        self.to(start + len(code[start:end]) - len(code[start:end].lstrip()))
        declared = words.DECLARATION.match(code, start, end)
        if declared is not None:
            self.declaration(declared, end)
            return
        if words.OTHER_DECLARATION.match(code, start, end) is not None:
            self.mention(self.names(start, end), shown(self.raw, start, end))
            return
        motion = words.MOTION.search(code, start, end)
        if motion is not None:
            before = code[start : motion.start()].strip()
            self.to(motion.start())
            self.has_motion = True
            if before:
                self.mention(self.names(start, motion.start()), shown(self.raw, start, end))
            try:
                self.motion(motion, end)
            except Unreadable as error:
                self.mention(self.names(motion.end(), end), shown(self.raw, start, end))
                self.refuse(error.at, error.found, force=not words.by_joints(motion[1]))
            if before:
                self.rows.forget()
            return
        self.mention(self.names(start, end), shown(self.raw, start, end))
        assigned = words.ASSIGNED.match(code, start, end)
        if assigned is not None:
            self.assigned.add(assigned[1].upper())
        displaced = words.DISPLACED.match(code, start, end)
        if displaced is not None:
            what = f"{displaced[1].decode()}: the poses after it are displaced by amounts that are not in the moves"
            self.refuse(displaced.start(1), what, force=False, fatal=True)
        conf = words.CONF_OFF.match(code, start, end)
        if conf is not None:
            self.conf_off = conf[1].upper() == b"OFF"
        if words.STILL.match(code, start, end) is None:
            self.rows.forget()

    def names(self, start: int, end: int) -> list[object]:
        return [name.upper() for name in words.IDENTIFIER.findall(self.code, start, end)]

    def declaration(self, match: re.Match[bytes], end: int) -> None:
        """A robtarget that is not an ordinary literal, a tool, a work object, a speed."""
        kind, name, is_array = match[1].upper(), match[2], match[3] is not None
        self.note_local(match.start(), match.start(2), name)
        if is_array or kind == b"JOINTTARGET" or match[4] is None:
            if kind == b"ROBTARGET":
                self.declare(name, "which is an array" if is_array else "which gets its value while the program runs")
            self.mention(self.names(match.end(), end), shown(self.raw, match.start(), end))
        elif kind == b"ROBTARGET":
            self.declare(name, "whose robtarget is not literal")
            self.mention(self.names(match.end(), end), shown(self.raw, match.start(), end))
        elif kind == b"SPEEDDATA":
            self.speeds[name.upper()] = words.feed(self.code[match.end() : end].strip(), {})
        elif kind == b"ZONEDATA":
            self.zones[name.upper()] = words.blend(self.code[match.end() : end].strip(), {})
        else:
            self.frame_data[name.upper()] = words.literal_frame(kind, self.code, match.end(), end)

    def motion(self, match: re.Match[bytes], end: int) -> None:
        """A move that is no ordinary statement."""
        code, name = self.code, match[1].upper()
        family = next((f for f in words.TOOL_AT if name.startswith(f)), None)
        curve = name[len(family) :][:1] if family is not None else b""
        pieces = arguments(code, match.end(), end)
        pieces = [p for p in pieces if code[p[0] : p[1]].replace(b" ", b"").upper() != b"\\CONC"]
        if name.startswith((b"MOVEABSJ", b"MOVEEXTJ")):
            self.mention(self.names(match.end(), end), shown(self.raw, match.start(), end))
            self.rows.forget()
            return
        if family is None or curve not in (b"L", b"C", b"J"):
            raise Unreadable(
                match.start(), f"{match[1].decode()}: where this motion ends is not in its arguments alone"
            )
        arc = curve == b"C"
        tool_at = words.TOOL_AT[family] + arc
        if len(pieces) <= tool_at:
            raise Unreadable(
                match.start(), f"{match[1].decode()} with {len(pieces)} arguments, expected {tool_at + 1} or more"
            )
        targets = [self.target(*piece) for piece in pieces[: 1 + arc]]
        for piece in pieces[1 + arc :]:
            self.mention(self.names(*piece), shown(self.raw, match.start(), end))
        tool = code[slice(*pieces[tool_at])]
        if words.CORRECTED.search(tool) is not None:
            raise Unreadable(
                pieces[tool_at][0], "\\Corr: corrections from elsewhere are added to this motion while it runs"
            )
        self.use(tool, pieces[tool_at][0])
        self._speed = code[slice(*pieces[1 + arc])]
        self.rows.feed_mm_per_min = words.feed(self._speed, self.speeds)
        self._zone = code[slice(*pieces[tool_at - 1])]
        self.rows.blend_mm = words.blend(self._zone, self.zones)
        for role, target in zip(("via", "end") if arc else ("point",), targets, strict=True):
            self.go(match[1].upper().decode(), role, target, force=curve != b"J")

    def target(self, start: int, end: int) -> Target:
        """A target argument: a literal robtarget or a declared point, with no more than an ID behind it."""
        code = self.code
        cut = words.ID.search(code, start, end)
        stop = cut.start() if cut is not None else end
        text = code[start:stop].strip()
        match = words.ROBTARGET.fullmatch(code, start, start + len(text))
        if match is not None:
            found = self.literal(match, 1, None)
            if found is not None:
                return found
        what = repr(shown(self.raw, start, stop))
        if re.fullmatch(words.NAME, text) is not None:
            point = self.point(text)
            if isinstance(point, Target):
                return point
            raise Unreadable(start, f"the target {what}, {point}")
        if text == b"*":
            raise Unreadable(start, "the target *, whose numbers are not in the text")
        if text.startswith(b"["):
            raise Unreadable(
                start, f"{what}, not a literal robtarget [[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[six axes]]"
            )
        raise Unreadable(start, f"the target {what}, which is computed while the program runs" if text else "no target")

    def use(self, tool: bytes, at: int) -> None:
        r"""Tool and work object in force, from ``tool \WObj:=name``."""
        self._tool = tool
        name, work_object = words.tool_and_object(tool)
        used = (("tool", name, "tool0"), ("base", work_object, "wobj0"))
        for what, called, predefined in used:
            key = called.decode("ascii", "backslashreplace")
            frame = self.frame_data.get(called.upper())
            if frame is not None and frame.problem is not None:
                self.refuse(at, f"{key}, {frame.problem}", force=False, fatal=True)
            if key.lower() == predefined:
                means = "the bare flange" if what == "tool" else "the robot's world frame"
                said = "tool.tcp of the cell" if what == "tool" else "workpiece of process.yaml"
                warning = f"{predefined} on this controller is {means}; {said} is what was reckoned with: check that they are the same"
                if warning not in self.warnings:
                    self.warnings.append(warning)
            text = f"\\WObj:={key}" if what == "base" else key
            self.set_frame(what, key.upper(), text, frame.pose if frame is not None else None)

    def hand_on(self) -> Continued:
        """See `Reading`.

        Raises
        ------
        NeedsWhole
            A move along a path goes to a declared point, which other pieces may use too; or a tool or work object in use is
            assigned to.
        """
        used = {(setting.key or "").encode() for setting in self.frames}
        if self.goes_to_stored or used & self.assigned:
            raise NeedsWhole
        return super().hand_on()

    def settle(self) -> None:
        """What only the whole program shows: arcs with an unusable pose; tools and work objects that are assigned to."""
        for row in self.unusable:
            self.rows.refuse(row)
        self.compute_frames(self.assigned)
