"""ABB RAPID: what is a target, what is refused, what decides the branch, and what a rewrite leaves alone."""

import numpy as np
import pytest

from drake_stiffness.errors import InputError
from toolpaths.formats import DIALECTS, rapid
from toolpaths.formats.rapid import Rapid
from toolpaths.process import check_frames
from toolpaths.rewriting import rewrite

T1 = "[[1,2,3],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
T2 = "[[4.0,5.0,6.0],[0.70711,0,0.70711,0],[-1,0,-1,1],[150.5,9E+09,9E9,9E9,9E9,9E9]]"
TAIL = ",v100,z1,tMill\\WObj:=block;"


def parse(*lines):
    return Rapid().parse("\n".join(lines).encode("latin-1"), "test.mod")


@pytest.mark.parametrize(
    "text",
    [
        f"MoveL {T1},v100,z1,tMill\\WObj:=block;",
        f"movel\t{T1} , V100 , fine , tMill \\WObj := block ;",
        f"MoveL {T1}\\ID:=73, v100\\V:=100, z1\\Inpos:=inpos50, tMill\\WObj:=block;",
        f"MoveL \\Conc, {T1},[100,500,5000,1000],[FALSE,1,1,1,1,1,1],tMill\\WObj:=block\\TLoad:=load1;",
        "MoveL [ [ 1 , 2.,\r\n 3.0 ] ! a comment; MoveL\r\n,[0, +1, 0, -0.0],[0,0,0,0],\n[9E9,9E9,9E9,9E9,9E9,9E9]],v100,z1,tMill\\WObj:=block;",
        f'TPWrite "MoveL p10; ! not a comment"; MoveL {T1}{TAIL} ! MoveL {T2}{TAIL}',
        f"IF di1=1 MoveL {T1}{TAIL}",
        f"IF a>1 OR b THEN MoveL {T1}{TAIL} ENDIF",
        f"MoveLDO {T1},v100,z1,tMill\\WObj:=block,do1,1;",
        f"CONST robtarget p10:={T1}; again: MoveL p10{TAIL}",
        f"LOCAL PERS robtarget P10 := {T1};\nMoveL p10 \\ID:=5{TAIL}",
    ],
)
def test_spelling_does_not_change_a_target(text):
    program = parse(text)
    assert not program.refusals
    np.testing.assert_array_equal(program.position_mm, [[1, 2, 3]])
    np.testing.assert_array_equal(program.orientation, [[0, 1, 0, 0]])
    assert program.carries_force.all()
    assert program.feed_mm_per_min == [6000.0]
    assert [setting.key for setting in program.frames] == ["TMILL", "BLOCK"]


def test_ordinary_statements_read_the_same_by_the_general_reader(monkeypatch):
    lines = [
        f"CONST robtarget p{i}:=[[{i}.5,2,3],[0,1,0,0],[0,0,0,{i % 9}],[{i},9E9,9E9,9E9,9E9,9E9]];" for i in range(9)
    ]
    for i in range(18):
        target = f"p{i % 9}" if i % 2 else T2.replace("4.0", f"{i}.0")
        lines.append(f"  {'MoveL' if i % 3 else 'MoveJ'} {target},v{100 + i},z1,tMill\\WObj:=block;")
    quick = parse(*lines)
    for name in ("MOVE_LITERAL", "MOVE_NAMED"):
        monkeypatch.setattr(rapid.words, name, rapid.re.compile(b"(?!)"))
    general = parse(*lines)
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
        "blend_mm",
    ):
        np.testing.assert_array_equal(getattr(quick, name), getattr(general, name), err_msg=name)
    assert quick.frames == general.frames


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("MoveL RelTool(p90, 0, 50, 0), v100, z5, drill\\WObj:=block;", "'RelTool(p90, 0, 50, 0)', which is computed"),
        ("MoveL Offs(p10,0,0,5),v100,z5,t;", "computed"),
        ("MoveL p10,v100,z5,t;", "not declared in this file"),
        ("MoveL pts{3},v100,z5,t;", "computed"),
        ("MoveL *,v100,z5,t;", "the target *"),
        ("MoveL [[x0,2,3],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,z5,t;", "not a literal robtarget"),
        ("MoveL [[1,2,3],[0,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,z5,t;", "length zero"),
        ("MoveL [[1,2],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,z5,t;", "not a literal robtarget"),
        (f"MoveL {T1},v100;", "2 arguments"),
        (f"MoveL {T1},v100,z1,tMill\\WObj:=block\\Corr;", "added to this motion"),
        ("SearchL di1, sp, p10, v100, t;", "SearchL"),
        (f"PDispOn \\Rot, p10, tMill;\nMoveL {T1}{TAIL}", "displaced"),
        (
            f"PERS tooldata t:=[FALSE,[[0,0,1],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\nMoveL {T1},v10,z1,t;",
            "stationary",
        ),
        (
            f'PERS wobjdata w:=[FALSE,FALSE,"STN1",[[0,0,1],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\nMoveL {T1},v1,z1,t\\WObj:=w;',
            "moving unit",
        ),
        (f"MoveL {T1}{TAIL} MoveL {T1},v100,z1,tMill\\WObj:=other;", "two settings of the base on one line"),
    ],
)
def test_targets_that_are_not_in_the_text_are_refused_with_line_and_reason(text, reason):
    program = parse("MODULE m", text, "ENDMODULE")
    assert reason in program.refusals[0].reason
    assert program.refusals[0].line in (2, 3)


def test_joint_moves_carry_no_force_and_are_no_reason_to_refuse():
    program = parse(
        "MoveAbsJ [[0,0,0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tMill;",
        f"MoveJ {T1}{TAIL}",
        "MoveJ Offs(p10,0,0,1),v9,z1,t;",
        f"MoveL {T2}{TAIL}",
    )
    assert program.kind.tolist() == ["MOVEJ", "MOVEL"]
    assert program.carries_force.tolist() == [False, True]
    assert program.follows.tolist() == [False, False]
    assert program.refusals == ()
    assert len(program.notes) == 1


def test_external_axes_of_9e9_are_not_there():
    program = parse(f"MoveL {T1}{TAIL}", f"MoveL {T2}{TAIL}", f"MoveL {T1}{TAIL}")
    np.testing.assert_array_equal(program.external[:, 0], [np.nan, 150.5, np.nan])
    assert np.isnan(program.external[:, 1:]).all()


def test_confdata_says_the_branch_only_while_it_is_supervised():
    moves = [f"MoveL {T1.replace('0,0,0,0]', f'0,0,0,{cfx}]')}{TAIL}" for cfx in (0, 1, 2, 4, 7, 9)]
    bits = [[0, 0, 0], [0, 0, 1], [0, 1, 0], [1, 0, 0], [1, 1, 1], [-1, -1, -1]]
    assert parse(*moves).status.tolist() == bits
    assert (parse("ConfL \\Off;", *moves).status == -1).all()
    assert parse("ConfL\\Off;", "ConfL\\On;", *moves).status.tolist() == bits


@pytest.mark.parametrize(
    ("speed", "mm_per_min"),
    [
        ("v50", 3000),
        ("cut", 720),
        ("[20,500,5000,1000]", 1200),
        ("vmax", np.nan),
        ("v10\\V:=7", 420),
        ("v5\\T:=2", np.nan),
    ],
)
def test_speeds_are_millimetres_a_second(speed, mm_per_min):
    program = parse("VAR speeddata cut:=[12,500,5000,1000];", f"MoveL {T1},{speed},z1,tMill;")
    np.testing.assert_array_equal(program.feed_mm_per_min, [mm_per_min])


@pytest.mark.parametrize(
    ("zone", "mm"),
    [
        ("fine", 0.0),
        ("z0", 0.3),
        ("Z5", 5.0),
        ("z1\\Z:=0.7\\Inpos:=inpos50", 0.7),
        ("fine\\Inpos:=inpos50", 0.0),
        ("zMine", 0.8),
        ("zStop", 0.0),
        ("z3", np.nan),
    ],
)
def test_zones_are_the_tool_s_radius(zone, mm):
    program = parse(
        "VAR zonedata zMine:=[FALSE,0.8,1,1,0.1,1,0.1];",
        "CONST zonedata zStop := [ TRUE, 5,1,1,0.1,1,0.1];",
        f"MoveL {T1},v100,{zone},tMill\\WObj:=block;",
        f"MoveC {T1},{T2},v100,{zone},tMill\\WObj:=block;",
    )
    np.testing.assert_array_equal(program.blend_mm, [mm, 0.0, mm])


def test_both_poses_of_an_arc_are_targets():
    program = parse(f"MoveL {T2}{TAIL}", f"MoveC {T1},{T2}{TAIL}")
    assert program.role.tolist() == ["point", "via", "end"]
    assert program.carries_force.all()
    zero = parse(f"MoveC {T1},{T1.replace('[0,1,0,0]', '[0,0,0,0]')}{TAIL}")
    assert zero.refused.all()


def test_a_declared_point_gone_to_twice_is_printed_once():
    program = parse(
        "MODULE m",
        f"CONST robtarget p10:={T1};",
        f"MoveL p10{TAIL}",
        f"MoveL {T2}{TAIL}",
        f"MoveL p10{TAIL}",
        "ENDMODULE",
    )
    shift = np.array([2.0, -3.0, 4.0])
    out = rewrite(program, program.position_mm + shift, program.orientation, np.ones(3, bool))
    assert out.changed.all()
    assert b"robtarget p10:=[[3,-1,7]," in out.raw
    apart = rewrite(program, program.position_mm + np.outer([1, 1, 2], shift), program.orientation, np.ones(3, bool))
    assert apart.changed.tolist() == [False, True, False]
    assert "same stored point" in apart.refusals[0].reason


@pytest.mark.parametrize(
    "other",
    [
        f"MoveJ p10{TAIL}",
        f"MoveL Offs(p10,0,0,9){TAIL}",
        "p10.trans.x:=7;",
        "drill p10;",
        "p20:=p10;",
        "VAR robtarget q:=p10;",
        f"IF p10.trans.x>5 MoveJ {T1}{TAIL}",
    ],
)
def test_a_declared_point_that_something_else_needs_is_not_corrected(other):
    program = parse(f"CONST robtarget p10:={T1};", f"MoveL p10{TAIL}", other)
    out = rewrite(program, program.position_mm + 2.0, program.orientation, np.ones(len(program), bool))
    assert not out.changed[0]
    assert out.raw == program.raw
    assert 2 in {r.line for r in (*program.refusals, *out.refusals)}


def test_points_of_the_same_name_belong_to_their_routines():
    program = parse(
        "PROC a()",
        f"VAR robtarget p:={T1};",
        f"MoveL p{TAIL}",
        "ENDPROC",
        "PROC b()",
        f"VAR robtarget p:={T2};",
        f"MoveL p{TAIL}",
        "ENDPROC",
    )
    np.testing.assert_array_equal(program.position_mm[:, 0], [1, 4])
    twice = parse(f"VAR robtarget p:={T1};", f"VAR robtarget p:={T2};", f"MoveL p{TAIL}")
    assert "declared twice" in twice.refusals[0].reason


def frame_program(tool="[0,0,400],[1,0,0,0]", user="[1650,-100,700],[1,0,0,0]", more="", inner="[0,0,50],[1,0,0,0]"):
    return parse(
        f"PERS tooldata tMill:=[TRUE,[{tool}],[90,[0,0,250],[1,0,0,0],0,0,0]];",
        f'TASK PERS wobjdata block:=[FALSE,TRUE,"",[{user}],[{inner}]];',
        more,
        f"MoveL {T1}{TAIL}",
    )


def test_frames_that_the_module_holds_must_agree(model, tools):
    process = tools.process()
    p = model.tcp[1] * 1e3
    good = f"[{p[0]},{p[1]},{p[2]}],[0,0.70711,0,0.70711]"  # half a turn about x + z
    check_frames(process, frame_program(good), model)
    # A user frame turned by 90 degrees about z, the object frame in it turned back: its x is the workpiece's -y.
    turned = "[1750,-150,750],[0.70711,0,0,0.70711]"
    check_frames(process, frame_program(good, turned, inner="[50,100,0],[0.70711,0,0,-0.70711]"), model)
    with pytest.raises(InputError, match=r"block: differs from workpiece of process\.yaml by 10\.000 mm"):
        check_frames(process, frame_program(good, "[1650,-100,710],[1,0,0,0]"), model)
    with pytest.raises(InputError, match="differs from tool"):
        check_frames(process, frame_program(good.replace("[0,0.7", "[0,0.8")), model)
    with pytest.raises(InputError, match="the base frame is computed"):
        check_frames(process, frame_program(good, more="block.uframe.trans.x := 7;"), model)
    changed = parse(f"MoveL {T1},v1,z1,t1\\WObj:=cellA1;", f"MoveL {T1},v1,z1,t1\\WObj:=cellB1;")
    with pytest.raises(InputError, match="the base frame changes between corrected motions"):
        check_frames(process, changed, model)
    check_frames(
        process,
        parse(f"MoveL {T1},v1,z1,t1\\WObj:=w;", f"MoveJ {T1},v1,z1,t1;", f"MoveL {T1},v1,z1,t1\\WObj:=w;"),
        model,
    )


def test_a_vanishing_coordinate_becomes_a_number_a_controller_reads():
    program = parse(f"MoveL {T1.replace('[1,2', '[8.99826150854451E-31,2')}{TAIL}")
    out = rewrite(program, program.position_mm + 0.25, program.orientation, np.ones(1, bool))
    assert b"[[2.50000000000000E-01,2," in out.raw


def test_modules_are_recognised_from_their_content():
    for raw in (
        b"%%%\r\n  VERSION:1\r\n%%%\r\nMODULE Path",
        f"  MoveL {T1}{TAIL}".encode(),
        f"  CONST robtarget p:={T1};".encode(),
    ):
        assert [d.name for d in DIALECTS if d.recognises(raw, ".txt")] == ["rapid"]
    with pytest.raises(InputError, match="found no motion"):
        parse("MODULE m", "ENDMODULE")
