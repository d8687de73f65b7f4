"""APT and CLDATA: points with and without an axis, records over several lines, what is refused."""

import numpy as np
import pytest
from contract import holds_contract
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_stiffness.errors import InputError
from toolpaths.formats import read_program
from toolpaths.formats.apt import Apt
from toolpaths.rewriting import rewrite

WHOLE = b"GOTO/1.0,2.0,3.0,0.0,0.0,1.0\n"


def parse(raw):
    return Apt().parse(raw, "test.cl")


def moved(program, by=(0.12, -0.34, 0.56), axis=None):
    orientation = program.orientation if axis is None else axis
    return rewrite(program, program.position_mm + by, orientation, np.ones(len(program), bool))


def refused_lines(raw):
    return [r.line for r in parse(raw).refusals]


@pytest.mark.parametrize(
    "record",
    [
        b"GOTO/1.5,-2.,.5,0.,0.6,0.8",
        b"goto / 1.5 , -2.000, +0.5 ,0,.6,8.0E-1\r\n",
        b"GOTO / 1.5, -2.0, 0.50,  $\r\n 0.0, 0.6, 0.8\r\n",
        b"GOTO / 1.5, $\n -2.0, 0.50, 0.0,$ text\n 0.6, 0.8 $$ GOTO/9,9,9\n",
        b"\xef\xbb\xbfGOTO/1.5,-2,0.5,0,0.6,0.8\0\0",
        b"  GOTO/1.5,-2,0.5,0,1.2,1.6",
    ],
)
def test_spelling_does_not_change_a_point(record):
    program = parse(record)
    assert not program.refusals
    assert program.position_mm.tolist() == [[1.5, -2, 0.5]]
    assert program.line.tolist() == [1]
    np.testing.assert_allclose(program.convention.rotation(program.orientation)[0, :, 2], [0, 0.6, 0.8])
    assert [float(program.raw[a:b]) for a, b in program.span[0, :3]] == [1.5, -2, 0.5]


def test_a_point_without_axis_keeps_the_one_before_and_only_its_place_is_corrected():
    program = parse(b"GOTO/1.000,2.000,3.000\nGOTO/1.0,2.0,3.0,0.0,1.0,0.0\n" + b"GOTO/4.0,5.0,6.0\n" * 3)
    assert program.orientation.tolist() == [[0, 0, 1], *[[0, 1, 0]] * 4]
    assert program.position_only.all()
    assert moved(program, by=(0.1, 0, 0)).raw.count(b"GOTO/4.1,5.0,6.0\n") == 3


def test_multax_off_sets_the_axis_upright():
    program = parse(
        b"MULTAX/ON\n"
        + WHOLE.replace(b"0.0,1.0", b"1.0,0.0")
        + b"MULTAX / OFF\nGOTO/1.0,2.0,3.0\nTLAXIS/1,0,0\nGOTO/1,1,1\n"
    )
    assert program.orientation.tolist() == [[0, 1, 0], [0, 0, 1], [1, 0, 0]]


def test_rapid_is_for_the_next_goto_only():
    program = parse(b"FROM/0,0,9\nRAPID\nFEDRAT/100\n" + WHOLE * 2 + b"RAPID/\n" + WHOLE * 2)
    assert program.kind.tolist() == ["FROM", "RAPID", "GOTO", "RAPID", "GOTO"]
    assert program.carries_force.tolist() == [False, False, True, False, True]


def test_a_dollar_at_the_end_of_prose_does_not_swallow_the_next_record():
    for before in (b"prose 5$\n", b"SPINDL/5,$\n", b"REMARK 5 $\n", b"$$ 5 $\n"):
        assert parse(before + b"RAPID\n" + WHOLE + WHOLE).kind.tolist() == ["RAPID", "GOTO"]
        assert parse(before + WHOLE).kind.tolist() == ["GOTO"]


def test_feeds_units_and_their_modal_words():
    raw = b"FEDRAT/MMPM,2864.7\nGOTO/1,2,3\nFEDRAT/1432.35\nGOTO/1,2,3\nFEDRAT/0.1,MMPR\nGOTO/1,2,3\nFEDRAT/ 10 , IPM\nGOTO/1,2,3\n"
    np.testing.assert_allclose(parse(raw).feed_mm_per_min, [2864.7, 1432.35, np.nan, 254])
    program = parse(b"UNITS/INCHES\nFEDRAT/10\nGOTO/1,2,3\n")
    assert program.position_mm.tolist() == [[25.4, 50.8, pytest.approx(76.2)]]
    assert program.feed_mm_per_min.tolist() == [254]
    assert refused_lines(b"UNIT/MM\nGOTO/1,2,3\nUNITS / INCHES\nGOTO/1,2,3\n") == [4]


@pytest.mark.parametrize(
    ("records", "refused", "why"),
    [
        (b"GODLTA/0,0,1\n", [2], "GODLTA"),
        (b"GOTO/P1\n", [2], "literal number"),
        (b"GOTO/1,2\n", [2], "2 numbers"),
        (b"GOTO/1,2,3,4,5,6,7\n", [2], "7 numbers"),
        (b"GOTO/1,2,3,0,0,0\nGOTO/1,2,3\n" + WHOLE, [2, 3], "axis without direction (0, 0, 0) in line 2"),
        (b"CYCLE/DRILL,5,MMPM,100\n" + WHOLE + b"CYCLE/OFF\n" + WHOLE, [3], "CYCLE in line 2"),
        (b"CUTCOM/LEFT\n" + WHOLE + b"CUTCOM/OFF\n" + WHOLE, [3], "CUTCOM/LEFT"),
        (b"MODE/INCR\n" + WHOLE, [3], "MODE/INCR"),
        (b"TRANS/1,0,0\n" + WHOLE + b"TRANS/0,0,0\n" + WHOLE, [3], "TRANS"),
        (b"ROTABL/45\n" + WHOLE, [3], "ROTABL"),
        (b"COPY/1,TRANSL,1,0,0,3\n" + WHOLE, [3], "COPY"),
        (b"MSYS/1,0,0,1,0,0,0,1,0\n" + WHOLE, [3], "another coordinate system"),
        (b"CSYS/1.,0,0,-59.5,0,1.,0,-59.5,0,0,1.,19.\n" + WHOLE, [3], "another coordinate system"),
        (b"SETUP/END,1\nSETUP/START,2\n" + WHOLE, [4], "another coordinate system or clamping since line 3"),
        (b"PSIS/PL1\nTLLFT,GOFWD/C1,PAST,L2\n", [1, 3], "starts here"),
        (b"HELIX/1,2\n", [2], "HELIX"),
        (b"REMARK two\n   GOTO/1,2,3\n", [3], "text or motion"),
    ],
)
def test_what_is_no_literal_point_of_the_tool_is_refused_with_its_line(records, refused, why):
    program = parse(WHOLE + records)
    assert [r.line for r in program.refusals] == refused
    assert any(why in r.reason for r in program.refusals)
    lines = program.raw.splitlines()
    assert all(moved(program).raw.splitlines()[line - 1] == lines[line - 1] for line in refused)


def test_a_stated_coordinate_system_must_stay_the_same():
    catia = b"$$*CATIA0\n$$ Manufacturing Program.1\n" + b"".join(
        b"$$    %d.0  %d.0 0.0  0.0\n" % r for r in [(1, 0), (0, 1), (0, 0)]
    )
    creo = b"$$-> CSYS / 1.0, 0.0, 0.0, 0.0, $\n 0.0, 1.0, 0.0, 0.0, $\n 0.0, 0.0, 1.0, 0.0\n"
    for stated in (catia, creo):
        assert refused_lines(stated + WHOLE + stated + WHOLE) == []
        other = stated.replace(b"1.0", b"0.5", 1)
        lines = (stated + WHOLE + other).count(b"\n")
        assert refused_lines(stated + WHOLE + other + WHOLE) == [lines + 1]
        assert refused_lines(stated + WHOLE + other + WHOLE + stated + WHOLE) == [lines + 1]


def test_text_comments_and_unknown_records_stay_and_mean_nothing():
    raw = (
        b"Information listing created by : cam\n\xef\xbb\xbfTOOL PATH/POCKET,TOOL,MILL\nPARTNO GOTO/9,9,9 $\nREMARK a remark that\n"
        b"    goes on without a mark RAPID\n  RAPID\nPPRINT/'it''s $$ 5',$\nSYN/'TLAXIS','$$*TLAXIS'\n$$-> CUTTER / 12.0, $\n 0.5\n"
        b"1STPECK\nLOADTL/1,LENGTH,2\nSPINDL/RPM,3000,CLW\nINDIRV/0,1,0\nPAINT/COLOR,1\nP1=POINT/1,2,3\nprice 5$\n"
        + WHOLE
        + b"FINI\nthat is all"
    )
    program = parse(raw)
    assert program.line.tolist() == [18]
    assert program.carries_force.all()
    assert not program.refusals
    assert not program.notes
    assert moved(program).raw == raw.replace(b"1.0,2.0,3.0", b"1.1,1.7,3.6")


@pytest.mark.parametrize(
    ("arc", "what"),
    [
        (b"CIRCLE/0.,0.,0.,0,0,1,5.\nGOTO/-5.0,0.0,0.0\n", "--linearise"),
        (b"CIRCLE/0.,0.,0.,0,0,-1.\nGOTO/0.0,5.0,0.0\n", "--linearise"),
        (b"CIRCLE/0.,0.,0.,0,0,1,6.\nGOTO/-5.0,0.0,0.0\n", "its radius is 6 mm"),
        (b"CIRCLE/0.,0.,0.,0,0,0,5.\nGOTO/-5.0,0.0,0.0\n", "no direction"),
        (b"CIRCLE/CENTER,P1\nGOTO/-5.0,0.0,0.0\n", "not literal"),
        (b"CIRCLE/0,0,0,0,0,1,5\nGOTO/-5.0,0.0,0.0,0.0,1.0,0.0\n", "axis turns"),
    ],
)
def test_an_arc_stays_and_so_does_the_point_it_starts_from(arc, what):
    program = parse(b"GOTO/9.0,0.0,0.0,0.0,0.0,1.0\nGOTO/5.0,0.0,0.0\n" + arc + WHOLE)
    assert [r.line for r in program.refusals] == [2, 4]
    assert what in program.refusals[1].reason
    assert program.corrected.tolist() == [True, False, False, True]


def test_an_axis_is_printed_as_it_was_written():
    program = parse(b"GOTO/1.0,2.0,3.0,0.000,0.600,0.800\n")
    out = moved(program, by=(0, 0, 0), axis=np.array([[0.1, 0.59, 0.8012]]))
    assert out.raw == b"GOTO/1.0,2.0,3.0,0.100,0.590,0.801\n"


def test_the_ways_of_creo_nx_solidworks_and_catia_are_kept_byte_for_byte():
    raw = (
        b"$$-> MFGNO / A\r\n$$-> CSYS / 1.0000000000, 0.0000000000, 0.0000000000, 0.0, $\r\n         0.0, 1.0, 0.0, 0.0, $\r\n"
        b"         0.0, 0.0, 1.0, 0.0\r\nUNIT/MM\r\n1STPECK\r\nRAPID/\r\nGOTO / 351.7389525618, 98.4998561102, 144.0966038928,  $\r\n"
        b"0.9997838891, 0.0000000000, 0.0207889000\r\nFEDRAT / 8000.000000,  MMPM\r\nGOTO / 341.7389525618, 98.4998561102, 134.0966038928,  $\r\n"
        b"0.9997838891, 0.0000000000, 0.0207889000\r\nGOTO/331.7,98.4,134.0\nCIRCLE/95.,44.2,-3.,0,0,-1.\nGOTO/331.7,98.5,134.0\nTLON,GOFWD/ (CIRCLE/ 25.0,$\n"
        b" 10.0, 0.0,$\n 10.0),ON,(LINE/ 25.0, 10.0, 0.0, 25.0, 20.0, 0.0)\nGOTO/1.5,2.5,3.5\nSYN/'TLAXIS','$$*TLAXIS'\nFINI"
    )
    program = parse(raw)
    assert program.line.tolist() == [8, 11, 13, 15, 19]
    assert program.kind.tolist() == ["RAPID", *["GOTO"] * 4]
    assert program.corrected.tolist() == [False, True, False, False, True]
    assert [r.line for r in program.refusals] == [13, 15, 16]
    assert moved(program, by=(0, 0, 0)).raw == raw
    out = moved(program, by=(1, 0, 0)).raw
    assert out == raw.replace(b"341.7389525618", b"342.7389525618").replace(b"/1.5,2.5", b"/2.5,2.5")


def test_files_are_recognised_and_a_file_without_motion_says_what_was_expected(tmp_path):
    for content in (WHOLE, b"prose\n\n goto / 1,2,3\n", b"\xef\xbb\xbfGOTO/1,2,3\n"):
        (tmp_path / "cam.txt").write_bytes(content)
        assert read_program(tmp_path / "cam.txt").dialect == "apt"
    with pytest.raises(InputError, match="no motion"):
        parse(b"PARTNO x\nFINI\n")


number = st.tuples(
    st.sampled_from(["", "-", "+"]), st.integers(0, 99), st.sampled_from([".", ".5", ".250", ".12345678", ""])
)
filler = st.sampled_from(
    [
        "$$ GOTO/1,2,3",
        "REMARK x",
        "SPINDL/ON",
        "FEDRAT/100,MMPM",
        "",
        "prose 5$",
        "MULTAX",
        "SYN/'A','$$B'",
        "GODLTA/1,0,0",
        "\xef\xbb\xbf",
    ]
)


@st.composite
def programs(draw):
    """Text and the spans of numbers that a correction may change."""
    text, spans = "", []
    for _ in range(draw(st.integers(1, 8))):
        if draw(st.booleans()):
            line = draw(filler)
            text += line
        else:
            rapid = draw(st.booleans())
            text += "RAPID\n" * rapid + draw(st.sampled_from(["GOTO/", "goto / ", "  GOTO  /"]))
            for place in range(6):
                sign, integer, tail = draw(number)
                token = sign + str(integer + (place == 5)) + tail
                if not rapid:
                    spans.append((len(text), len(text) + len(token)))
                text += token + ("" if place == 5 else draw(st.sampled_from([",", " , ", ", $\n   ", ",$\r\n"])))
        text += draw(st.sampled_from(["\n", "\r\n"]))
    return text, spans


@settings(max_examples=25, deadline=None)
@given(programs(), st.integers(0, 2**32 - 1))
def test_the_contract_holds(generated, seed):
    text, spans = generated
    head = "GOTO/1,2,3,0,0,1\n"
    raw = (head + text).encode("latin-1")
    holds_contract(
        Apt(),
        raw,
        [(5 + 2 * n, 6 + 2 * n) for n in range(6)] + [(a + len(head), b + len(head)) for a, b in spans],
        seed,
    )


@settings(max_examples=25, deadline=None)
@given(programs(), st.binary(max_size=30), st.integers(0, 10**6))
def test_damaged_bytes_never_crash_the_reader(generated, noise, where):
    raw = generated[0].encode("latin-1")
    at = where % len(raw)
    damaged = WHOLE + raw[:at] + noise + raw[at + len(noise) // 2 :]
    program = parse(damaged)
    assert moved(program, by=(0, 0, 0)).raw == damaged
