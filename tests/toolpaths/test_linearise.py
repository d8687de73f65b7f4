"""Arcs of G-code and APT replaced by straight moves: within the tolerance, the right way round, nothing else touched."""

import numpy as np
import pytest

from drake_stiffness.errors import InputError
from toolpaths.formats.apt import Apt
from toolpaths.formats.gcode import GCode
from toolpaths.formats.krl import Krl
from toolpaths.linearise import linearise
from toolpaths.program import line_before

TOLERANCE = 0.02


def straight(raw, tolerance=TOLERANCE):
    dialect = Apt() if b"GOTO" in raw else GCode()
    return linearise(dialect.parse(raw, "test"), tolerance)


def chords(points, steps=7):
    """Points along the straight moves, ends included."""
    t = np.linspace(0, 1, steps)[:, None, None]
    return (points[:-1] + t * (points[1:] - points[:-1])).reshape(-1, 3)


def turned(points, center, axes):
    """Angle turned about a center in the plane of two axes, rad, with its sign."""
    u = (points - center)[:, axes]
    step = u[:-1, 0] * u[1:, 1] - u[:-1, 1] * u[1:, 0], (u[:-1] * u[1:]).sum(axis=1)
    return float(np.arctan2(*step).sum())


# Start, block, center, first and second axis of the plane (G2 goes from the second to the first), degrees turned.
ARCS = [
    (b"X10 Y0 Z1", b"G3 X0 Y10 I-10 J0", (0, 0), (0, 1), 90),
    (b"X10 Y0 Z1", b"G2 X0 Y10 I-10", (0, 0), (0, 1), -270),
    (b"X10 Y0 Z1", b"g2i-10", (0, 0), (0, 1), -360),
    (b"X10 Y0 Z1", b"G03 X-10 J0 I-10 Z7", (0, 0), (0, 1), 180),
    (b"X10 Y0 Z1", b"G3 X0 Y10 R10", (0, 0), (0, 1), 90),
    (b"X10 Y0 Z1", b"G3 X0 Y10 R-10", (10, 10), (0, 1), 270),
    (b"X10 Y0 Z1", b"G2 X0 Y10 R10", (10, 10), (0, 1), -90),
    (b"X0 Y2 Z10", b"G18 G3 X10 Z0 K-10 I0", (0, 0), (2, 0), 90),
    (b"X0 Y2 Z10", b"G18 G2 X10 Z0 K-10", (0, 0), (2, 0), -270),
    (b"X3 Y10 Z0", b"G19 G3 Y0 Z10 J-10 X8", (0, 0), (1, 2), 90),
    (b"X3 Y10 Z0", b"G19 G2 J-10", (0, 0), (1, 2), -360),
]


@pytest.mark.parametrize(("start", "block", "center", "axes", "degrees"), ARCS)
def test_chords_stay_within_the_tolerance_and_turn_as_the_arc_does(start, block, center, axes, degrees):
    program = straight(b"G1 " + start + b"\n" + block + b"\nG1 X1 Y1 Z1\n")
    assert not program.refusals
    assert set(program.kind) == {"G1"}
    points = program.position_mm[:-1]
    plane, third = list(axes), 3 - sum(axes)
    middle = np.zeros(3)
    middle[plane] = center
    off = np.abs(np.linalg.norm((chords(points) - middle)[:, plane], axis=1) - 10)
    assert 0.3 * TOLERANCE < off.max() <= TOLERANCE
    assert np.degrees(turned(points, middle, plane)) == pytest.approx(degrees, abs=0.02)
    rise = points[-1, third] - points[0, third]  # a helix climbs evenly
    np.testing.assert_allclose(points[:, third], points[0, third] + rise * np.linspace(0, 1, len(points)), atol=6e-4)


def test_a_tighter_tolerance_needs_more_moves():
    lines = [len(straight(b"G1 X10 Y0 Z0\nG2 I-10\n", tolerance)) for tolerance in (1.0, 0.1, 0.01, 0.001)]
    assert lines[0] < lines[1] < lines[2] < lines[3]
    assert lines[3] == pytest.approx(np.pi / np.arccos(1 - 1e-4), rel=0.2)


def test_the_rest_of_the_line_and_of_the_file_stays():
    raw = b"%\r\nG0 X0 Y0 Z0\r\nN5 G17 G2 X2.00 Y0 I1 J0 F99.5 (round) \r\nX4.00 I1\r\nG1 X5\r\n%"
    out = straight(raw, 0.2).raw
    assert out == (
        b"%\r\nG0 X0 Y0 Z0\r\nN5 G17 G1 X0.500 Y0.866 Z0.000 F99.5 (round) \r\nG1 X1.500 Y0.866 Z0.000\r\nG1 X2.00 Y0 Z0.000\r\n"
        b"G1 X2.500 Y0.866 Z0.000\r\nG1 X3.500 Y0.866 Z0.000\r\nG1 X4.00 Y0.000 Z0.000\r\nG1 X5\r\n%"
    )


def test_every_replaced_line_is_listed_and_old_line_numbers_are_found():
    program = straight(b"G1 X10 Y0 Z0\nX11\nG3 X9 I-1\nX8\nM5\n".replace(b"X8", b"G1 X8"), 0.2)
    (arc,) = program.replaced
    assert (arc.line, arc.before, arc.new_line) == (3, "G3 X9 I-1", 3)
    assert arc.after.splitlines() == program.raw.decode().splitlines()[2:5]
    assert [line_before(program.replaced, line) for line in range(1, 8)] == [1, 2, 3, 3, 3, 4, 5]


def test_without_arcs_the_program_is_the_same():
    raw = b"G1 X10 Y0 Z0\nX11\n"
    assert straight(raw).raw == raw
    assert straight(raw).replaced == ()


def test_inches_are_inches():
    program = straight(b"G20 G1 X1 Y0 Z0\nG2 I-1 J0\n")
    off = 25.4 - np.linalg.norm(chords(program.position_mm)[:, :2], axis=1)
    assert 0.3 * TOLERANCE < off.max() <= TOLERANCE


@pytest.mark.parametrize(
    "arc",
    [
        b"G2 X12 Y0 I-10",
        b"G2 X#1 I-10",
        b"G2 X8 Y0 I-1 P2",
        b"G2 X8 Y0 I-1 M5",
        b"G2 X8 Y0",
        b"/G2 X8 Y0 I-1",
        b"G2 X8 Y0 I-1 K3",
    ],
)
def test_what_is_no_clear_arc_stays_and_stays_refused(arc):
    program = straight(b"G1 X10 Y0 Z0\n" + arc + b"\nG1 X1 Y1 Z1\n")
    assert arc in program.raw
    assert 2 in [r.line for r in program.refusals]


def test_an_arc_that_must_stay_is_not_left_without_its_g2():
    with pytest.raises(InputError, match=r"line 3.*G2 or G3.*line 2"):
        straight(b"G1 X10 Y0 Z0\nG2 X8 Y0 I-1\nX6 Y5 I-1\n")


def test_a_circle_of_apt_turns_to_the_left_about_its_axis():
    for axis, way in ((b"0,0,1", 180), (b"0,0,-1.", -180)):
        raw = b"GOTO/10.0,0.0,5.0\nCIRCLE/0,0,5," + axis + b",10.0\nFEDRAT/100\nGOTO / -10.0, 0.0, 5.0\nGOTO/0,0,9\n"
        program = straight(raw)
        points = program.position_mm[:-1]
        assert np.degrees(turned(points, np.zeros(3), [0, 1])) == pytest.approx(way, abs=0.02)
        assert 0.3 * TOLERANCE < (10 - np.linalg.norm(chords(points)[:, :2], axis=1)).max() <= TOLERANCE
        assert b"FEDRAT/100\nGOTO / " in program.raw
        assert program.raw.endswith(b"GOTO / -10.0, 0.0, 5.0\nGOTO/0,0,9\n")
        assert not program.refusals


def test_a_circle_in_space_with_a_tool_axis():
    raw = b"GOTO/0.0,0.0,10.0,1.0,0.0,0.0\nCIRCLE/0,0,0,1,0,0,10.0\nGOTO/0.0,0.0,-10.0,1.0,0.0,0.0\n"
    program = straight(raw)
    np.testing.assert_allclose(np.linalg.norm(program.position_mm, axis=1), 10, atol=6e-4)
    assert (program.position_mm[1:-1, 1] < 0).all()  # to the left about x, from +z towards -y
    assert (program.orientation == [1, 0, 0]).all()
    assert program.written.all()


def test_a_circle_of_catia_ends_at_its_line_and_starts_along_indirv():
    lines = b"INDIRV/ 0,%d,0\nTLON,GOFWD/ (CIRCLE/ 25.0, 10.0, 0.0,$\n 10.0),ON,(LINE/ 25.0, 10.0, 0.0,$\n 25.0, 12.0, 0.0)\nGOTO/1,1,1\n"
    for sense, way in ((1, 90), (-1, -270)):
        program = straight(b"GOTO/35.0,10.0,0.0\n" + lines % sense)
        points = program.position_mm[:-1]
        np.testing.assert_allclose(points[-1], [25, 20, 0], atol=1e-9)
        assert np.degrees(turned(points, np.array([25, 10, 0]), [0, 1])) == pytest.approx(way, abs=0.02)
        assert not program.refusals
    assert straight(b"GOTO/35.0,10.0,0.0\n" + lines.replace(b"10.0)", b"11.0)") % 1).refusals


def test_a_tolerance_and_a_dialect_that_make_no_sense_are_refused():
    for tolerance in (0.0, -1.0, 1e-6, np.nan, np.inf):
        with pytest.raises(InputError, match="--linearise"):
            straight(b"G1 X1 Y1 Z1\n", tolerance)
    with pytest.raises(InputError, match="krl"):
        linearise(Krl().parse(b"LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\n", "a.src"), 0.1)
