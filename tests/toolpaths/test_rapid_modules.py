"""RAPID programs of several modules: points that one declares and another goes to."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from contract import holds_contract

from drake_stiffness.errors import InputError
from toolpaths.formats import read_program
from toolpaths.formats.rapid import Rapid
from toolpaths.result import Compensation
from toolpaths.rewriting import rewrite

AXES = "[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]"
MAIN = b"""MODULE Main
PROC main()
  MoveL p1,vMill,z1,tMill\\WObj:=block;
  MoveL p2,vMill,z1,tMill\\WObj:=block;
ENDPROC
ENDMODULE ! and no line end"""
POINTS = f"""MODULE Points
! MoveL p1 in a comment
CONST robtarget p1:=[[20.00,20,10.5],[0,1,0,0],{AXES}];
PERS robtarget p2:=[[40.00,20,10.5],[0.0,1.0,0.0,0.0],{AXES}];
CONST speeddata vMill:=[50,20,5000,1000];
ENDMODULE
""".encode()


def parse(main=MAIN, points=POINTS, **more):
    others = [("Points.mod", points), *((f"{name}.mod", content) for name, content in more.items())]
    return Rapid().parse(main, "Main.mod", others)


def test_points_of_another_module_are_corrected_there():
    program = parse()
    assert program.refusals == ()
    assert program.line.tolist() == [3, 4]
    np.testing.assert_array_equal(program.position_mm, [[20, 20, 10.5], [40, 20, 10.5]])
    np.testing.assert_array_equal(program.feed_mm_per_min, [3000, 3000])
    out = rewrite(program, program.position_mm + [1, 0, -0.25], program.orientation, np.ones(2, bool))
    assert out.parts[0] == MAIN
    assert out.parts[1] == POINTS.replace(b"[20.00,20,10.5]", b"[21.00,20,10.2]").replace(
        b"[40.00,20,10.5]", b"[41.00,20,10.2]"
    )


@pytest.mark.parametrize("seed", range(5))
def test_two_modules_keep_every_byte_that_is_no_number_of_a_pose(seed):
    offset = len(MAIN)
    movable = []
    for row in parse().span.tolist():
        movable += [tuple(span) for span in row]
    assert all(start >= offset for start, _ in movable)
    holds_contract(Rapid(), MAIN, movable, seed, [("Points.mod", POINTS)])


@pytest.mark.parametrize(
    ("points", "refused", "reason"),
    [
        (POINTS.replace(b"PERS robtarget p2", b"LOCAL PERS robtarget p2"), 4, "declares for itself alone"),
        (POINTS + b"PROC up()\n p2.trans.z:=p2.trans.z+1;\nENDPROC\n", 4, "line 8 of Points.mod uses too"),
        (POINTS + b"PROC up()\n MoveL p2,v5,z1,tMill\\WObj:=block;\nENDPROC\n", 4, "a motion there goes to it"),
        (POINTS.replace(b"p2:=[[40.00", b"p2:=[[nX"), 4, "not literal"),
    ],
)
def test_a_point_that_its_module_keeps_or_uses_is_refused(points, refused, reason):
    (refusal,) = parse(points=points).refusals
    assert refusal.line == refused
    assert reason in refusal.reason


def test_a_point_of_two_modules_and_of_none_is_refused():
    assert "declared twice" in parse(More=POINTS).refusals[0].reason
    assert "--with" in Rapid().parse(MAIN, "Main.mod").refusals[0].reason


def test_a_module_s_own_point_goes_before_that_of_another():
    own = MAIN.replace(b"PROC main", b"LOCAL " + POINTS.splitlines()[2].replace(b"20.00", b"77.00") + b"\nPROC main")
    assert parse(own).position_mm[0, 0] == 77.0


def test_motions_of_another_module_stay_and_this_is_said():
    program = parse(
        Paths=b"MODULE Paths\nPROC a()\nMoveL [[1,2,3],[0,1,0,0]," + AXES.encode() + b"],v5,z1,t;\nENDPROC\nENDMODULE\n"
    )
    assert len(program) == 2
    assert any("Paths.mod holds motions of its own" in warning for warning in program.warnings)


def test_modules_of_a_program_are_found_by_its_listing_or_given(tmp_path):
    for name, content in (("Main.mod", MAIN), ("Points.mod", POINTS)):
        (tmp_path / name).write_bytes(content)
    assert len(read_program(tmp_path / "Main.mod").refusals) == 2
    assert read_program(tmp_path / "Main.mod", beside=[tmp_path / "Points.mod"]).refusals == ()
    (tmp_path / "part.pgf").write_text("<Program>\n<Module>Main.mod</Module>\n<Module>Points.mod</Module>\n</Program>")
    program = read_program(tmp_path / "Main.mod")
    assert program.refusals == ()
    files = Compensation.files(SimpleNamespace(program=program, parts=(b"m", b"p")), tmp_path / "new.mod")
    assert files == [(tmp_path / "new.mod", b"m"), (tmp_path / "new_Points.mod", b"p")]
    (tmp_path / "part.nc").write_text("G1 X1 Y2 Z3\n")
    with pytest.raises(InputError, match="has one file"):
        read_program(tmp_path / "part.nc", beside=[Path("Points.mod")])
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "points.mod").write_bytes(POINTS)
    with pytest.raises(InputError, match="another file of this name"):
        read_program(tmp_path / "Main.mod", beside=[tmp_path / "b" / "points.mod"])
