"""Long programs of CAM systems in pieces: G-code, APT, RAPID, URScript and Fanuc listings are read, corrected and accounted for as in one."""

import pickle
import random
import re

import numpy as np
import pytest

from drake_stiffness.files import write_together
from toolpaths.formats import read_again, read_program
from toolpaths.formats.pieces import pieces
from toolpaths.formats.reading import NeedsWhole
from toolpaths.job import compensate
from toolpaths.long_programs import _Job, compensate_file

SIZE = 900
AXES = ("X", "Y", "Z")


def place(n):
    return f"X{220 + 2 * n}.000 Y{150 - n}.000 Z-5.000"


def milling(count=60, turn=""):
    """Three axes or, with `turn`, five: words left out, rapids, feeds, comments, a tool change, block numbers."""
    text = (
        "%\nO100 (part)\nG21 G90 G54\nT1 M6\nG0 X220. Y150. Z30. A5.0 C10.0\n"
        if turn
        else "G21 G54\nG0 X220. Y150. Z30.\n"
    )
    for n in range(count):
        words = place(n) + (f" A{5 + 0.01 * n:.4f} C{10 + 0.02 * n:.4f}" if turn else "")
        text += f"N{10 * n} G1 {words}\n"
        text += {
            7: "F800 (slower)\n",
            13: f"X{221 + 2 * n}.000 {words.split(maxsplit=1)[1]} F900\n",
            23: f"G0 Z30.\nG0 X250. Y100. Z30.{turn}\n",
            31: "M8\n(a comment with X1.0 in it)\n",
            43: "G54\n",
        }.get(n, "")
    return text + "M30\n%\n"


def cutter_location(count=60, axes=True):
    """Points with or without axes, rapids, feeds, and a record over two lines."""
    text = "PARTNO LONG\nUNITS/MM\nMULTAX\nFEDRAT/800,MMPM\n"
    for n in range(count):
        axis = f",0.0{n % 5}0000,0.000000,0.999000" if axes else ""
        text += f"GOTO/{220 + 2 * n}.0000,{150 - n}.0000,-5.0000{axis}\n"
        text += {
            9: f"RAPID\nGOTO/{220 + 2 * n}.0000,{150 - n}.0000,30.0000{axis}\nFEDRAT/900\n",
            19: f"GOTO/{221 + 2 * n}.0000,$\n{150 - n}.0000,-5.0000{axis}\n",
            33: "$$ a comment\nPPRINT/HALF\n",
        }.get(n, "")
    return text + "FINI\n"


def module(count=60, wobj=r" \WObj:=part"):
    """Literal targets, a joint move to a declared point and its like in between, speeds, signals, comments."""
    text = "MODULE Long\nCONST robtarget home:=[[900,0,900],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
    text += f"CONST speeddata cut:=[20,500,5000,1000];\nPROC main()\nConfL\\Off;\nMoveJ home,v200,fine,mill{wobj};\n"
    for n in range(count):
        pose = f"[[{220 + 2 * n}.00,{150 - n}.00,-5.00],[0.0173648,0.9848078,0.1736482,0.0{n % 5}]"
        move = f"MoveL {pose},[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],{{}},z1,mill{wobj};"
        text += move.format("v50") + "\n"
        text += {
            7: move.format("cut") + " ! slower\n",
            17: "SetDO spindle,1;\nWaitTime 1;\n",
            29: f"MoveJ home,v200,fine,mill{wobj};\n",
        }.get(n, "")
    return text + "ENDPROC\nENDMODULE\n"


def script(count=60):
    """Literal poses, a joint move to a named pose and its like in between, a speed by name, blocks, signals, comments."""
    text = "def long():\n  home = p[0.9,0,0.9,3.06,0.54,0]\n  speed = 0.05\n  movej(home, a=1, v=1)\n"
    for n in range(count):
        move = (
            f"  movel(p[{0.22 + 0.002 * n:.5f},{0.15 - 0.001 * n:.5f},-0.00500,3.06020,0.53960,0.0{n % 5}000],{{}})\n"
        )
        text += move.format(" a=1.2, v=speed, r=0.001")
        text += {
            7: '  speed = 0.03\n  set_digital_out(1, True) # movel(p[1,2,3,0,0,0])\n  popup("a ] in )")\n',
            17: "  while digital_in(3):\n    sleep(0.1)\n  end\n",
            29: "  movej(home, a=1, v=1)\n",
            3: "  plane = p[0,0,0.1,0,0,0]\n  plane = p[0,0,0.2,0,0,0]\n",
            37: move.format("1.2,0.04,0,0.002"),
            49: move.format("a=1").replace("p[", "pose_trans(plane, p[").replace("]", "])"),
            43: move.format("\n    a=1, v=0.02"),
        }.get(n, "")
    return text + "end\n"


def listing(count=60):
    """A point a motion, joint moves to a point that no other motion goes to, arcs, feeds, a frame set by number, remarks, calls."""
    moves, points = ["UFRAME_NUM=1"], []

    def point(n):
        place = f"X = {220 + 2 * n}.000 mm, Y = {150 - n}.000 mm, Z = -5.000 mm"
        turn = f"W = 170.000 deg, P = -6.000 deg, R = 0.{n % 5}00 deg"
        frames = "UF : F, UT : 2, CONFIG : 'N U T, 0, 0, 0'"
        points.append(f"P[{len(points) + 1}]{{\n   GP1:\n\t{frames},\n\t{place},\n\t{turn}\n}};")
        return f"P[{len(points)}]"

    for n in range(count):
        kind = "J" if n == 11 else f"C {point(n)}\n    :" if n == 19 else "A" if n == 41 else "L"
        option = {7: " ACC50", 23: " TB .5sec,CALL GRIP(1)"}.get(n, "")
        moves.append(f"{kind} {point(n + (n == 19))} 50mm/sec CNT10{option}")
        more = {5: "!remark L P[7] 9mm/sec", 29: "CALL SPINDLE(1)", 33: f"L P[{len(points)}] 60mm/sec FINE"}
        moves += [more[n]] if n in more else []
    moves.append("J P[12] 50% FINE")
    numbered = "".join(f"{n:4}:{move}    ;\n" for n, move in enumerate(moves, 1))
    return "/PROG  LONG\n/ATTR\nOWNER = MNEDITOR;\n/MN\n" + numbered + "/POS\n" + "\n".join(points) + "\n/END\n"


SOURCES = {
    "three.nc": (milling(), {}),
    "five.nc": (milling(turn=" A5.0 C10.0"), {"gcode": {"rotary": "AC"}}),
    "axes.cl": (cutter_location(), {}),
    "plain.cl": (cutter_location(axes=False), {}),
    "long.mod": (module(), {}),
    "long.script": (script(), {}),
    "long.ls": (listing(), {}),
}


@pytest.fixture(params=SOURCES)
def long_program(request, tmp_path):
    text, process = SOURCES[request.param]
    path = tmp_path / request.param
    path.write_text(text)
    return path, process


def test_pieces_hold_every_byte_and_every_row_once(long_program):
    path, _ = long_program
    whole, found = read_program(path), list(pieces(path, None, SIZE))
    assert len(found) > 2
    assert b"".join(piece.raw for piece in found) == path.read_bytes()
    own = [slice(bool(n), None) for n in range(len(found))]
    for name in (
        "line",
        "kind",
        "carries_force",
        "refused",
        "feed_mm_per_min",
        "blend_mm",
        "position_mm",
        "orientation",
        "follows",
    ):
        joined = np.concatenate([getattr(piece, name)[rows] for piece, rows in zip(found, own, strict=True)])
        np.testing.assert_array_equal(joined, getattr(whole, name), err_msg=name)
    assert list(dict.fromkeys(setting for piece in found for setting in piece.frames)) == list(whole.frames)


STRAY = {
    ".nc": [
        "G0 X1. Y2. Z3.",
        "G91",
        "G90",
        "G1 X300.",
        "G2 X250. Y100. Z-5. I1. J0.",
        "G55",
        "G41",
        "M6",
        "G81 Z1 R1",
        "G92 X0",
    ]
    + ["/G1 X1.", "(comment", "F77", "M98 P1", "O7", "G94", "G93", "#1=3", "G1 X#1", f"G1 {place(3)} A1. C2."],
    ".cl": [
        "RAPID",
        "GODLTA/1,0,0",
        "CYCLE/DRILL",
        "CYCLE/OFF",
        "TLAXIS/0,0,1",
        "MULTAX/OFF",
        "UNITS/INCH",
        "GOHOME",
        "$$ c",
    ]
    + [
        "REMARK text",
        "    GOTO/1,2,3",
        "FEDRAT/5,IPM",
        "CIRCLE/1,2,3,0,0,1,5",
        "GOTO/1,2,3",
        "CUTCOM/LEFT",
        "CUTCOM/OFF",
    ],
    ".mod": [
        "ConfL\\On;",
        "SetDO a,1;",
        "foo;",
        "MoveJ home,v200,fine,mill;",
        "MoveL Offs(home,1,2,3),v50,z1,mill;",
        "x:=5;",
    ]
    + [
        "IF a THEN",
        "ENDIF",
        "VAR num x;",
        "MoveC home,home,v5,z1,mill;",
        "ENDPROC",
        "PROC other()",
        's:="a;b";',
        "mill.x:=3;",
    ],
    ".script": [
        "movej(home, a=1)",
        "movej([0,0,0,0,0,0])",
        "if a:",
        "end",
        "home = p[1,2,3,0,0,0]",
        "speed = speed * 2",
        "movel(home, v=speed)",
        "movec(p[1,2,3,0,0,0], home, r=0.1)",
        "movel(pose_trans(home, p[0,0,0.1,0,0,0]), v=speed)",
        "foo()",
        "x = foo(",
        ")",
        "force_mode(home)",
        "set_tcp(p[0,0,0.1,0,0,0])",
        "sleep(1)",
        '"',
        "thread other():",
    ],
    ".ls": [
        "   1:L P[70] 50mm/sec FINE    ;",
        "   1:J P[99] 50% FINE    ;",
        "   1:J P[12] 50% FINE    ;",
        "   1:L P[30] 50mm/sec FINE Offset,PR[1]    ;",
        "   1:L PR[30] 50mm/sec FINE    ;",
        "   1:P[30]=LPOS    ;",
        "   1:L P[31] 50mm/sec CNT5 ; L P[32] 60mm/sec FINE ;",
        "   1:CALL X    ;",
        "   1:UFRAME_NUM=2    ;",
        "   1:UFRAME[1]=PR[2]    ;",
        "   1:!L P[3]    ;",
        "   1:L P[R[2]] 50mm/sec FINE    ;",
        "   1:C P[20]",
        "P[5]{\n   GP1:\n\tUF : 0, UT : 1,\n\tJ1= 0.0 deg\n};",
        "P[90]{",
        "};",
        "/END",
        "/POS",
        "/MN",
        ";",
    ],
}


@pytest.mark.parametrize("seed", range(5))
def test_damaged_programs_read_in_pieces_as_they_do_as_a_whole(long_program, seed):
    """Lines taken out, put in and spoilt; or the pieces depend on each other, which is said."""
    path, _ = long_program
    rng, lines = random.Random(seed), path.read_text().split("\n")
    for _ in range(rng.choice([1, 2, 4, 8])):
        at, what = rng.randrange(len(lines)), rng.random()
        if what < 0.5:
            lines.insert(at, rng.choice(STRAY[path.suffix]))
        elif what < 0.75:
            del lines[at]
        else:
            lines[at] = lines[at][:4] + rng.choice(" ;()XZG1.-,$") + lines[at][5:]
    path.write_text("\n".join(lines))
    try:
        found = list(pieces(path, None, SIZE))
    except NeedsWhole:
        return
    whole = read_program(path)
    own = [slice(bool(n), None) for n in range(len(found))]
    for name in ("line", "kind", "refused", "feed_mm_per_min", "position_mm", "orientation", "follows", "external"):
        joined = np.concatenate([getattr(piece, name)[rows] for piece, rows in zip(found, own, strict=True)])
        np.testing.assert_array_equal(joined, getattr(whole, name), err_msg=name)
    told = sorted((r.line, r.reason) for piece in found for r in (*piece.refusals, *piece.notes))
    assert told == sorted((r.line, r.reason) for r in (*whole.refusals, *whole.notes))


def test_another_process_reads_a_piece_again_as_it_is(long_program):
    path, _ = long_program
    for piece in pieces(path, None, SIZE):
        sent = pickle.loads(pickle.dumps(piece))
        again = read_again(sent, [sent.raw])
        for name in ("line", "kind", "position_mm", "orientation", "source", "span", "feed_mm_per_min"):
            np.testing.assert_array_equal(getattr(again, name), getattr(piece, name), err_msg=name)


def test_the_numbers_of_a_piece_are_in_its_own_bytes(long_program):
    path, _ = long_program
    for piece in pieces(path, None, SIZE):
        rows, words = np.nonzero(piece.written)
        tokens = [float(piece.raw[start:end]) for start, end in piece.span[rows, words]]
        np.testing.assert_allclose(tokens * piece.unit[words], piece.pose[rows, words], atol=1e-12)


def test_pieces_and_the_whole_give_the_same_bytes(long_program, model, tools):
    path, changes = long_program
    process, options = tools.process(**changes), {"keep_refused": True}
    whole = compensate(read_program(path), model, process, **options)
    out = path.with_name("out" + path.suffix)
    parts = compensate_file(path, model, process, size=SIZE, processes=1, output=out, **options)
    assert type(parts).__name__ == "LongCompensation"
    write_together(parts.files(out))
    assert out.read_bytes() == whole.raw != path.read_bytes()
    told, expected = parts.to_dict(), whole.to_dict()
    for key in ("corrected_points", "lines", "refused"):
        assert told[key] == expected[key], key
    assert told["evenness"]["kink_lines"] == expected["evenness"]["kink_lines"]
    assert told["residual_mm"]["max"] == pytest.approx(expected["residual_mm"]["max"], rel=1e-4)


def test_a_branch_that_was_guessed_wrongly_is_found_for_rotary_words_too(model, tools, tmp_path, monkeypatch):
    path, (text, changes) = tmp_path / "five.nc", SOURCES["five.nc"]
    path.write_text(text)
    process, options = tools.process(**changes), {"keep_refused": True}
    whole = compensate(read_program(path), model, process, **options)
    flipped, original = np.radians([0, -70, 120, 180, 50, 180]), _Job._tasks

    def guess_wrongly(job):
        for index, (program, own, lead) in enumerate(original(job)):
            job.sent[index] = (program, own, flipped if index == 2 else lead)
            yield job.sent[index]

    monkeypatch.setattr(_Job, "_tasks", guess_wrongly)
    parts = compensate_file(path, model, process, size=SIZE, processes=1, **options)
    np.testing.assert_allclose(parts.path.postures.q, whole.path.postures.q, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "text"),
    {
        "jump.nc": milling() + "GOTO 20\n",
        "late.nc": milling() + f"G1 {place(60)} C5.0\n",
        "kept.nc": milling(turn=" A5.0 C10.0").replace(" C10.", " ;C10."),
        "stored.mod": module().replace("ENDPROC", r"MoveL home,v50,z1,mill \WObj:=part;" + "\nENDPROC"),
        "assigned.mod": module().replace("SetDO spindle,1", "part.uframe.trans.x:=1"),
        "along.ls": listing().replace("J P[12] 50% FINE", "L P[12] 50mm/sec FINE"),
        "both.ls": listing()
        .replace(":L P[2]", ":J P[1] 5% FINE ;\n   9:L P[2]", 1)
        .replace("J P[12] 50%", "J P[1] 50%"),
        "again.ls": listing().replace("/POS", "  99:J P[1] 50% FINE    ;\n/POS"),
        "remark.ls": listing().replace("C P[20]\n", "C P[20]\n  22:!via    ;\n"),
        "disorder.ls": listing().replace("P[5]", "P[55]", 1).replace("P[50]", "P[5]", 1).replace("P[55]", "P[50]", 1),
        "listed.ls": listing().replace("P[60]{", "P[2]{"),
        "named.script": script().replace("movej(home, a=1, v=1)\n  ", "movel(home, a=1, v=1)\n  "),
        "named_late.script": script() + "movel(home)\n",
        "open.script": script().replace('popup("a ] in )")', "popup("),
        "kept.cl": cutter_location(3) + cutter_location(axes=False),
    }.items(),
    ids=lambda value: value if len(value) < 20 else "",
)
def test_a_program_whose_pieces_depend_on_each_other_is_read_as_a_whole(name, text, model, tools, tmp_path):
    """A jump; a rotary word that turns up late or is kept over pieces; a stored point; a work object that is set anew; a named pose; a bracket
    that stays open; points that are used again, out of order or listed out of order; a kept axis."""
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(NeedsWhole):
        list(pieces(path, None, SIZE))


def test_a_piece_with_nothing_to_correct_still_warns(model, tools, tmp_path):
    path = tmp_path / "long.ls"
    text = listing().replace("UFRAME_NUM=1", "UFRAME[1]=PR[2]")
    for n in range(1, 8):
        text = text.replace(f"L P[{n}] 50", f"J P[{n}] 50")
    path.write_text(text)
    assert not next(pieces(path, None, SIZE)).corrected.any()
    parts = compensate_file(path, model, tools.process(), size=SIZE, processes=1)
    assert any("sets a frame while it runs" in note for note in parts.notes)


def test_an_arc_whose_points_a_cut_would_part_is_not_parted(tmp_path):
    path = tmp_path / "arcs.ls"
    along = r"L (P\[\d+\]) 50mm/sec CNT10    ;\n *\d+:L (P\[\d+\] 50)"
    path.write_text(re.sub(along, r"C \1\n    :\2", listing()))
    whole = read_program(path)
    assert (whole.role == "via").sum() > 12
    assert not whole.refusals
    for size in range(700, 1100, 50):
        found = list(pieces(path, None, size))
        np.testing.assert_array_equal(np.concatenate([p.role[bool(n) :] for n, p in enumerate(found)]), whole.role)


def test_a_program_without_a_whole_line_is_not_cut(tmp_path):
    path = tmp_path / "part.nc"
    path.write_text("G21\n" + "".join(f"G1 X{n}.000\nG1 Y{n}.000\n" for n in range(200)))
    assert len(list(pieces(path, None, SIZE))) == 1
