"""CSV tables: units in names, and errors with line and column."""

import numpy as np
import pytest

from drake_stiffness.errors import InputError
from drake_stiffness.tables import read_table


def table(tmp_path, text):
    path = tmp_path / "t.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_table(path, "a table")


@pytest.mark.parametrize(
    ("suffix", "unit"),
    [("_mm", 1e-3), ("_m", 1), ("_um", 1e-6), ("_deg", np.pi / 180), ("_rad", 1), ("_mrad", 1e-3), ("_N", 1), ("_kN", 1e3), ("_Nm", 1), ("_kNm", 1e3)],
)  # fmt: skip
def test_a_suffix_is_its_unit(tmp_path, suffix, unit):
    t = table(tmp_path, f"a{suffix}\n-2.5e1\n")
    assert t.quantity("a", (suffix,), required=True) == pytest.approx([-25 * unit], rel=1e-15)


def test_lines_are_those_of_the_file_blank_ones_and_line_breaks_in_cells_included(tmp_path):
    t = table(tmp_path, 'a,note\r\n1,"two\r\nlines"\r\n\r\n  ,\r\n2,x\r\n')
    assert t.numbers("a").tolist() == [1.0, 2.0]
    assert t.lines[1] == 6
    assert t.text("absent") == ["", ""]


BAD = {
    "word": ("a\n1\nx\n", ["line 3", "column 'a'", "'x'", "a number"]),
    "empty cell": ("a,b\n1,2\n,2\n", ["line 3", "column 'a'", "empty cell"]),
    "nan": ("a\nNaN\n", ["line 2", "column 'a'", "'NaN'", "finite"]),
    "inf": ("a\n-inf\n", ["line 2", "'-inf'", "finite"]),
    "comma for point": ("a;b\n1,5;2\n", ["line 1", "';'", "commas"]),
    "ragged": ("a,b\n1,2\n1\n", ["line 3", "1 cells", "2 columns"]),
    "header only": ("a,b\n", ["no rows"]),
    "commas only": (",,\n,,\n", ["t.csv"]),
    "spaces only": (" , \n", ["t.csv"]),
    "column twice": ("a,a\n1,2\n", ["line 1", "'a'", "twice"]),
    "open quote": ('a\n"1\n', ["t.csv", "not a CSV table"]),
    "latin": (b"a\n\xe4\n", ["byte 2", "UTF-8"]),
    "nothing": ("", ["empty", "a table"]),
    "digits with underscores": ("a\n1_0\n", ["line 2", "'1_0'", "a number"]),
}


@pytest.mark.parametrize("name", list(BAD))
def test_what_is_wrong_with_a_table_is_said_with_line_and_column(tmp_path, name):
    text, words = BAD[name]
    with pytest.raises(InputError) as error:
        table(tmp_path, text).numbers("a")
    for word in ["t.csv", *words]:
        assert word in str(error.value)


@pytest.mark.parametrize("cell", ["1.5", "-1"])
def test_whole_numbers_are_whole_and_not_negative(tmp_path, cell):
    with pytest.raises(InputError, match=f"line 3, column 'step': found '{cell}'; expected a whole number from 0"):
        table(tmp_path, f"step\n0\n{cell}\n").whole_numbers("step")


def test_a_quantity_is_written_once_and_in_a_known_unit(tmp_path):
    t = table(tmp_path, "a_mm,a_m,B_mm\n1,2,3\n")
    with pytest.raises(InputError, match="a_mm and a_m say the same thing twice"):
        t.quantity("a", ("_mm", "_m"), required=True)
    with pytest.raises(InputError, match=r"missing column 'b_mm' or 'b_m'\. There is 'B_mm'"):
        t.quantity("b", ("_mm", "_m"), required=True)
    assert t.quantity("c", ("_mm",), required=False) is None
    with pytest.raises(InputError, match=r"unknown column 'B_mm'.*Did you mean 'b_mm'"):
        t.refuse_unknown({"a_mm", "a_m", "b_mm"}, "predicted_")
    table(tmp_path, "a_mm,predicted_x\n1,2\n").refuse_unknown({"a_mm"}, "predicted_")
