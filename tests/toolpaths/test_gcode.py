"""G-code: what is a pose, what stays as it is, what is refused and why."""

from pathlib import Path

import numpy as np
import pytest
from contract import half_digit, only_numbers_changed
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_stiffness.errors import InputError
from toolpaths.formats import read_program
from toolpaths.formats.gcode import GCode
from toolpaths.rewriting import rewrite

PROGRAMS = Path(__file__).parents[3] / "shared" / "data" / "programs"
WHOLE = b"G1 X1.000 Y2.000 Z3.000\n"


def parse(raw):
    return GCode().parse(raw, "test.nc")


def moved(program, by=(0.12, -0.34, 0.56), **options):
    change = np.ones(len(program), bool)
    return rewrite(program, program.position_mm + by, program.orientation, change, **options)


def refused_lines(raw):
    return [r.line for r in parse(raw).refusals]


@pytest.mark.parametrize(
    "line",
    [
        b"G1 X1.5 Y-2 Z.5 F100",
        b"g01x1.5y-2z.5f100",
        b"N10 G1 X 1.5 Y -2 Z +0.5 ; G1 X9",
        b"N 0010G1(G0 X9)X1.5(a)Y-2.Z0.50(b",
        b"\xef\xbb\xbfG90 G21 G17 G1 F100 S4000 M3 Z.5 X1.5 Y-2\r",
        b"G1 X1.5 Y-2 Z.5 (caf\xe9 (nested) G2) M8\0\0\0",
    ],
)
def test_spelling_does_not_change_a_pose(line):
    program = parse(line)
    assert not program.refusals
    assert program.position_mm.tolist() == [[1.5, -2, 0.5]]
    assert program.carries_force.all()
    for row in program.span:
        assert [float(program.raw[a:b]) for a, b in row] == [1.5, -2, 0.5]


def test_words_and_motions_are_modal_and_rapids_carry_no_force():
    program = parse(b"g0x20y20z20\nG1 Z-1\nX4.369\nY5\nG0 Z5\nX1\nG01 Y0\n")
    assert program.kind.tolist() == ["G0", "G1", "G1", "G1", "G0", "G0", "G1"]
    assert program.carries_force.tolist() == [False, True, True, True, False, False, True]
    assert program.position_mm[-1].tolist() == [1, 0, 5]
    assert not program.refusals


def test_ordinary_lines_read_the_same_by_the_general_reader(monkeypatch):
    raw = b"G0 X0 Y0 Z0 A1. C2.\n" + b"".join(
        b"N%d %sX%d.%d Y-.5%s F%d ; x\r\n" % (i, [b"G1 ", b"", b"g00"][i % 3], i, i, b" A1.5C2" if i % 4 else b"", i)
        for i in range(40)
    )
    quick = parse(raw)
    monkeypatch.setattr("toolpaths.formats.gcode.Reader.quick", lambda self, match: False)
    general = parse(raw)
    assert len(quick) == 41
    for name in ("line", "kind", "position_mm", "orientation", "feed_mm_per_min", "span", "source", "body", "refused"):
        np.testing.assert_array_equal(getattr(quick, name), getattr(general, name), err_msg=name)


def test_a_feed_is_in_mm_per_minute_and_unknown_per_turn_or_inverse_time():
    program = parse(b"G20 G1 X0 Y0 Z0 F10\nX1\nG95 F0.1 X2\nG93 F3 X3\nG94 X4\nF20 X5\nG4 F2\nX6\n")
    np.testing.assert_allclose(program.feed_mm_per_min, [254, 254, np.nan, np.nan, np.nan, 508, 508])
    assert program.position_mm[1].tolist() == [25.4, 0, 0]
    assert parse(b"G71 G1 X1 Y0 Z0").position_mm[0, 0] == 1


def test_a_unit_that_changes_in_the_middle_is_refused_from_there_on():
    assert refused_lines(WHOLE + b"G20\nX1\nG21\nX2\n") == [3, 5]
    assert "unit changes in line 2" in parse(WHOLE + b"G20\nX1\n").refusals[0].reason
    assert refused_lines(b"G20\n" + WHOLE + b"G20 X1\n") == []


def test_the_zero_point_belongs_to_the_control():
    program = parse(b"G54\n" + WHOLE + b"G54 X2\nG55\n" + WHOLE + b"G54.1 P3\n" + WHOLE)
    assert [(f.line, f.what, f.origin, f.key) for f in program.frames] == [
        (1, "base", "controller", "G54"),
        (4, "base", "controller", "G55"),
        (6, "base", "controller", "G54.1 P3"),
    ]
    assert not program.refusals
    assert refused_lines(WHOLE + b"G55\nX5\n") == [3]


@pytest.mark.parametrize(
    ("lines", "refused", "why"),
    [
        (b"G91\nG1 X1\nG90\nX1\n", [3, 5], "G91 since line 2"),
        (b"G91 G1 X1\n", [2], "relative motion"),
        (b"G41 D1 X5\nX6\nG40 X7 Y0 Z0\nX8\n", [2, 3], "cutter radius compensation"),
        (b"G42 X5\n", [2], "cutter radius"),
        (b"G81 X1 Y1 Z-1 R1\nX2\nG80\nX3\n", [2, 3, 5], "canned cycle, G81 in line 2"),
        (b"G92 X0 Y0\nG1 X1 Y1 Z1\n", [3], "zero point is moved"),
        (b"G10 L2 P1 X0 Y0\nG1 X1 Y1 Z1\n", [3], "data of the control"),
        (b"G52 X5\nX1 Y1 Z1\n", [3], "zero point"),
        (b"G68 X0 Y0 R30\nX1 Y1 Z1\nG69\nX1 Y1 Z1\n", [3], "turned"),
        (b"G68.2 X0 Y0 Z0 I10 J0 K0\nX1 Y1 Z1\n", [3], "tilted"),
        (b"G53 G1 X1\n", [2], "place of the machine"),
        (b"G123 X1\nX2\n", [2, 3], "G123 in line 2"),
        (b"X#1\n", [2], "'X#1'"),
        (b"X[1+2]\n", [2], "literal number"),
        (b"x sin[30]\n", [2], "literal number"),
        (b"X=R1+5\n", [2], "literal number"),
        (b"X=AC(5)\n", [2], "literal number"),
        (b"#1=2.0\nX3\n", [], ""),
        (b"M98 P100\n", [2], "subprogram"),
        (b"G65 P9000 X1\n", [2], "subprogram"),
        (b"G66 P9000\nX1 Y1 Z1\n", [3], "macro"),
        (b"o100 call [1] [2]\n", [2], "literal number"),
        (b"X1 Y2 pocket)\n", [2], "a ')' without its '('"),
        (b"X1 X2\n", [2], "the word X twice"),
        (b"X1e-05\n", [2], "exponent"),
        (b"X1.2.3\n", [2], "literal number"),
        (b"X1 0\n", [2], "literal number"),
        (b"X1,R5\n", [2], "literal number"),
        (b"X1 U2\n", [2], "U, V, W or L"),
        (b"G1 X1 R5\n", [2], "straight move"),
        (b"G0 G1 X1\n", [2], "two kinds"),
        (b"G5 X1 Y1 I0 J3\n", [2], "G5"),
        (b"TRANS X10\nX1 Y1 Z1\n", [2, 3], "literal number"),
        (b"G1 X1 Y1 Z1 A3=0.3 B3=0 C3=0.954\nX1 Y1 Z1\n", [2, 3], "literal number"),
        (b"CYCLE832(0.05,1,1)\nX1 Y1 Z1\n", [], ""),
        (b"CYCLE81(5,0,2)\n", [2], "'CYCLE81"),
        (b"X1\r X2\n", [2], ""),
    ],
)
def test_what_moves_points_away_from_their_words_is_refused_with_its_line(lines, refused, why):
    program = parse(WHOLE + lines)
    assert [r.line for r in program.refusals] == refused
    assert all(r.carries_force for r in program.refusals)
    assert not refused or why in program.refusals[0].reason
    assert moved(program).raw.splitlines()[1:2] == (WHOLE + lines).splitlines()[1:2] or not refused


@pytest.mark.parametrize(
    ("between", "lost"),
    [
        (b"T1 M6\n", "X, Y"),
        (b"G43 H1\n", ""),
        (b"G28 G91 Z0.\nG90\n", "X, Y"),
        (b"G0 G53 Z0\nG1\n", "X, Y"),
        (b"M99\n", "X, Y"),
        (b"O2000\n", "X, Y"),
        (b"/X9\n", "X, Y"),
        (b"IF [#1 GT 3] GOTO 100\n", "X, Y"),
        (b"G91 G0 X3\nG90 G1\n", "X, Y"),
        (b"M8\nF200\nG4 P2\n(X9)\n;X9\n%\n/M9\nT2\n\n", ""),
        (b"G52 X0 Y0\n", ""),
        (b"G64 P0.01\nG5.1 Q1\nG61.1\nG05 P10000\nG103 P1\nG22 X9 Y9\n", ""),
    ],
)
def test_words_are_forgotten_where_the_pose_before_is_uncertain(between, lost):
    program = parse(WHOLE + between + b"Z7\n")
    if lost:
        assert f"{lost} not written here" in program.refusals[-1].reason
        assert not program.corrected[-1]
    else:
        assert not program.refusals
        assert program.position_mm[-1].tolist() == [1, 2, 7]


def test_a_tool_length_changes_what_z_means():
    assert refused_lines(WHOLE + b"G43 H1\nX5\n") == [3]
    assert refused_lines(WHOLE + b"G43 H1 Z5\nX5\n") == []


def test_a_jump_makes_words_unknown_where_it_arrives():
    assert refused_lines(WHOLE + b"N5 X2\nGOTO 5\n" + WHOLE) == [2]
    assert refused_lines(WHOLE + b"N5 X2\nGOTO 6\n" + WHOLE) == []


def test_a_block_that_may_be_skipped_is_corrected_but_not_relied_on():
    program = parse(WHOLE + b"/X9 Y1 Z1\nX8 Y1 Z2\n/G0 Z5\nX1 Y1 Z1\n")
    assert program.corrected.tolist() == [True, True, True, False]
    assert [r.line for r in program.refusals] == [5]


@pytest.mark.parametrize(
    ("arc", "what"),
    [
        (b"G2 X2 Y1 J-1", "I, J, K"),
        (b"G3 X2 Y1 R1", "its R"),
        (b"G2 J-1.45", "I, J, K"),
        (b"G18 G2 X2 Z4 I1 K0", "I, J, K"),
        (b"G2 X2", "neither I, J, K nor R"),
        (b"G2 X9 Y1 J-1", "radius is 1.0000 mm at its start"),
        (b"G2 X9 Y2 R1", "more than twice the radius"),
        (b"G2 X2 Y1 J-1 P3", "turns"),
    ],
)
def test_an_arc_stays_and_so_does_the_move_to_its_start(arc, what):
    program = parse(WHOLE + WHOLE + arc + b"\nG1 X5 Y6 Z7\n")
    assert [r.line for r in program.refusals] == [2, 3]
    assert what in program.refusals[1].reason
    assert program.corrected.tolist() == [True, False, False, True]
    raw = program.raw.splitlines()
    assert moved(program).raw.splitlines()[1:3] == raw[1:3]


def test_arcs_are_modal_too():
    assert refused_lines(WHOLE + b"G2 X2 Y1 J-1\nX3 Y2 I1\nG1 X1 Y1\n") == [1, 2, 3]


def test_a_correction_needs_words_that_are_not_written():
    program = parse(b"G0 X0. Y0. Z5.\nG1 Z-1.000\nX10.000\nY10.\nG0 Z5.\n")
    strict = moved(program, allow_insert=False)
    assert [r.line for r in strict.refusals] == [2, 3, 4]
    allowed = moved(program, allow_insert=True)
    assert allowed.raw.splitlines() == [
        b"G0 X0. Y0. Z5.",
        b"G1 Z-0.440 X0.120 Y-0.340",
        b"X10.120",
        b"Y10.",
        b"G0 Z5. X10.000",
    ]
    assert [(i.line, i.words) for i in allowed.insertions] == [(2, ("X", "Y")), (5, ("X",))]
    np.testing.assert_allclose(parse(allowed.raw).position_mm[1:3], [[0.12, -0.34, -0.44], [10.12, -0.34, -0.44]])


def test_inserted_words_look_like_their_line():
    assert b"g0x1y1z1\ng1x2.000y0.660z1.560\n" in moved(parse(b"g0x1y1z1\ng1x1.880\n"), allow_insert=True).raw
    assert b"G1 X 1.120 Y 0.660 Z 1.560\n" in moved(parse(b"G0 X1 Y1 Z1\nG1 X 1.000\n"), allow_insert=True).raw


def test_what_other_real_programs_contain_is_kept_byte_for_byte():
    raw = (
        b"%\r\nO0001 (G1 X9 Y9)\nN9998 G90 G94 G17 G49 G40 G80\r\n(G1 X1 Y1 Z1)\n; G1 X2\r\nN9999 G0 X  2.646 Y1. Z5.\nN1 g1z-1.F100\r\n"
        b"X4.369\nG28 G91 Z0.\nG90\nM30\r\n%\0\0\0"
    )
    program = parse(raw)
    assert program.line.tolist() == [6, 7, 8]
    assert program.position_mm[-1].tolist() == [4.369, 1, -1]
    assert [n.line for n in program.notes] == [9]
    assert not program.refusals
    assert moved(program, by=(0, 0, 0)).raw == raw
    assert moved(program, by=(0, 0, 0.004), allow_insert=True).raw.endswith(b"\r\n%\0\0\0")
    # A comment that lost its bracket reads like words: left as it is, with its line.
    lost = parse(b"G0 X0 Y0 Z5\nG1 Z-1\nX5 POCKET 2)\nX1 Y1 Z1\n")
    assert [(r.line, r.column) for r in lost.refusals] == [(3, 12)]


def test_a_program_without_motion_says_what_was_expected():
    with pytest.raises(InputError, match="no motion"):
        parse(b"%\nO100\nM30\n%\n")
    with pytest.raises(InputError, match="bare carriage returns"):
        parse(b"M3\rM5\r")


@pytest.mark.skipif(not PROGRAMS.is_dir(), reason="the shared programs are not on this machine")
@pytest.mark.parametrize(
    ("name", "rows", "refusals"),
    [
        ("cncjs_tball.gcode", 2681, 1),
        ("cncjs_circle_diamond_square.gcode", 980, 162),
        ("nist_example1.gcode", 59, 10),
        ("nist_example2.gcode", 1, 46),
        ("nist_cycletest_example3.gcode", 0, 41),
        ("wbk_over_xyzabc.mpf", 63, 0),
        ("wbk_logger_robot_view.txt", 180, 0),
    ],
)
def test_real_programs_are_read_and_left_alone(name, rows, refusals):
    raw = (PROGRAMS / name).read_bytes()
    program = read_program(PROGRAMS / name)
    assert program.dialect == "gcode"
    assert (len(program), len(program.refusals)) == (rows, refusals)
    assert moved(program, by=(0, 0, 0)).raw == raw
    out = moved(program, by=(0.05, 0.05, -0.05), allow_insert=True)
    assert out.raw.count(b"\n") == raw.count(b"\n")
    back = parse(out.raw)
    close = np.abs(back.position_mm - program.position_mm - 0.05 * np.outer(out.changed, [1, 1, -1])) <= 0.5 + 1e-9
    assert (close | np.isnan(program.position_mm)).all()


number = st.tuples(
    st.sampled_from(["", "-", "+"]), st.integers(0, 99), st.sampled_from(["", ".", ".5", ".25", ".125", ".0000"])
)
filler = st.sampled_from(["", "(G1 X9 Y9)", "; G1 X9", "M8", "F300", "%", "/ M1", "G4 P1.5", "T1", "( caf\xe9"])
breaker = st.sampled_from(["M6", "G28 Z0", "X#1", "G2 X1 Y1 R50", "O5", "M98 P1", "G1 X1 X2"])


@st.composite
def programs(draw):
    """Text (latin-1) and, for every line with a feed move, the spans of its numbers."""
    text, spans, mode, whole = "", [], None, True
    for _ in range(draw(st.integers(1, 9))):
        what = draw(st.sampled_from(["move", "move", "move", "filler", "breaker"]))
        if what != "move":
            line = draw(filler if what == "filler" else breaker)
            if what == "breaker":
                mode, whole = None, True
            text += line
        else:
            g = draw(st.sampled_from(["0", "1", "01", "1"] if mode is None else ["", "", "0", "1", "01"]))
            gap, blank, lower = (
                draw(st.sampled_from(["", " "])),
                draw(st.sampled_from(["", " ", "  "])),
                draw(st.booleans()),
            )
            mode = int(g or mode)
            text += draw(st.sampled_from(["", "N7 ", "n0010"])) + ("g" if lower else "G") * bool(g) + g + gap * bool(g)
            words = [w for w in "XYZ" if whole or draw(st.booleans())] or ["Y"]
            for word in draw(st.permutations(words)):
                sign, integer, tail = draw(number)
                token = sign + str(integer) + tail
                text += (word.lower() if lower else word) + blank
                if mode == 1:
                    spans.append((len(text), len(text) + len(token)))
                text += token + gap
            text += draw(st.sampled_from(["", "F200", "(X1)", "M9"]))
            whole = False
        text += draw(st.sampled_from(["\n", "\r\n"]))
    return text, spans


@settings(max_examples=25, deadline=None)
@given(programs(), st.integers(0, 2**32 - 1), st.booleans())
def test_only_numbers_of_feed_moves_change_and_what_was_written_reads_as_wanted(generated, seed, allow_insert):
    text, spans = generated
    raw = b"G0 X1 Y1 Z1\n" + text.encode("latin-1")
    program = parse(raw)
    assert moved(program, by=(0, 0, 0), allow_insert=allow_insert).raw == raw
    rng = np.random.default_rng(seed)
    by = rng.normal(0, rng.choice([1e-3, 0.3, 20.0]), (len(program), 3))
    change = rng.random(len(program)) < 0.8
    out = rewrite(program, program.position_mm + by, program.orientation, change, allow_insert=allow_insert)
    if not allow_insert:
        offset = len(b"G0 X1 Y1 Z1\n")
        only_numbers_changed(raw, out.raw, [(a + offset, b + offset) for a, b in spans])
        assert out.insertions == ()
    back = parse(out.raw)
    expected = program.position_mm + np.where(out.changed[:, None], by, 0)
    limit = np.where(out.changed[:, None], half_digit(back)[:, :3] * (1 + 1e-6) + 1e-9, 1e-9)
    known = np.isfinite(program.position_mm)
    assert (np.abs(back.position_mm - expected) <= limit)[known].all()
    left = change & program.carries_force & ~out.changed
    assert set(program.line[left].tolist()) <= {r.line for r in (*out.refusals, *program.refusals)}


@settings(max_examples=25, deadline=None)
@given(programs(), st.binary(max_size=30), st.integers(0, 10**6))
def test_damaged_bytes_never_crash_the_reader(generated, noise, where):
    raw = b"G0 X1 Y1 Z1\n" + generated[0].encode("latin-1")
    at = where % len(raw)
    damaged = b"G1 X1 Y1 Z1\n" + raw[:at] + noise + raw[at + len(noise) // 2 :]
    program = parse(damaged)
    assert moved(program, by=(0, 0, 0)).raw == damaged
