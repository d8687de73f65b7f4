"""The small pieces of URScript: poses, calls, assignments, and what leaves the arm where it is."""

from __future__ import annotations

import re

from toolpaths.formats.reading import NUMBER

COMMENT_OR_STRING = re.compile(rb'"[^"\r\n]*"?|#[^\r\n]*')
NAME = rb"[A-Za-z_]\w*"
_N = rb"\s*(" + NUMBER + rb")\s*"
POSE = re.compile(rb"p\s*\[" + rb",".join([_N] * 6) + rb"\]")
# What nearly all lines of a program look like.
ORDINARY = re.compile(rb"[ \t]*(move[lpj])[ \t]*\([ \t]*" + POSE.pattern + rb"([^()\[\]\r\n]*)\)[ \t]*\r*(?:\n|\Z)")
ASSIGNED = re.compile(rb"\s*(?:(?:global|local)\s+)?(%s)\s*(\[[^\]]*\])?\s*([-+*/]?=)(?!=)\s*" % NAME)
CALL = re.compile(
    rb"(?<![\w.])(move[lpcj]|moves|servo[cjl]|speed[jl]|force_mode|freedrive_mode|path_offset_\w+|conveyor_\w+|track_conveyor_\w+|set_tcp)\s*\("
)
POSE_TRANS = re.compile(rb"pose_trans\s*\(")
BLOCK = re.compile(
    rb"\s*(?:def|sec|thread|end|while|if|elif|else|for|return|break|continue|run|kill|join|switch|case|default|enter_critical|exit_critical)\b"
)
STILL = re.compile(
    rb"\s*(?:(?:global|local)\s+)?(?:%s\s*(?:\[[^\]]*\])?\s*[-+*/]?=\s*)?(?:[^(]*\Z|(?:set_|get_|textmsg|sleep|popup|sync|write_|read_|rtde_|modbus_|socket_|halt|stop[lj]"
    rb"|zero_|pose_|interpolate_|is_|to_|str_|sqrt|sin|cos|d2r|r2d)\w*\s*\()" % NAME
)
IDENTIFIER = re.compile(rb"(?<![\w.])[A-Za-z_]\w*")
KEYWORD = re.compile(rb"(%s)\s*=(?!=)\s*" % NAME)
NUMBER_ALONE = re.compile(NUMBER)
BRACKET = re.compile(rb"[\[\](){}\n]")
RECOGNISED = re.compile(
    rb"^(?:\xef\xbb\xbf)?[ \t]*(?:(?:def|thread)[ \t]+\w+[ \t]*\([^\r\n]{0,2000}\)[ \t]*:[ \t]*(?:#[^\r\n]*)?\r*$"
    rb"|(?:move[lpcj]|servoj|set_tcp|speed[lj])[ \t]*\()",
    re.MULTILINE,
)
