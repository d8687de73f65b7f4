"""Promises of a rewritten RAPID module over generated ones."""

import numpy as np
from contract import holds_contract
from hypothesis import given, settings
from hypothesis import strategies as st

from toolpaths.formats.rapid import Rapid
from toolpaths.rewriting import rewrite

T1 = "[[1,2,3],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
TAIL = ",v100,z1,tMill\\WObj:=block;"

blank = st.sampled_from(["", "", " ", "  ", "\t", "\r\n  "])
filler = st.sampled_from(
    [
        'TPWrite "MoveL p1,v1,z1,t; ! x";',
        "! caf\xe9 MoveL p1;",
        "",
        "SetDO do1,1;",
        "ENDIF",
        "FOR i FROM 1 TO 3 DO",
        "lab:",
        "sub 3;",
        "MoveL Offs(q,0,0,1),v1,z1,t;",
    ]
)


@st.composite
def number(draw, largest=999):
    decimals = draw(st.integers(0, 5))
    text = draw(st.sampled_from(["", "-", "+"])) + str(draw(st.integers(0, largest)))
    text += "." + str(draw(st.integers(0, 10**decimals - 1))).zfill(decimals) if decimals else ""
    return text + draw(st.sampled_from(["", "", "", "E-1", "e+0"]))


@st.composite
def programs(draw):
    text, movable, count = draw(st.sampled_from(["", "%%%\n VERSION:1\n%%%\n", "MODULE m\r\n"])), [], 0

    def target(force):
        nonlocal text
        text += "["
        for size in (3, 4):
            text += "[" + draw(blank)
            for place in range(size):
                token = draw(number(999 if size == 3 else 1)) if place or size == 3 else "0.5"
                movable.extend([(len(text), len(text) + len(token))] if force else [])
                text += token + draw(blank) + ("," + draw(blank) if place < size - 1 else "")
            text += "],"
        text += draw(st.sampled_from(["[0,0,0,0],", "[-1, 0,-1,3] ,", "[1,-2,0,8],"]))
        text += draw(st.sampled_from(["[9E9,9E9,9E9,9E9,9E9,9E9]", "[12.5,9E+09,9E9,0,9E9,9E9]"])) + draw(blank) + "]"

    for _ in range(draw(st.integers(1, 6))):
        what = draw(st.sampled_from(["MoveL", "movel", "MoveJ", "MoveC", "declared", "filler"]))
        tail = draw(
            st.sampled_from(
                [
                    ",v100,z1,t\\WObj:=w;",
                    " , v100 , fine , t \\WObj:=w ; ! MoveL",
                    "\\ID:=7,v5\\V:=9,z1\\Inpos:=i,t\\WObj:=w;",
                ]
            )
        )
        if what == "filler":
            text += draw(filler)
        elif what == "declared":
            count += 1
            text += f"CONST robtarget p{count}:="
            target(True)
            text += f";{draw(blank)}\nMoveL p{count}{tail}"
        else:
            text += what + " "
            for leg in range(2 if what == "MoveC" else 1):
                text += "," if leg else ""
                target(what != "MoveJ")
            text += tail
        text += draw(st.sampled_from(["\n", "\r\n"]))
    text += "" if movable else f"MoveJ {T1},v1,z1,t\\WObj:=w;"
    return text.rstrip("\r\n") if draw(st.booleans()) else text + draw(st.sampled_from(["", "\0\0\0"])), movable


@settings(max_examples=25, deadline=None)
@given(programs(), st.integers(0, 2**32 - 1))
def test_generated_programs_keep_every_byte_that_is_no_number_of_a_pose(generated, seed):
    text, movable = generated
    program, _ = holds_contract(Rapid(), text.encode("latin-1"), movable, seed)
    spans = {tuple(span) for row in np.flatnonzero(program.carries_force) for span in program.span[row].tolist()}
    assert spans == set(movable)


@settings(max_examples=25, deadline=None)
@given(st.binary(max_size=40), st.integers(0, 10**6), programs())
def test_damaged_bytes_never_crash_the_reader(noise, where, generated):
    raw = generated[0].encode("latin-1")
    at = where % (len(raw) + 1)
    damaged = f"MoveJ {T1}{TAIL}\n".encode() + raw[:at] + noise + raw[at + len(noise) // 2 :]
    program = Rapid().parse(damaged, "damaged.mod")
    out = rewrite(program, program.position_mm + 0.3, program.orientation, np.ones(len(program), bool))
    assert out.raw.count(b"\n") == damaged.count(b"\n")
