"""CSV waypoints: only numbers of pose columns change, and a bad cell is named by line and column."""

import numpy as np
import pytest
from contract import holds_contract
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_stiffness.errors import InputError
from toolpaths.formats import read_program
from toolpaths.formats.waypoints_csv import WaypointsCsv
from toolpaths.program import quantum_deg, quantum_mm
from toolpaths.rewriting import rewrite

HEADER = b"x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\n"


def parse(raw):
    return WaypointsCsv().parse(raw, "points.csv")


def moved(program, by_mm, by_deg):
    return rewrite(program, program.position_mm + by_mm, program.orientation + by_deg, np.ones(len(program), bool)).raw


def test_only_pose_numbers_change():
    raw = (
        b'\xef\xbb\xbfname;"x_mm"; y_mm ;z_mm;line;c_deg;b_deg;a_deg;kind;note\r\n'
        b'p1;"1.00"; 2.000;-0.0;7;30.0;20.0;10.0;lin;"a; b"\r\n'
        b"\r\n"
        b"p2;1.00;2.000;3.0;8;30.0;20.0;10.0;PTP;caf\xe9\r\n"
        b"p3;1.00;+2.000;3.0;9;30.0;20.0;10.0;;"
    )
    program = parse(raw)
    assert program.line.tolist() == [2, 4, 5]
    assert program.kind.tolist() == ["LIN", "PTP", "LIN"]
    np.testing.assert_array_equal(program.orientation[0], [10, 20, 30])
    assert moved(program, 0.0, 0.0) == raw
    expected = (
        raw.replace(b'"1.00"; 2.000;-0.0;7;30.0;20.0;10.0', b'"1.12"; 2.120;0.1;7;30.2;20.2;10.2')
        .replace(b"1.00;+2.000;3.0;9;30.0;20.0;10.0", b"1.12;+2.120;3.1;9;30.2;20.2;10.2")
    )  # fmt: skip
    assert moved(program, 0.12, 0.2) == expected


def test_metres_and_radians_are_units_of_the_tokens():
    raw = b"x_m,y_mm,z_m,a_rad,b_rad,c_deg,e1_m,e2_rad\n1.0000,2.0,-0.5000,0.10000,0.20000,30.0,0.5,1\n"
    program = parse(raw)
    np.testing.assert_allclose(program.position_mm, [[1000, 2, -500]])
    np.testing.assert_allclose(program.orientation, [[np.degrees(0.1), np.degrees(0.2), 30]])
    np.testing.assert_allclose(program.external[0, :2], [500, np.degrees(1)])
    np.testing.assert_allclose(quantum_mm(program), 0.05)
    np.testing.assert_allclose(quantum_deg(program), 0.05)
    assert moved(program, 0.3, 0.0).endswith(b"1.0003,2.3,-0.4997,0.10000,0.20000,30.0,0.5,1\n")
    assert moved(program, 0.0, 0.0) == raw


def test_without_orientation_columns_the_position_alone_is_corrected():
    program = parse(b"x_mm,y_mm,z_mm\n1.0,2.0,3.0\n")
    assert program.position_only.all()
    assert program.corrected.all()
    assert np.isnan(program.orientation).all()
    assert moved(program, 0.2, 0.0) == b"x_mm,y_mm,z_mm\n1.2,2.2,3.2\n"


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (b"x_mm,y_mm,a_deg,b_deg\n1,2,3,4\n", ["missing column z_mm, c_deg"]),
        (b"x_mm,y_mm,z_inch\n1,2,3\n", ["'inch'", "mm, m"]),
        (b"x_mm,y_mm,z_mm,x_m\n1,2,3,4\n", ["x is given twice"]),
        (HEADER, ["no rows"]),
        (HEADER + b"1,2,3,4,5,6\n1,2,abc,4,5,6\n", ["line 3, column 3 (z)", "'abc'"]),
        (HEADER + b"1,2,3,4,nan,6\n", ["line 2, column 5 (b)", "'nan'"]),
        (HEADER + b"1,2,3,4,1e99,6\n", ["line 2", "'1e99'"]),
        (HEADER + b"1,,3,4,5,6\n", ["line 2, column 2 (y)", "''"]),
        (HEADER + b"1,2,3,4,5\n", ["line 2", "5 cells, expected 6"]),
        (HEADER + b'1,2,3,4,5,"6\n', ["line 2", "quotes"]),
        (b"x_mm;y_mm;z_mm\n1,5;2;3\n", ["line 2, column 1 (x)", "decimals need a point"]),
        (b"x_mm,y_mm,z_mm,kind\n1,2,3,CIRC\n", ["line 2", "'kind'", "'CIRC'", "LIN, SLIN"]),
    ],
)
def test_what_cannot_be_read_is_named(raw, words):
    with pytest.raises(InputError) as error:
        parse(raw)
    for word in ["points.csv", *words]:
        assert word in str(error.value)


@pytest.mark.parametrize("suffix", [".csv", ".txt"])
def test_a_table_is_recognised(tmp_path, suffix):
    path = tmp_path / f"points{suffix}"
    path.write_bytes(HEADER + b"1,2,3,4,5,6\n")
    assert read_program(path).dialect == "csv"


def test_no_row_makes_the_reader_hang():
    header = b"x_mm,y_mm,z_mm," + b",".join(b"c%d" % n for n in range(20)) + b"\n"
    row = b"1,2,3," + b",".join([b" " * 50] * 20)
    with pytest.raises(InputError, match="24 cells"):
        parse(header + row + b",x\n")


POSE = [("x_mm", "x_m"), ("y_mm", "y_m"), ("z_mm", "z_m"), ("a_deg", "a_rad"), ("b_deg", "b_rad"), ("c_deg", "c_rad")]
number = st.tuples(
    st.sampled_from(["", "-", "+"]),
    st.integers(0, 999),
    st.sampled_from(["", ".", ".5", ".2500", ".123456"]),
    st.sampled_from(["", "", "e-1", "E+0"]),
)


@st.composite
def tables(draw):
    """A table (latin-1) and the spans of the numbers that a correction may change."""
    names = [draw(st.sampled_from(pair)) for pair in POSE]
    names = draw(st.permutations([*names, "kind", "note", "e1_mm"]))
    separator, newline = draw(st.sampled_from([",", ";"])), draw(st.sampled_from(["\n", "\r\n"]))
    text, spans = separator.join(names) + newline, []
    for _ in range(draw(st.integers(1, 6))):
        kind = draw(st.sampled_from(["LIN", "lin", "", "SLIN", "PTP", "RAPID"]))
        for place, name in enumerate(names):
            before = draw(st.sampled_from(["", " "])) + draw(st.sampled_from(["", "", '"']))
            token = {"kind": kind, "note": "1.5 caf\xe9", "e1_mm": "7.50"}.get(name)
            if token is None:
                sign, whole, decimals, power = draw(number)
                token = f"{sign}{whole}{decimals}{power}"
                start = len(text) + bool(place) + len(before)
                spans += [(start, start + len(token))] if kind not in ("PTP", "RAPID") else []
            text += separator * bool(place) + before + token + before[::-1]
        text += newline * draw(st.integers(1, 2))
    return text, spans


@settings(max_examples=25, deadline=None)
@given(tables(), st.integers(0, 2**32 - 1))
def test_generated_tables_keep_every_byte_that_is_no_number_of_a_pose(generated, seed):
    text, movable = generated
    program, _ = holds_contract(WaypointsCsv(), text.encode("latin-1"), movable, seed)
    assert program.corrected.sum() * 6 == len(movable)
