"""Fanuc TP listings: points apart from motions, what shifts a target, groups, frames, and what a rewrite leaves alone."""

import numpy as np
import pytest
from contract import holds_contract
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_stiffness.errors import InputError
from toolpaths.formats import DIALECTS, fanuc
from toolpaths.formats.fanuc import Fanuc
from toolpaths.process import check_frames
from toolpaths.rewriting import rewrite

JOINTS = "P[9]{\n   GP1:\n\tUF : 0, UT : 1,\t\n\tJ1=     0.000 deg,\tJ2=   -10.000 deg\n};"


def point(number, x="1.000", config="N U T, 0, 0, 0", frame="UF : 1, UT : 2", more="", name="", gap=""):
    return (
        f"P[{number}{name}]{gap}{{\n   GP1:\n\t{frame},\t\tCONFIG : '{config}',\n"
        f"\tX =  {x}  mm,\tY =   -20.5  mm,\tZ =  30.000  mm,\n\tW =   -70.737 deg,\tP =    11.951 deg,\tR =   -35.487 deg{more}\n}};"
    )


def listing(motions, points):
    head = ["/PROG  TEST", "/ATTR", "OWNER\t\t= MNEDITOR;", "/MN"]
    return "\n".join([*head, *motions, "/POS", *points, "/END"]) + "\n"


def parse(motions, points):
    return Fanuc().parse(listing(motions, points).encode("latin-1"), "test.ls")


@pytest.mark.parametrize(
    "motion",
    [
        "   1:L P[1] 100mm/sec CNT50    ;",
        "   1:L P[1:start point] 100mm/sec FINE ACC80    ;",
        "    :  L  P[ 1 ] 100.0mm/sec CNT 100 COORD PTH ;",
        ":l p[1] 600cm/min fine Wjnt ;",
        "  1:L P[1] 100mm/sec CNT R[3] ACC R[4] TB  .50sec,CALL GRIP(1,2) ;",
        "  1:L P[1] 100mm/sec FINE Skip,LBL[5] BREAK Arc Start[1] ;",
        "  1:  --eg:comment L P[2] 10mm/sec ;\n  2:  !L P[2] 9mm/sec FINE ;\n  3:L P[1] 100mm/sec FINE ;\n  4://L P[2] 9mm/sec FINE ;",
        "  1:L P[1]\n   :  100mm/sec\n   :  FINE ;",
    ],
)
def test_spelling_does_not_change_a_motion(motion):
    program = parse([motion], [point(1, gap=" "), point(2, x="7.0")])
    assert not program.refusals
    np.testing.assert_array_equal(program.position_mm, [[1, -20.5, 30]])
    np.testing.assert_array_equal(program.orientation, [[-70.737, 11.951, -35.487]])
    assert program.carries_force.all()
    assert program.feed_mm_per_min == [6000.0]


def test_fine_stops_cnt_blends_by_speed_and_cr_by_a_distance():
    ends = ["FINE", "CNT0", "CNT50 ACC80", "CNT R[3]", "CR20", "CD 5mm PTH", "ACC100"]
    program = parse([f"  {n}:L P[1] 100mm/sec {end} ;" for n, end in enumerate(ends, 1)], [point(1)])
    assert not program.refusals
    np.testing.assert_array_equal(program.blend_mm, [0.0, 0.0, np.inf, np.inf, 20.0, 5.0, np.nan])


def test_ordinary_lines_read_the_same_by_the_general_reader(monkeypatch):
    points = [point(n, x=f"{n}.5", config=f"{'NF'[n % 2]} U T, 0, 0, 0") for n in range(1, 9)]
    motions = [f"  {n}:{'JL'[n % 2]} P[{n}] {n}0{'%' if n % 2 == 0 else 'mm/sec'} CNT{n} ;" for n in range(1, 9)]
    quick = parse(motions, points)
    monkeypatch.setattr(fanuc.words, "MOVE", fanuc.words.re.compile(b"(?!)"))
    general = parse(motions, points)
    for name in (
        "line",
        "kind",
        "pose",
        "external",
        "status",
        "span",
        "source",
        "refused",
        "carries_force",
        "feed_mm_per_min",
    ):
        np.testing.assert_array_equal(getattr(quick, name), getattr(general, name), err_msg=name)
    assert quick.frames == general.frames


@pytest.mark.parametrize(
    ("motion", "reason"),
    [
        ("L P[1] 100mm/sec FINE Offset,PR[1] ;", "'Offset,PR[1]' behind the motion"),
        ("L P[1] 100mm/sec FINE Tool_Offset,PR[15] ;", "'Tool_Offset,PR[15]'"),
        ("L P[1] 100mm/sec CNT5 INC ;", "'INC'"),
        ("L P[1] 100mm/sec CNT5 RTCP ;", "'RTCP'"),
        ("L P[1] 100mm/sec CNT5 VOFFSET,VR[1] ;", "'VOFFSET,VR[1]'"),
        ("L PR[3] 100mm/sec FINE ;", "a position register"),
        ("L P[7] 100mm/sec FINE ;", "P[7], which is not in /POS"),
        ("L P[8] 100mm/sec FINE ;", "P[8], which is no whole literal pose"),
        ("L P[9] 100mm/sec FINE ;", "P[9], which holds joint angles"),
        ("C P[1] 100mm/sec FINE ;", "no end point"),
        ("S P[1] 100mm/sec FINE ;", "spline"),
    ],
)
def test_targets_that_are_not_in_the_listing_are_refused_with_line_and_reason(motion, reason):
    program = parse(["  1:" + motion], [point(1), point(8, x="********"), JOINTS])
    (refusal,) = program.refusals
    assert refusal.line == 5
    assert reason in refusal.reason or (motion[0] == "C" and "FINE" in refusal.reason)
    assert not program.corrected.any()


def test_an_indirect_point_may_be_any_point_and_makes_the_others_unsafe():
    program = parse(["  1:L P[1] 100mm/sec FINE ;", "  2:L P[R[5]] 100mm/sec FINE ;"], [point(1)])
    assert [r.line for r in program.refusals if r.fatal] == [6]


def test_joint_motions_carry_no_force():
    program = parse(
        ["  1:J P[9] 100% FINE ;", "  2:J P[1] 50% CNT100 ;", "  3:J PR[1] 5% FINE ;", "  4:A P[2] WELD_SPEED CNT9 ;"],
        [point(1), point(2), JOINTS],
    )
    assert program.kind.tolist() == ["J", "A"]
    assert program.carries_force.tolist() == [False, True]
    assert program.refusals == ()
    assert program.follows.tolist() == [False, False]


def test_a_circular_motion_has_two_points_on_one_or_two_lines():
    program = parse(
        [
            "  1:L P[1] 1mm/sec FINE ;",
            "  2:C P[2]    ",
            "    :  P[3] 60cm/min FINE    ;",
            "  3:C P[2] : P[3] 10inch/min FINE ;",
        ],
        [point(1), point(2), point(3)],
    )
    assert program.role.tolist() == ["point", "via", "end", "via", "end"]
    np.testing.assert_allclose(program.feed_mm_per_min, [60, 600, 600, 254, 254])
    assert program.line.tolist() == [5, 6, 6, 8, 8]


def test_config_says_the_branch():
    configs = ["N U T, 0, 0, 0", "F U T, 0, 0, 0", "N D T, 0, 0, 0", "N U B, 0, 0, -1", "F L D B, 0, 0, 0", "0, 0, 0"]
    program = parse(
        [f"  {n}:L P[{n}] 1mm/sec FINE ;" for n in range(1, 7)], [point(n, config=c) for n, c in enumerate(configs, 1)]
    )
    assert program.status.tolist() == [[0, 0, 0], [0, 0, 1], [0, 1, 0], [1, 0, 0], [1, 1, 1], [-1, -1, -1]]


GROUP = "\n   GP2:\n\tUF : 0, UT : 1,\t\n\tJ1=   {}  mm,\tJ2 = 4.0 deg"


def test_further_groups_stay_and_external_axes_are_read():
    program = parse(
        ["  1:L P[1] 1mm/sec FINE ;", "  2:L P[2] 1mm/sec FINE ;"],
        [point(1, more=",\n\tE1=   12.5 mm,\tE2 = -3 deg"), point(2, more=GROUP.format(5))],
    )
    np.testing.assert_array_equal(program.external[:, :2], [[12.5, -3.0], [np.nan, np.nan]])
    assert program.corrected.all()
    assert "further motion groups" in program.warnings[0]


def test_coordinated_motion_needs_a_positioner_that_stands_still(model, tools):
    still = parse(
        ["  1:L P[1] 1mm/sec CNT9 COORD ;", "  2:L P[2] 1mm/sec CNT9 COORD ;"],
        [point(n, more=GROUP.format(5)) for n in (1, 2)],
    )
    check_frames(tools.process(), still, model)
    moving = parse(
        ["  1:L P[1] 1mm/sec CNT9 COORD ;", "  2:L P[2] 1mm/sec CNT9 COORD ;"],
        [point(n, more=GROUP.format(n)) for n in (1, 2)],
    )
    with pytest.raises(InputError, match="further groups at"):
        check_frames(tools.process(), moving, model)


def test_user_frames_and_tools_are_those_of_the_points(model, tools):
    motions = [
        "  1:  UFRAME_NUM=3 ;",
        "  2:L P[1] 1mm/sec FINE ;",
        "  3:J P[2] 10% FINE ;",
        "  4:L P[1] 1mm/sec FINE ;",
    ]
    program = parse(motions, [point(1, frame="UF : F, UT : F"), point(2, frame="UF : 7, UT : 2")])
    assert [(s.what, s.key) for s in program.frames][:2] == [("base", "3"), ("tool", "as set on the controller")]
    check_frames(tools.process(), program, model)
    for other in ("UF : 8, UT : 2", "UF : 1, UT : 5"):
        changed = parse(["  1:L P[1] 1mm/sec FINE ;", "  2:L P[2] 1mm/sec FINE ;"], [point(1), point(2, frame=other)])
        with pytest.raises(InputError, match="changes between corrected motions"):
            check_frames(tools.process(), changed, model)
    again = parse(
        ["  1:L P[1] 1mm/sec FINE ;", "  2:  UFRAME[1]=PR[4] ;", "  3:L P[2] 1mm/sec FINE ;"], [point(1), point(2)]
    )
    assert "sets a frame while it runs" in again.warnings[0]
    with pytest.raises(InputError, match="changes between corrected motions"):
        check_frames(tools.process(), again, model)


@pytest.mark.parametrize(
    "other", ["PR[9]=P[1] ;", "J P[1] 10% FINE ;", "L P[1] 1mm/sec FINE Offset,PR[1] ;", "P[1]=LPOS ;"]
)
def test_a_point_that_something_else_needs_is_not_corrected(other):
    program = parse(["  1:L P[1] 1mm/sec FINE ;", "  2:" + other], [point(1)])
    out = rewrite(program, program.position_mm + 2.0, program.orientation, np.ones(len(program), bool))
    assert not out.changed[0]
    assert out.raw == program.raw
    assert 5 in {r.line for r in (*program.refusals, *out.refusals)}


def test_a_point_gone_to_twice_is_printed_once():
    program = parse(["  1:L P[1] 1mm/sec FINE ;", "  2:L P[1] 600cm/min FINE ;"], [point(1)])
    out = rewrite(program, program.position_mm + 0.25, program.orientation, np.ones(2, bool))
    assert out.changed.all()
    assert b"X =  1.250  mm,\tY =   -20.2  mm,\tZ =  30.250  mm" in out.raw


@st.composite
def number(draw):
    decimals = draw(st.integers(0, 4))
    text = draw(st.sampled_from(["", "-"])) + str(draw(st.integers(0, 999)))
    return text + ("." + str(draw(st.integers(0, 10**decimals - 1))).zfill(decimals) if decimals else "")


@st.composite
def programs(draw):
    count = draw(st.integers(1, 4))
    motions, forced = [], set()
    for _ in range(draw(st.integers(1, 6))):
        kind = draw(st.sampled_from(["L", "L", "J", "C", "filler"]))
        n, m = draw(st.integers(1, count)), draw(st.integers(1, count))
        number_ = draw(st.sampled_from(["   1", "", " 12"]))
        tail = draw(
            st.sampled_from(["100mm/sec CNT50", "R[1]cm/min FINE ACC50", "5inch/min CNT100 PTH TB .5sec,CALL X"])
        )
        if kind == "filler":
            filler = [
                "  --eg:L P[1] 1mm/sec FINE",
                "  WAIT 1.00(sec)",
                " Arc Start[1]",
                "  IF R[1]=1,JMP LBL[1]",
                "------",
            ]
            motions.append(f"{number_}:{draw(st.sampled_from(filler))} ;")
        elif kind == "C":
            motions.append(
                f"{number_}:C P[{n}]{draw(st.sampled_from([chr(10) + '    : ', ' : ', ' ']))} P[{m}] {tail} ;"
            )
            forced |= {n, m}
        else:
            motions.append(f"{number_}:{kind} P[{n}] {'50% FINE' if kind == 'J' else tail}   ;")
            forced |= {n} if kind == "L" else set()
    text = "\n".join(["/PROG  T", "/ATTR", "/MN", *motions, "  9:J P[1] 1% FINE ;", "/POS", ""])
    movable = []
    for n in range(1, count + 1):
        text += f"P[{n}{draw(st.sampled_from(['', ':' + chr(34) + 'a' + chr(34)]))}]{draw(st.sampled_from(['', ' ']))}{{\n   GP1:\n\tUF : 0, UT : 1,\t\tCONFIG{draw(st.sampled_from([' ', '']))}: 'N U T, 0, 0, 0',\n"
        for place, word in enumerate("XYZWPR"):
            text += f"\t{word} ={draw(st.sampled_from(['  ', ' ', chr(9)]))}"
            token = draw(number())
            movable += [(len(text), len(text) + len(token))] if n in forced else []
            text += (
                token
                + (" mm" if place < 3 else " deg")
                + ("," if place < 5 else "")
                + ("\n" if place in (2, 5) else "")
            )
        text += (
            draw(st.sampled_from(["", "   GP2:\n\tUF : 0, UT : 1,\n\tJ1= 1.0 mm\n"]))
            + "};"
            + draw(st.sampled_from(["\n", "\r\n"]))
        )
    return text + draw(st.sampled_from(["/END\n", "/END", "", "/END\n\0\0"])), movable


@settings(max_examples=25, deadline=None)
@given(programs(), st.integers(0, 2**32 - 1))
def test_generated_programs_keep_every_byte_that_is_no_number_of_a_pose(generated, seed):
    text, movable = generated
    program, _ = holds_contract(Fanuc(), text.encode("latin-1"), movable, seed)
    spans = {tuple(span) for row in np.flatnonzero(program.carries_force) for span in program.span[row].tolist()}
    assert spans == set(movable)


@settings(max_examples=25, deadline=None)
@given(st.binary(max_size=40), st.integers(0, 10**6), programs())
def test_damaged_bytes_never_crash_the_reader(noise, where, generated):
    raw = generated[0].encode("latin-1")
    at = where % (len(raw) + 1)
    damaged = raw[:at] + noise + raw[at + len(noise) // 2 :]
    try:
        program = Fanuc().parse(damaged, "damaged.ls")
    except InputError:
        return
    out = rewrite(program, program.position_mm + 0.3, program.orientation, np.ones(len(program), bool))
    assert out.raw.count(b"\n") == damaged.count(b"\n")


def test_listings_are_recognised_from_their_content():
    raw = listing(["  1:L P[1] 1mm/sec FINE ;"], [point(1)]).encode()
    assert [d.name for d in DIALECTS if d.recognises(raw, ".txt")] == ["fanuc"]
    assert not Fanuc().recognises(b"/PROG is a word in this text\n", ".ls")
    with pytest.raises(InputError, match="found no motion"):
        parse(["  1:  WAIT 1.00(sec) ;"], [point(1)])
