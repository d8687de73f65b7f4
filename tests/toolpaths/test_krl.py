"""KUKA sources: what is a pose, what is kept, what is refused, and what a rewrite leaves alone."""

from pathlib import Path

import numpy as np
import pytest

from drake_stiffness.errors import InputError
from toolpaths.formats import krl, read_program
from toolpaths.formats.krl import Krl
from toolpaths.program import quantum_deg, quantum_mm
from toolpaths.rewriting import rewrite

FULL = b"LIN {X 1.0,Y 2.0,Z 3.0,A 10.0,B 20.0,C 30.0}\n"
PROGRAMS = Path(__file__).parents[3] / "shared" / "data" / "programs"


def parse(raw):
    return Krl().parse(raw, "test.src")


def moved(program, by_mm=(0.12, -0.34, 0.56), by_deg=(0.1, 0.2, -0.3), change=None, **options):
    change = np.ones(len(program), bool) if change is None else np.asarray(change)
    return rewrite(program, program.position_mm + by_mm, program.orientation + by_deg, change, **options)


@pytest.mark.parametrize(
    "line",
    [
        b"LIN {X 1.0,Y 2.0,Z 3.0,A 10.0,B 20.0,C 30.0}",
        b"lin{x 1,y 2.,z +3,a 1E1,b 2.0e+1,c 30.0}C_DIS",
        b"\tSLIN  { X 1.0 , Y 2.0 ,Z 3.0,  A 10, B 20, C 30 , S 6, T 'B011' }  C_VEL C_ORI ; C_DIS {X 3}",
        b"LIN {E6POS: C 30, B 20, A 10, Z 3, Y 2, X 1, E1 7.5}",
        b"LIN {Pos : X 1, Y 2, Z 3, A 10, B 20, C 30}\r",
        b"SLIN {X 1,Y 2,Z 3,A 10,B 20,C 30} WITH $VEL.CP = 0.5 C_SPL",
        b"\xef\xbb\xbfLIN {X 1,Y 2,Z 3,A 10,B 20,C 30} ; gr\xfc\xdfe",
    ],
)
def test_spelling_does_not_change_a_pose(line):
    program = parse(line)
    assert not program.refusals
    np.testing.assert_array_equal(program.position_mm, [[1, 2, 3]])
    np.testing.assert_array_equal(program.orientation, [[10, 20, 30]])
    assert program.carries_force.all()


def test_ordinary_lines_read_the_same_by_the_general_reader(monkeypatch):
    raw = b"".join(
        b"%s {X %d.%d, Y -.5%s,E1 %d, E2 -3.5,S 2, T 35} C_DIS ;x\r\n"
        % ([b"LIN", b"ptp", b"SLIN"][i % 3], i, i, b",Z 1.,A +03.0 ,C 1" if i % 4 == 0 else b", B -0.00", i)
        for i in range(40)
    )
    quick = parse(raw)
    monkeypatch.setattr(krl, "_ORDINARY", krl.re.compile(b"(?!)"))
    general = parse(raw)
    for name in ("line", "kind", "position_mm", "orientation", "external", "span", "source", "body", "refused"):
        np.testing.assert_array_equal(getattr(quick, name), getattr(general, name), err_msg=name)
    assert quick.refusals == general.refusals


@pytest.mark.parametrize(
    "odd",
    [
        b"LIN {X 9.5,Y 0,Z 3.25,A -0.0,B +7.5,C .5,E1 4.5} C_DIS\r\n",
        b"LIN {X 9.5,Y 0,Z 3.25,A -0.0,B +7.5,C .5,E2 4.5} C_DIS ;1\r\n",
        b"LIN {X 9.5,Y 0,Z 3.25,A -0.0,B +7.5,C .5,E1 4.5} C_DIS ;2\r\n",
        b"LIN {X9.5,Y 0,Z 3.25,A -0.0,B +7.5,C .5,E1 4.5} C_DIS ;1\r\n",
        b"LIN {X 9.5,Y 0,Z 3.2.5,A -0.0,B +7.5,C .5,E1 4.5} C_DIS ;1\r\n",
        b"LIN {X 9.5,Y 0,Z 3-2,A -0.0,B +7.5,C .5,E1 4.5} C_DIS ;1\r\n",
        b"LIN {X 9.5,Y 0,Z .,A -0.0,B +7.5,C .5,E1 4.5} C_DIS ;1\r\n",
        b"LIN {X 9.5,Y 0,Z 12345678901.0,A -0.0,B +7.5,C .5,E1 4.5} C_DIS ;1\r\n",
        b"LIN {X 9.5,Y 0,Z 0.12345678901234567,A -0.0,B +7.5,C .5,E1 4.5} C_DIS ;1\r\n",
        b"PTP {X 9.5,Y 0,Z 3.25,A -0.0,B +7.5,C .5,E1 4.5} C_DIS ;1\r\n",
        b"lin {X 9.5,Y 0,Z 3.25,A -0.0,B +7.5,C .5,E1 4.5} C_DIS ;1\r\n",
        b"LIN {X 9.5,Y 0,Z ,A 3.25 -0.0,B +7.5,C .5,E1 4.5} C_DIS ;1\r\n",
        b"$VEL.CP=0.5\r\n$APO.CDIS=0.4\r\n",
        b"",
    ],
)
def test_many_lines_read_at_once_are_the_lines_one_by_one(monkeypatch, odd):
    def block(first, count):
        return b"".join(
            b"LIN {X %d.%d,Y -%d,Z %d.,A -0.000,B +7.%d,C .5%d,E1 %d.5} C_DIS ;1\r\n" % ((i,) * 7)
            for i in range(first, first + count)
        )

    raw = block(0, 30) + odd + block(30, 40) + odd + b"LIN {X 3}\r\n" + block(70, 3)
    quick = parse(raw)
    monkeypatch.setattr(krl._Reader, "alike", lambda self, at, groups, regs: regs[0][1])
    slow = parse(raw)
    for name in ("line", "kind", "role", "position_mm", "orientation", "external", "span", "source", "body", "refused"):
        np.testing.assert_array_equal(getattr(quick, name), getattr(slow, name), err_msg=name)
    for name in ("carries_force", "follows", "feed_mm_per_min", "blend_mm", "status"):
        np.testing.assert_array_equal(getattr(quick, name), getattr(slow, name), err_msg=name)
    assert quick.refusals == slow.refusals
    assert quick.notes == slow.notes
    assert np.signbit(quick.orientation[0, 0])  # -0.000 too


def test_words_not_written_keep_their_value():
    program = parse(FULL + b"LIN {Z 5}\nLIN {A 11, E1 4}\nLIN {X 2}\n")
    np.testing.assert_array_equal(program.position_mm, [[1, 2, 3], [1, 2, 5], [1, 2, 5], [2, 2, 5]])
    np.testing.assert_array_equal(program.orientation[:, 0], [10, 10, 11, 11])
    np.testing.assert_array_equal(program.external[:, 0], [np.nan, np.nan, 4, 4])


def test_the_first_pose_must_be_whole():
    program = parse(b"DEF a()\nLIN {X 10}\n" + FULL)
    (refusal,) = program.refusals
    assert refusal.line == 2
    assert "Y, Z, A, B, C" in refusal.reason
    assert program.corrected.tolist() == [False, True]


@pytest.mark.parametrize(
    ("between", "why"),
    [
        (b"LIN XP1\n", "line 2"),
        (b"PTP HOME\n", "line 2"),
        (b"PTP {A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}\n", "axis angles"),
        (b"LOOP\n", "LOOP"),
        (b"ENDIF\n", "ENDIF"),
        (b"weld(3)\n", "weld"),
        (b"$BASE = BASE_DATA[2]\n", "base"),
        (b"$TOOL = {X 0,Y 0,Z 200,A 0,B 0,C 0}\n", "tool"),
        (b"LIN_REL {X 10}\n", "line 2"),
        (b"CIRC {X 5,Y 5},{X 6,Y 6},CA 200\n", "CA"),
        (b"again:\n", "label"),
    ],
)
def test_a_partial_pose_is_refused_where_the_pose_before_is_uncertain(between, why):
    program = parse(FULL + between + b"LIN {X 10}\n")
    assert program.refusals[-1].line == 3
    assert why in program.refusals[-1].reason
    assert parse(FULL + b"$OUT[1]=TRUE\nWAIT SEC 0.5\nBAS(#VEL_CP,0.1)\nX=SIN(3)\n;LOOP\nLIN {X 10}\n").refusals == ()


@pytest.mark.parametrize(
    ("line", "reason", "column"),
    [
        (b"LIN XP1", "'XP1': a named point", 5),
        (b"LIN MESA:P2", "MESA:P2", 5),
        (b"SLIN P[i] C_DIS", "P[i]", 6),
        (b"LIN base1:{X 1,Y 2}", "named point or an expression", 5),
        (b"LIN {X 1,Y 2,Z 3}:off", "after the pose", 18),
        (b"LIN {X a+1, Y 2}", "'a+1' for X, not a literal", 8),
        (b"LIN {X 1, Y 2", "not closed", 5),
        (b"LIN {X 1, {Y 2}}", "brace inside", 11),
        (b"LIN {X 1, X 2}", "word X twice", 11),
        (b"LIN {X 1, Q 2}", "unknown word 'Q'", 11),
        (b"LIN {X 1.2.3}", "'1.2.3' for X, no number", 8),
        (b"LIN {X NaN}", "'NaN' for X, no number", 8),
        (b"LIN {X 1E999}", "no number", 8),
        (b"LIN {X 1,,Y 2}", "no word", 10),
        (b"LIN {}", "no word", 6),
        (b"LIN {A1 0, A2 0}", "axis angles", 6),
        (b"LIN", "no target", 4),
        (b"LIN_REL {X 1}", "relative", 1),
        (b"CIRC_REL {X 1},{X 2}", "relative", 1),
        (b"CIRC {X 1}", "no end point", 11),
        (b"CIRC XP1,{X 1}", "XP1", 6),
        (b"SPL XP3", "XP3", 5),
        (b"IF a THEN LIN {X 1}", "inside another statement", 1),
        (b"LIN {X 1,\rY 2}", "carriage return", 4),
    ],
)
def test_what_is_no_literal_pose_is_refused_with_line_column_and_finding(line, reason, column):
    program = parse(FULL + line + b"\n")
    (refusal,) = program.refusals
    assert (refusal.line, refusal.column) == (2, column)
    assert reason in refusal.reason
    assert refusal.carries_force
    assert moved(program).raw.endswith(b"\n" + line + b"\n")


def test_the_points_of_a_spline_block_are_corrected_as_points():
    program = parse(b"SPLINE\nS" + FULL + b"SPL {X 5.0}\nSCIRC {X 6.0,Y 1.0},{X 7.0,Y 3.0}\nENDSPLINE\n")
    assert program.refusals == ()
    assert program.corrected.all()
    assert moved(program, by_deg=0.0).raw.splitlines()[2] == b"SPL {X 5.1}"


def test_a_point_to_point_move_without_a_pose_is_a_note():
    program = parse(b"PTP HOME\n" + FULL + b"PTP_REL {A1 5}\nptp {x foo}\n")
    assert program.refusals == ()
    assert [n.line for n in program.notes] == [1, 3, 4]
    assert not any(n.carries_force for n in program.notes)


def test_comments_folds_headers_and_strings_hold_no_motion():
    raw = b'&ACCESS LIN {X 1}\n;FOLD LIN {X 1}\n;LIN {X 1}\nmsg="LIN {X 1}; PTP {X 2}"\n' + FULL
    program = parse(raw)
    assert program.line.tolist() == [5]
    assert program.refusals == ()


def test_frames_are_recorded_as_written():
    raw = (
        b"$BASE = {FRAME: X 1800,Y 0,Z 800.5,A 0,B 0,C 0} ; base\n$tool=TOOL_DATA[3]\nBAS(#BASE,2)\n$BASE=$NULLFRAME\n"
        b"$BASE = BASE_DATA[1]:{X 1}\n$BASE.X = 5\n" + FULL + b"$BASE = {X 5}\n"
    )
    frames = parse(raw).frames
    assert [(f.line, f.what, f.origin) for f in frames] == [
        (1, "base", "literal"),
        (2, "tool", "controller"),
        (3, "base", "controller"),
        (4, "base", "literal"),
        (5, "base", "expression"),
        (6, "base", "expression"),
        (8, "base", "literal"),
    ]
    assert frames[0].pose == (1800, 0, 800.5, 0, 0, 0)
    np.testing.assert_array_equal(frames[-1].pose, [5] + [np.nan] * 5)


def test_a_standing_tool_makes_the_whole_program_unsafe():
    (refusal,) = parse(b"$IPO_MODE=#TCP\n" + FULL).refusals
    assert refusal.fatal


def test_an_arc_is_two_rows_of_one_line():
    program = parse(FULL + b"CIRC {X 2,Y 3},{X 3,Y 2,Z 4} , CA 82.2 C_DIS\n")
    assert program.role.tolist() == ["point", "via", "end"]
    assert program.line.tolist() == [1, 2, 2]
    np.testing.assert_array_equal(program.position_mm[1:], [[2, 3, 3], [3, 2, 4]])


def test_the_end_of_an_arc_keeps_a_word_only_where_start_and_auxiliary_point_agree():
    assert parse(FULL + b"CIRC {X 2,Y 3,Z 3},{X 3,Y 2}\n").refusals == ()
    (refusal,) = parse(FULL + b"CIRC {X 2,Y 3,Z 4},{X 3,Y 2}\n").refusals
    assert "Z not written" in refusal.reason


@pytest.mark.parametrize(
    ("raw", "word"), [(b"DEF a()\nEND\n", "no motion"), (b"DEF a()\rHALT\r", "carriage"), (b"D\0E\0F\0", "NUL")]
)
def test_a_source_without_motion_is_no_input(raw, word):
    with pytest.raises(InputError, match=word):
        parse(raw)


@pytest.mark.parametrize(("content", "word"), [(b"", "empty"), (b"\0\0\0", "NUL"), (b"hello\n", "no known dialect")])
def test_a_file_without_a_program_says_so(tmp_path, content, word):
    path = tmp_path / "part.txt"
    path.write_bytes(content)
    with pytest.raises(InputError, match=f"part.txt.*{word}"):
        read_program(path)


def test_the_dialect_comes_from_content_and_can_be_overridden(tmp_path):
    path = tmp_path / "part.txt"
    path.write_bytes(FULL)
    assert read_program(path).dialect == "krl"
    with pytest.raises(InputError, match="missing column"):
        read_program(path, dialect="csv")
    with pytest.raises(InputError, match=r"expected one of: .*krl"):
        read_program(path, dialect="heidenhain")


# Rewriting


def test_a_point_to_point_move_is_never_changed():
    raw = b"PTP {X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0} C_PTP\nSPTP {X 9.0,Y 2.0}\n"
    assert moved(parse(raw)).raw == raw


@pytest.mark.parametrize(
    ("token", "new", "by"),
    [
        (b"-0.000", b"0.120", 0.12),
        (b"-0.000", b"-0.000", 0.0004),
        (b"-0.0", b"-0.0", 0.04),
        (b"0.001", b"0.000", -0.0011),
        (b"1.", b"1.", 0.12),
        (b"1.", b"2.", 0.8),
        (b".5", b".6", 0.12),
        (b"-.5", b"-.4", 0.12),
        (b"1E-3", b"121E-3", 0.12),
        (b"1.20e+02", b"1.21e+02", 1.0),
        (b"+3.00", b"+3.12", 0.12),
        (b"+0.05", b"-0.07", -0.12),
        (b"500", b"500", 0.12),
        (b"500", b"501", 0.7),
        (b"007.50", b"007.62", 0.12),
        (b"-007.50", b"-007.38", 0.12),
        (b"999.95", b"1000.07", 0.12),
        (b"0.12345678901234567", b"0.24345678901234567", 0.12),
    ],
)
def test_a_number_keeps_its_style(token, new, by):
    raw = b"LIN {X %s,Y 2.0,Z 3.0,A 1.0,B 0.0,C 0.0}"
    out = moved(parse(raw % token), by_mm=(by, 0, 0), by_deg=0.0).raw
    if b"1234567890" in token:
        assert abs(float(out[7:26]) - float(new)) < 1e-15
        assert len(out) == len(raw % new)
    else:
        assert out == raw % new


def test_the_worth_of_a_printed_digit_is_reported():
    program = parse(b"LIN {X 500,Y 2.00,Z 3.000,A 1.0,B 0.00,C 1E-3}\nLIN {X 1.0, Y 1.0}\n")
    np.testing.assert_allclose(quantum_mm(program), [0.5, 0.05])
    np.testing.assert_allclose(quantum_deg(program), [0.05, 0.05])


def test_a_pose_without_angles_is_corrected_in_position_only():
    raw = FULL + b"LIN {X 1.5,Y 2.5,Z 3.5}\n" + FULL
    program = parse(raw)
    # The first line gives the second its orientation: correcting it would turn the tool on both.
    assert program.position_only.tolist() == [True, True, False]
    out = moved(program)
    assert not out.refusals
    lines = out.raw.splitlines()
    assert lines[0] == b"LIN {X 1.1,Y 1.7,Z 3.6,A 10.0,B 20.0,C 30.0}"
    assert lines[1] == b"LIN {X 1.6,Y 2.2,Z 4.1}"
    assert lines[2] == b"LIN {X 1.1,Y 1.7,Z 3.6,A 10.1,B 20.2,C 29.7}"


def test_an_auxiliary_point_without_angles_does_not_hold_back_the_line_before_it():
    program = parse(FULL + b"CIRC {X 2.0,Y 3.0,Z 3.0},{X 3.0,Y 2.0,Z 3.0,A 10.0,B 20.0,C 30.0}\n")
    assert program.position_only.tolist() == [False, True, False]
    out = moved(program)
    assert not out.refusals
    assert out.raw.splitlines() == [
        b"LIN {X 1.1,Y 1.7,Z 3.6,A 10.1,B 20.2,C 29.7}",
        b"CIRC {X 2.1,Y 2.7,Z 3.6},{X 3.1,Y 1.7,Z 3.6,A 10.1,B 20.2,C 29.7}",
    ]


def test_a_correction_that_needs_a_word_refuses_the_line():
    program = parse(FULL + b"LIN {X 5.0}\n")
    out = moved(program, by_mm=np.array([[0.0, 0, 0], [0.2, 0.3, 0]]), by_deg=0.0)
    (refusal,) = out.refusals
    assert (refusal.line, refusal.words) == (2, ("Y",))
    assert out.changed.tolist() == [True, False]
    assert out.raw == program.raw


def test_a_common_shift_needs_no_words():
    out = moved(parse(FULL + b"LIN {X 5.0}\nLIN {Y 7.0}\n"), by_mm=(0.2, 0.3, 0), by_deg=0.0)
    assert not out.refusals
    assert out.raw.splitlines()[1:] == [b"LIN {X 5.2}", b"LIN {Y 7.3}"]


def test_a_point_to_point_move_is_not_carried_along_by_the_line_before_it():
    program = parse(FULL + b"PTP {Z 100.0}\n")
    out = moved(program, by_deg=0.0)
    (refusal,) = out.refusals
    assert refusal.line == 1
    assert "line 2" in refusal.reason
    assert out.raw == program.raw
    allowed = moved(program, by_deg=0.0, allow_insert=True)
    assert not allowed.refusals
    assert allowed.raw.splitlines()[1] == b"PTP {Z 100.0,X 1.0,Y 2.0}"


def test_inserted_words_follow_the_last_pose_word_and_look_like_their_neighbours():
    program = parse(FULL + b"lin { x 5.00, z 1.000 , E1 3} C_DIS\nLIN {E1 4}\n")
    by = np.array([[0.1, 0.2, 0.3], [0.3, 0.43, 0.5], [0.3, 0.1, 0.5]])
    out = moved(program, by_mm=by, by_deg=0.0, allow_insert=True)
    lines = out.raw.splitlines()
    assert lines[1] == b"lin { x 5.30, z 1.500, y 2.430 , E1 3} C_DIS"
    assert lines[2] == b"LIN {Y 2.1, E1 4}"  # no neighbour: as the line it was kept from
    assert [(i.line, i.words) for i in out.insertions] == [(2, ("Y",)), (3, ("Y",))]
    np.testing.assert_allclose(parse(out.raw).position_mm, program.position_mm + by, atol=0.05 + 1e-9)


def test_an_inserted_word_is_taken_back_in_the_next_line_that_must_stay():
    program = parse(FULL + b"LIN {X 5.0}\nLIN {X 6.0}\nLIN {X 7.0}\n")
    out = moved(program, by_mm=(0, 0.3, 0), by_deg=0.0, change=[False, True, False, False], allow_insert=True)
    assert out.raw.splitlines()[1:] == [b"LIN {X 5.0,Y 2.3}", b"LIN {X 6.0,Y 2.0}", b"LIN {X 7.0}"]


def test_what_the_end_of_an_arc_keeps_must_hold_for_start_and_auxiliary_point():
    program = parse(FULL + b"CIRC {X 2.0,Y 3.0,Z 3.0},{X 3.0,Y 2.0}\n")
    lifted = np.array([[0, 0, 0], [0, 0, 0.4], [0, 0, 0]])
    out = moved(program, by_mm=lifted, by_deg=0.0)
    assert [(r.line, r.words) for r in out.refusals] == [(2, ("Z",))]
    assert out.raw == program.raw
    allowed = moved(program, by_mm=lifted, by_deg=0.0, allow_insert=True)
    assert allowed.raw.splitlines()[1] == b"CIRC {X 2.0,Y 3.0,Z 3.4},{X 3.0,Y 2.0,Z 3.0}"


def test_a_word_inserted_in_the_auxiliary_point_is_inserted_in_the_end_too():
    program = parse(FULL + b"CIRC {X 2.0,Y 3.0},{X 3.0,Y 2.0}\nLIN {X 9.0}\n")
    lifted = np.array([[0, 0, 0], [0, 0, 0.4], [0, 0, 0.4], [0, 0, 0.4]])
    out = moved(program, by_mm=lifted, by_deg=0.0, allow_insert=True)
    assert out.raw.splitlines()[1:] == [b"CIRC {X 2.0,Y 3.0,Z 3.4},{X 3.0,Y 2.0,Z 3.4}", b"LIN {X 9.0}"]


def test_a_wanted_pose_that_is_not_finite_is_an_error():
    with pytest.raises(ValueError, match="line 1"):
        moved(parse(FULL), by_mm=(np.nan, 0, 0))


def test_a_long_chain_of_partial_poses_is_settled_in_linear_time():
    chain = b"".join(b"LIN {%s %d.0}\n" % (b"XY"[i % 2 : i % 2 + 1], i % 50) for i in range(20_000))
    program = parse(FULL + chain + b"PTP {Z 100.0}\n")
    out = moved(program, by_deg=0.0)
    assert out.raw == program.raw
    assert len(out.refusals) == 20_001


@pytest.mark.parametrize(
    "line", [b"a" * 200_000, b"LIN " + b" " * 200_000, b"LIN {X 1" + b" " * 200_000, b'"' * 200_000]
)
def test_no_line_makes_the_reader_hang(line):
    assert len(parse(FULL + line + b"\n" + FULL)) == 2


@pytest.mark.skipif(not PROGRAMS.is_dir(), reason="the shared programs are not on this machine")
@pytest.mark.parametrize("name", ["gbarbo_ursoaula.src", "mimic_example.src"])
def test_real_programs_are_read_and_left_alone(name):
    program = read_program(PROGRAMS / name)
    assert moved(program).raw == (PROGRAMS / name).read_bytes()
    if name.startswith("gbarbo"):
        lines = (PROGRAMS / name).read_bytes().splitlines()
        motions = [n for n, line in enumerate(lines, 1) if line.split()[:1] in ([b"LIN"], [b"CIRC"])]
        assert [r.line for r in program.refusals] == motions


@pytest.mark.skipif(not PROGRAMS.is_dir(), reason="the shared programs are not on this machine")
def test_files_of_other_kinds_are_no_krl():
    for path in PROGRAMS.iterdir():
        if path.suffix == ".src" or path.is_dir():
            continue
        with pytest.raises(InputError):
            read_program(path, dialect="krl")


def test_a_number_that_its_sign_alone_holds_apart_from_its_word_keeps_a_sign():
    """``Z-0.1`` is a word and a number; ``Z0.27`` would be a name, and the program another one."""
    program = parse(b"LIN {X-0.100,Y -0.100,Z-5.000,A 0.0,B 0.0,C+1.0}\n")
    out = rewrite(program, program.position_mm + 0.37, program.orientation - 2.0, np.ones(1, bool))
    assert out.raw == b"LIN {X+0.270,Y 0.270,Z-4.630,A -2.0,B -2.0,C-1.0}\n"
    np.testing.assert_allclose(parse(out.raw).position_mm, program.position_mm + 0.37)
