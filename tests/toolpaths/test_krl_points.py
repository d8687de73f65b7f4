"""KUKA programs whose points have names: in the .dat, in the .src, in arrays; frames of inline forms; feeds and status."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from toolpaths.formats import naming_notes, paths_beside, read_again, read_program
from toolpaths.formats.krl import Krl
from toolpaths.rewriting import rewrite

PROGRAMS = Path(__file__).parents[3] / "shared" / "data" / "programs"
FULL = b"LIN {X 1.0,Y 2.0,Z 3.0,A 10.0,B 20.0,C 30.0}\n"
POSE = b"{X 1.00,Y 2.00,Z 3.00,A 10.00,B 20.00,C 30.00,S 2,T 34,E1 0.0}"
DAT = b"""&ACCESS RVP
DEFDAT PART
DECL E6POS XP4=%s
  ;DECL E6POS XP4={X 9}
DECL FDAT FP4={TOOL_NO 3,BASE_NO 1,IPO_FRAME #BASE,POINT2[] " "}
E6POS XP10 = {E6POS: X 7.5 , Y -0.000 , Z 3.25, A 0, B 90, C -130.82 , S 2, T 34 }
DECL E6AXIS XHOME={A1 0.0,A2 -90.0,A3 90.0,A4 0.0,A5 0.0,A6 0.0}
DECL FRAME gfCNCPOINT[3]
gfCNCPOINT[1  ]={X 13.228,Y 0.0,Z 1.0,A 0.0,B -0.000,C 0.000}
gfCNCPOINT[2  ]={X 14.228,Y 0.0,Z 1.0,A 0.0,B -0.000,C 0.000}
gfCNCPOINT[3  ]={X 15.228,Y 0.0,Z 1.0,A 0.0,B -0.000,C 0.000}
gsMill[1]={fCnC {X 1.0,Y 1.0,Z 1.0,A 0.0,B 0.0,C 0.0}, grFeedrate 127.32}
gsMill[2]={fCnC {X 2.0,Y 1.0,Z 1.0,A 0.0,B 0.0,C 0.0}, grFeedrate 127.32}
DECL INT giLast = 3
DECL E6POS XTWICE={X 1,Y 1,Z 1,A 0,B 0,C 0}
XTWICE={X 2,Y 1,Z 1,A 0,B 0,C 0}
DECL POS XSHORT={X 1,Y 1,Z 1}
ENDDAT
""".replace(b"%s", POSE)


def parse(source, dat=DAT):
    return Krl().parse(source, "part.src", [] if dat is None else [("part.dat", dat)])


def moved(program, by_mm=(0.12, -0.34, 0.56), by_deg=0.0, **options):
    everything = np.ones(len(program), bool)
    return rewrite(program, program.position_mm + by_mm, program.orientation + by_deg, everything, **options)


def test_a_point_of_the_dat_is_corrected_there_and_the_source_stays():
    source = b"DEF part()\nlin xp4 C_VEL\nSLIN XP10 WITH $ACC=SACC_CP(LCPDAT1) C_Spl\n"
    program = parse(source)
    assert program.refusals == ()
    np.testing.assert_array_equal(program.position_mm, [[1, 2, 3], [7.5, 0, 3.25]])
    out = moved(program)
    assert out.parts[0] == source
    assert out.parts[1] == DAT.replace(
        b"=" + POSE, b"=" + POSE.replace(b"1.00,Y 2.00,Z 3.00", b"1.12,Y 1.66,Z 3.56")
    ).replace(b"X 7.5 , Y -0.000 , Z 3.25", b"X 7.6 , Y -0.340 , Z 3.81")
    back = read_again(program, out.parts)
    np.testing.assert_allclose(back.position_mm, program.position_mm + (0.12, -0.34, 0.56), atol=0.05 + 1e-9)


def test_zero_correction_leaves_both_files_the_same_bytes():
    program = parse(b"DEF part()\r\nLIN XP4\r\nLIN gfCNCPOINT[2]")
    assert moved(program, by_mm=0.0).parts == (b"DEF part()\r\nLIN XP4\r\nLIN gfCNCPOINT[2]", DAT)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b"LIN XNONE", "in no file"),
        (b"LIN XTWICE", "numbers in 2 places"),
        (b"LIN XSHORT", "does not write all"),
        (b"LIN XHOME", "axis angles"),
        (b"LIN gfCNCPOINT[counter] C_VEL", r"'gfCNCPOINT\[counter\]'.*index is not a literal"),
        (b"LIN MESA:XP4", "frame before ':'"),
        (b"LIN XP4:XP10", "frame before ':'"),
        (b"LIN_REL XP4", "relative"),
        (b"LIN gsMill[1]", "brace inside"),
        (b"LIN XP4\nx = xp4.X", "line 3 uses too"),
        (b"LIN XP4\nMESA.X=XP4.X -100", "line 3 uses too"),
        (b"LIN XP4\nXP4.Z = 3", "line 3 uses too"),
        (b"LIN XP4\nmove_to(XP4)", "line 3 uses too"),
        (b"LIN gfCNCPOINT[2]\ngfCNCPOINT[n] = P", "line 3 uses too"),
        (b"LIN XP4\nXP4 = {X 1,Y 2,Z 3,A 0,B 0,C 0}", "2 places"),
        (b"DEF sub(XP4 :IN)\nLIN XP4", "line 2 uses too"),
    ],
)
def test_a_point_that_is_not_certain_is_refused(line, reason):
    program = parse(FULL + line + b"\n")
    assert len(program.refusals) == 1
    assert re.search(reason, program.refusals[0].reason)
    assert not program.corrected[1:].any()
    assert moved(program).parts[1] == DAT


def test_what_only_looks_like_another_use_of_a_point_is_none():
    source = b'DEF part()\nDECL E6POS XP4\n;x=XP4.X\nmsg="XP4"\ns.XP4=3\nLIN XP4\nLIN XP4X\ngfCNCPOINT[2].X=3\nLIN gfCNCPOINT[1]\n'
    assert [r.line for r in parse(source).refusals] == [7]


def test_a_point_given_numbers_once_in_the_source_is_corrected_there():
    source = b"DEF part()\nDECL E6POS XP1\nXP1={X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}\nLIN XP1\nEND\n"
    out = moved(parse(source, dat=None))
    assert out.raw == source.replace(b"X 1.0,Y 2.0,Z 3.0", b"X 1.1,Y 1.7,Z 3.6")
    twice = parse(source.replace(b"END", b"XP1={X 5.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}\nEND"), dat=None)
    assert "2 places" in twice.refusals[0].reason


def test_a_point_used_by_a_point_to_point_move_too_must_stay():
    program = parse(b"LIN XP4\nPTP XP4\n")
    out = moved(program)
    assert out.parts[1] == DAT
    (refusal,) = out.refusals
    assert refusal.line == 1
    assert "stored point" in refusal.reason


def test_a_plain_for_is_the_motions_it_stands_for():
    body = b"FOR counter = 1 TO %s\n $VEL.CP = 0.1\n LIN gfCNCPOINT[ Counter ] C_VEL\nENDFOR\n"
    for last in (b"3", b"GILAST"):
        program = parse(FULL + body % last)
        assert program.refusals == ()
        assert program.line.tolist() == [1, 4, 4, 4]
        np.testing.assert_array_equal(program.position_mm[1:, 0], [13.228, 14.228, 15.228])
        assert moved(program).parts[1].count(b"Y -0.3,Z 1.6") == 3
    struct = parse(b"FOR i=1 TO 2\n$VEL.CP=gsMill[i].grFeedrate\nLIN gsMill[i].fCNC\nENDFOR\n")
    np.testing.assert_array_equal(struct.position_mm[:, 0], [1, 2])
    assert struct.refusals == ()


def test_a_call_in_a_for_whose_counter_is_its_own_changes_no_point():
    loop = b"DEF main( )\n%s\nFOR i=1 TO 2\n%s\nLIN gsMill[i].fCNC C_VEL\nENDFOR\nEND\n"
    program = parse(loop % (b"DECL INT i", b"ChangeSpeed(gsMill[i].grfeedrate)"))
    assert program.refusals == ()
    np.testing.assert_array_equal(program.position_mm[:, 0], [1, 2])
    assert not program.follows.any()  # the call may move the arm
    for declared, call in [
        (b"", b"sub(2)"),
        (b"INT i", b"sub(i)"),
        (b"INT i", b"sub(2) WAIT SEC 1"),
        (b"INT j", b"f()"),
    ]:
        assert len(parse(loop % (declared, call)).refusals) == 1
    # The point itself handed over may be changed by what is called.
    assert len(parse(loop % (b"INT i", b"sub(gsMill[i].fCNC)")).refusals) == 2


@pytest.mark.parametrize(
    "body",
    [
        b"counter = counter + 1\nLIN gfCNCPOINT[counter]",
        b"IF x THEN\nLIN gfCNCPOINT[counter]\nENDIF",
        b"LIN gfCNCPOINT[counter+1]",
        b"sub()\nLIN gfCNCPOINT[counter]",
        b"$BASE = BASE_DATA[2]\nLIN gfCNCPOINT[counter]",
    ],
)
def test_another_loop_is_refused(body):
    program = parse(FULL + b"FOR counter=1 TO 3\n" + body + b"\nENDFOR\n")
    assert len(program.refusals) == 1
    assert len(program) == 1
    assert len(parse(FULL + b"FOR i=1 TO 99999999\nLIN gfCNCPOINT[i]\nENDFOR\n").refusals) == 1


def test_feeds_are_read_in_metres_a_second():
    source = (
        FULL
        + b"$VEL.CP=0.05\n"
        + FULL
        + b"BAS(#VEL_CP,0.1)\n"
        + FULL
        + b"S"
        + FULL[:-1]
        + b" WITH $VEL.CP = .5 C_SPL\n"
        b"$VEL={CP 2.0,ORI1 200.0}\n" + FULL + b"$VEL.CP=x\n" + FULL + b"$VEL.CP=0.05\nsub()\n" + FULL
    )
    np.testing.assert_allclose(parse(source).feed_mm_per_min, [np.nan, 3000, 6000, 30000, 120000, np.nan, np.nan])


def test_blends_are_read_as_c_dis_means_them_there():
    text = (
        b"%s\n$APO.CDIS = 0.5\n%s\n%s C_DIS\n%s C_VEL\n$APO = {CVEL 50,CDIS 2,CORI 5}\n%s C_DIS ; 7\nS%s WITH $APO.CDIS = 1.25 C_SPL\n"
        b"LDAT_ACT = LCPDAT1\nFDAT_ACT=FX\nBAS(#CP_PARAMS,0.5)\nLIN XP4 C_DIS\nsub()\n%s C_DIS\n"
    ).replace(b"%s", FULL.strip())
    dat = DAT + b"DECL LDAT LCPDAT1={VEL 0.5,ACC 100.0,APO_DIST 3.0,APO_FAC 50.0}\n"
    program = parse(text, dat)
    np.testing.assert_array_equal(program.blend_mm, [0.0, 0.0, 0.5, np.inf, 2.0, 1.25, 3.0, np.nan])


def test_status_counts_where_the_controller_heeds_it():
    source = b"PTP {X 1,Y 2,Z 3,A 0,B 0,C 0,S 6,T 2}\nPTP {X 1,S 'B001'}\nLIN {X 2,S 2,T 3}\nPTP XP4\nPTP {Z 1}\n"
    program = parse(source)
    assert program.status.tolist() == [[0, 1, 1], [1, 0, 0], [-1] * 3, [0, 1, 0], [-1] * 3]


def test_base_and_tool_come_from_the_data_of_the_inline_form():
    source = (
        b"$BASE=BASE_DATA[1]\n$TOOL=TOOL_DATA[3]\n" + FULL + b"FDAT_ACT=FP4\nBAS(#CP_PARAMS,0.5)\nLIN XP4\n"
        b"SLIN XP10 WITH $BASE=SBASE(FP4.BASE_NO), $TOOL=STOOL2(FP4), $IPO_MODE=SIPO_MODE(FP4.IPO_FRAME)\n" + FULL
    )
    program = parse(source)
    assert program.refusals == ()
    assert [f.line for f in program.frames] == [1, 2]  # they are the ones in force
    other = parse(source, DAT.replace(b"BASE_NO 1", b"BASE_NO 2"))
    assert [(f.line, f.what, f.key) for f in other.frames[2:]] == [(5, "base", "2")]
    assert np.allclose(program.feed_mm_per_min[1:], 30000)
    standing = parse(source, DAT.replace(b"#BASE", b"#TCP"))
    assert standing.refusals[0].fatal


def test_frames_that_the_program_writes_into_the_table_are_its_own_literals():
    table = b"BASE_DATA[6]={X 100,Y 0,Z 0,A 0,B 0,C 0}\n"
    for select in (b"BAS(#BASE,6)\n", b"$BASE=BASE_DATA[6]\n"):
        (frame,) = parse(table + select + FULL).frames
        assert (frame.origin, frame.pose) == ("literal", (100.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        assert parse(table + select.replace(b"6", b"5") + FULL).frames[0].origin == "controller"
        for write in (b"BASE_DATA[6].X=100\n", b"BASE_DATA[i]=f(1)\n", b"BASE_DATA[6]=BASE_DATA[7]\n"):
            assert parse(table + write + select + FULL).frames[0].origin == "expression"
    form = b"FDAT_ACT=FP9\nBAS(#CP_PARAMS,0.5)\nLIN XP4\n"
    data = DAT + b"DECL FDAT FP9={TOOL_NO 1,BASE_NO 6,IPO_FRAME #BASE}\n"
    frames = {frame.what: frame.origin for frame in parse(table + form, data).frames}
    assert frames == {"base": "literal", "tool": "controller"}
    assert parse(b"BAS(#EX_BASE,1)\n" + FULL).frames[0].origin == "expression"


def test_frames_of_one_segment_end_with_it():
    source = b"$BASE=BASE_DATA[2]\nSLIN XP10 WITH $BASE=SBASE(FP4.BASE_NO)\n" + FULL + b"SLIN XP10 WITH $BASE={X 1}\n"
    program = parse(source)
    assert [(f.line, f.what, f.key or f.text[-2:-1]) for f in program.frames if f.what == "base"] == [
        (1, "base", "2"),
        (2, "base", "1"),
        (3, "base", "2"),
    ]
    assert [r.line for r in program.refusals] == [4]


def test_the_dat_is_found_whatever_its_case(tmp_path):
    (tmp_path / "Part.src").write_bytes(b"DEF part()\nLIN XP4\n")
    (tmp_path / "PART.DAT").write_bytes(DAT)
    program = read_program(tmp_path / "Part.src")
    assert [Path(part.path).name for part in program.parts] == ["Part.src", "PART.DAT"]
    assert program.refusals == ()


def test_a_module_that_is_written_under_another_name_is_said():
    program = parse(b"LIN XP4\n")
    assert naming_notes(program, Path("out/part.src")) == []
    (note,) = naming_notes(program, Path("out/corrected.src"))
    assert "'PART'" in note
    assert "corrected.dat" in note


def test_a_dat_of_another_name_is_given_and_goes_beside_the_output_under_its_own(tmp_path):
    (tmp_path / "part.src").write_bytes(b"DEF part()\nLIN XP4\nEND\n")
    (tmp_path / "part.dat").write_bytes(b"DEFDAT PART\nENDDAT\n")
    (tmp_path / "points.dat").write_bytes(DAT.replace(b"DEFDAT PART", b"DEFDAT POINTS PUBLIC"))
    program = read_program(tmp_path / "part.src", beside=[tmp_path / "points.dat"])
    assert program.refusals == ()
    assert [path.name for path in paths_beside(program, Path("new.src"))] == ["new.dat", "new_points.dat"]
    assert sum("points" in note.lower() for note in naming_notes(program, Path("new.src"))) == 1


@st.composite
def stored_programs(draw):
    """A source and its .dat, with every point's name and the motions that go to it."""
    count = draw(st.integers(1, 6))
    number = st.decimals(-999, 999, places=draw(st.integers(0, 4)), allow_nan=False).map(lambda d: str(d).encode())
    newline = draw(st.sampled_from([b"\n", b"\r\n"]))
    names = [draw(st.sampled_from([b"XP%d", b"P[%d]", b"st[%d].f"])) % n for n in range(count)]
    dat, source = [b"DEFDAT x"], [b"DEF x()"]
    for name in names:
        head, _, member = name.partition(b".")
        gap = draw(st.sampled_from([b"", b" "]))
        pose = b"{" + b",".join(w + b" " + draw(number) for w in (b"X", b"Y", b"Z", b"A", b"B", b"C")) + gap + b"}"
        dat.append(b"DECL E6POS " + head + gap + b"=" + (b"{" + member + b" " + pose + b", v 1}" if member else pose))
    for _ in range(draw(st.integers(1, 8))):
        name = draw(st.sampled_from(names))
        kind = draw(st.sampled_from([b"LIN", b"SLIN", b"PTP"]))
        source.append(
            kind
            + b" "
            + draw(st.sampled_from([name, name.lower(), name.upper()]))
            + draw(st.sampled_from([b"", b" C_DIS"]))
        )
    return newline.join(source), newline.join([*dat, b"ENDDAT"])


@settings(max_examples=25, deadline=None)
@given(stored_programs(), st.integers(0, 2**31), st.booleans())
def test_stored_points_read_back_as_wanted_or_as_they_were(files, seed, common):
    program = Krl().parse(files[0], "x.src", [("x.dat", files[1])])
    assert program.refusals == ()
    rng = np.random.default_rng(seed)
    by = np.broadcast_to(rng.normal(0, 0.5, (1 if common else len(program), 6)), (len(program), 6))
    wanted = program.pose + by
    out = rewrite(program, wanted[:, :3], wanted[:, 3:], np.ones(len(program), bool))
    assert out.parts[0] == files[0]
    assert re.sub(rb"[-\d]", b"", out.parts[1]) == re.sub(rb"[-\d]", b"", files[1])  # only digits and signs differ
    back = read_again(program, out.parts)
    expected = np.where(out.changed[:, None], wanted, program.pose)
    limit = np.where(out.changed[:, None], 0.5 * program.quantum * (1 + 1e-6), 0) + 1e-9
    assert (np.abs(back.pose - expected) <= limit).all()
    left = set(program.line[program.corrected & ~out.changed].tolist())
    assert left <= {r.line for r in out.refusals}
    if common:  # one correction for all: only points that a point-to-point motion goes to as well must stay
        shared = {tuple(s) for s in program.span[~program.carries_force, 0].tolist()}
        alone = np.array([tuple(span) not in shared for span in program.span[:, 0].tolist()])
        assert out.changed[program.carries_force & alone].all()


@pytest.mark.skipif(not PROGRAMS.is_dir(), reason="the shared programs are not on this machine")
def test_the_real_program_with_a_dat_is_read_with_it():
    program = read_program(PROGRAMS / "mimic_example.src")
    assert len(program.parts) == 2
    assert len(program) == 0
    assert program.refusals == ()
