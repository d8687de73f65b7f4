"""One path in every robot dialect: the same corrections, printed in the convention of each."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from toolpaths.formats.fanuc import Fanuc
from toolpaths.formats.krl import Krl
from toolpaths.formats.rapid import Rapid
from toolpaths.formats.urscript import UrScript
from toolpaths.formats.val3 import Val3
from toolpaths.job import compensate

# X, Y, Z in mm and KUKA A, B, C in deg of a small path in the workpiece's frame.
PATH = np.array(
    [
        [20.0, 20.0, -4.0, 0.0, -6.0, 164.0],
        [80.0, 25.0, -4.5, 2.0, -5.0, 165.0],
        [120.0, 60.0, -5.0, 4.0, -4.0, 166.0],
        [100.0, 100.0, -5.5, 1.0, -3.0, 163.0],
        [60.0, 110.0, -6.0, -2.0, -4.0, 162.0],
    ]
)
# KUKA's angles are turns about the axes z, y', x'' that move along: capital letters in scipy.
TURNS = Rotation.from_euler("ZYX", PATH[:, 3:], degrees=True)


def krl():
    lines = ["DEF path( )", "$BASE = BASE_DATA[1]"]
    lines += ["LIN {{X {:.5f},Y {:.5f},Z {:.5f},A {:.6f},B {:.6f},C {:.6f}}}".format(*row) for row in PATH]
    return Krl(), "\n".join(lines)


def rapid():
    quaternion = TURNS.as_quat()[:, [3, 0, 1, 2]]
    lines = ["MODULE path", "PROC main()"]
    for place, (row, q) in enumerate(zip(PATH, quaternion, strict=True)):
        target = "[[{:.5f},{:.5f},{:.5f}],[{:.8f},{:.8f},{:.8f},{:.8f}],[-1,0,-1,0],[9E9,9E9,9E9,9E9,9E9,9E9]]".format(
            *row[:3], *q
        )
        if place % 2:
            lines.insert(1, f"CONST robtarget p{place}:={target};")
            target = f"p{place}"
        lines.append(f"MoveL {target},v50,z1,spindle\\WObj:=block;")
    return Rapid(), "\n".join([*lines, "ENDPROC", "ENDMODULE"])


def fanuc():
    wpr = TURNS.as_euler("xyz", degrees=True)
    motions = [f"   {n}:L P[{n}] 50mm/sec CNT100    ;" for n in range(1, len(PATH) + 1)]
    points = [
        "P[{}]{{\n   GP1:\n\tUF : 1, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\n\tX = {:.5f}  mm,\tY = {:.5f}  mm,\tZ = {:.5f}  mm,\n"
        "\tW = {:.6f} deg,\tP = {:.6f} deg,\tR = {:.6f} deg\n}};".format(n, *row[:3], *angles)
        for n, (row, angles) in enumerate(zip(PATH, wpr, strict=True), 1)
    ]
    return Fanuc(), "\n".join(["/PROG  PATH", "/MN", *motions, "/POS", *points, "/END"])


def urscript():
    poses = np.column_stack([PATH[:, :3] / 1e3, TURNS.as_rotvec()])
    lines = [
        "movel(p[{:.8f}, {:.8f}, {:.8f}, {:.8f}, {:.8f}, {:.8f}], a=1, v=0.05, r=0.001)".format(*row) for row in poses
    ]
    lines[1] = lines[1].replace("movel(", "w = ").replace(", a=1, v=0.05, r=0.001)", "") + "\n  movel(w, a=1, v=0.05)"
    # A frame of the script itself: here the workpiece of the process.
    lines = [
        line.replace("movel(p", "movel(pose_trans(part, p")
        .replace("], a", "]), a")
        .replace("(w,", "(pose_trans(part, w),")
        for line in lines
    ]
    return UrScript(), "\n  ".join(["def main():", "part = p[1.65, -0.1, 0.75, 0, 0, 0]", *lines, "end"])


def val3():
    angles = TURNS.as_euler("XYZ", degrees=True)
    code = "\n".join(f"movel(p[{n}],tMill,mNom)" for n in range(len(PATH)))
    values = [
        '<Value key="{}" x="{:.5f}" y="{:.5f}" z="{:.5f}" rx="{:.6f}" ry="{:.6f}" rz="{:.6f}" />'.format(
            n, *row[:3], *turn
        )
        for n, (row, turn) in enumerate(zip(PATH, angles, strict=True))
    ]
    program = f'<Programs xmlns="http://www.staubli.com/robotics/VAL3/Program/2"><Code><![CDATA[begin\n{code}\nend]]></Code></Programs>'
    return (
        Val3(),
        program,
        '<Database><Datas><Data name="p" type="pointRx">\n' + "\n".join(values) + "\n</Data></Datas></Database>",
    )


def run(make, model, tools):
    dialect, text, *others = make()
    program = dialect.parse(text.encode(), "path", [("points", other.encode()) for other in others])
    result = compensate(program, model, tools.process())
    again = dialect.parse(result.parts[0], "path", [("points", part) for part in result.parts[1:]])
    return program, result, again.position_mm, again.convention.rotation(again.orientation)


@pytest.mark.parametrize("make", [rapid, fanuc, urscript, val3])
def test_every_dialect_corrects_the_same_path_alike(make, model, tools):
    reference = run(krl, model, tools)
    program, result, position, R = run(make, model, tools)
    np.testing.assert_allclose(program.convention.rotation(program.orientation), TURNS.as_matrix(), atol=1e-7)
    assert np.abs(result.correction_mm).max() > 0.3
    np.testing.assert_allclose(position, reference[2], atol=2e-5)
    np.testing.assert_allclose(R, reference[3], atol=2e-7)
    assert not np.allclose(R, TURNS.as_matrix(), atol=1e-5)
    assert result.after_mm.max() < 1e-4
