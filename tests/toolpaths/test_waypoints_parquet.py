"""Parquet tables of waypoints: the same promises as of text, and everything that is no pose is kept."""

import io
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drake_stiffness.errors import InputError
from drake_stiffness.files import write_together
from toolpaths.formats import files_of, read_again, read_program
from toolpaths.formats.pieces import pieces
from toolpaths.job import compensate
from toolpaths.long_programs import compensate_file
from toolpaths.rewriting import rewrite

pyarrow = pytest.importorskip("pyarrow", reason="pyarrow is optional (extra 'parquet')")
parquet = pytest.importorskip("pyarrow.parquet")

SIZE = 1500


def table(**changes):
    columns = {
        "name": pyarrow.array(["a", None, "c,\nd"]),
        "x_mm": pyarrow.array([1.0, 2.0000000004, 1 / 3]),
        "y_mm": pyarrow.array([0.5, -0.0, 7.0]),
        "z_m": pyarrow.array([0.001, 0.002, 0.003], pyarrow.float32()),
        "a_deg": pyarrow.array([0.0, 0.0, 0.0]),
        "b_deg": pyarrow.array([90.0, 90.0, 90.0]),
        "c_deg": pyarrow.array([180.0, -180.0, 170.0]),
        "kind": pyarrow.array(["LIN", "PTP", "LIN"]).dictionary_encode(),
        "count": pyarrow.array([3, None, 5], pyarrow.int64()),
        "feed_mm_per_min": pyarrow.array([600.0, 600.0, 1200.0]),
        **changes,
    }
    return pyarrow.table(columns).replace_schema_metadata({b"made by": b"a test"})


@pytest.fixture
def saved(tmp_path):
    def save(content):
        path = tmp_path / "points.parquet"
        parquet.write_table(content, path, compression="gzip")
        return path

    return save


def moved(program, by):
    return rewrite(program, program.position_mm + by, program.orientation, np.ones(len(program), bool)).parts


def test_zero_correction_is_the_same_file(saved):
    path = saved(table())
    program = read_program(path)
    assert program.dialect == "parquet"
    assert files_of(program, moved(program, 0.0)) == (path.read_bytes(),)
    np.testing.assert_allclose(program.position_mm[:, 2], [1, 2, 3], atol=1e-6)
    np.testing.assert_allclose(program.feed_mm_per_min, [600, 600, 1200])


def test_only_cells_of_corrected_poses_change(saved):
    program = read_program(saved(table()))
    parts = moved(program, (0.25, 0.0, 0.5))
    (raw,) = files_of(program, parts)
    out = parquet.read_table(io.BytesIO(raw))
    before = table()
    assert out.schema.metadata == before.schema.metadata
    assert out.schema.types == before.schema.types
    for name in before.column_names:
        if name not in ("x_mm", "z_m"):
            assert out[name].equals(before[name].cast(out[name].type)), name
    assert out["x_mm"][1].as_py() == 2.0000000004  # a point-to-point move, to the last bit
    np.testing.assert_allclose(out["x_mm"].to_numpy(), [1.25, 2.0000000004, 1 / 3 + 0.25], atol=1e-9)
    np.testing.assert_allclose(out["z_m"].to_numpy(), [0.0015, 0.002, 0.0035], atol=1e-6)
    assert parquet.ParquetFile(io.BytesIO(raw)).metadata.row_group(0).column(0).compression == "GZIP"
    np.testing.assert_allclose(read_again(program, parts).position_mm[0], [1.25, 0.5, 1.5], atol=1e-6)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"x_mm": [1, 2, 3]}, "type int64"),
        ({"x_mm": [1.0, None, 3.0]}, "line 3.*finite"),
        ({"z_m": [0.0, float("inf"), 1.0]}, "line 3"),
        ({"kind": ["LIN", "CIRC", "LIN"]}, "CIRC"),
        ({"c_deg": ["1", "2", "3"]}, "type string"),
    ],
)
def test_what_is_no_waypoint_is_named(saved, change, word):
    changed = {name: pyarrow.array(values) for name, values in change.items()}
    with pytest.raises(InputError, match=word):
        read_program(saved(table(**changed)))


def test_a_damaged_file_and_a_missing_package_are_said(saved, monkeypatch):
    path = saved(table())
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(InputError, match="cannot be read"):
        read_program(path)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"pip install 'drake-stiffness\[parquet\]'"):
        read_program(path)


def long_table(path, count=70):
    """Row groups of different sizes, a column of text, point-to-point moves and feeds in between."""
    n = np.arange(count)
    content = pyarrow.table(
        {
            "note": pyarrow.array([None if k % 9 == 0 else f"row {k}" for k in n]),
            "x_mm": 220.0 + 2 * n,
            "y_mm": 150.0 - n / 3,
            "z_m": pyarrow.array(np.full(count, -0.005), pyarrow.float32()),
            "a_deg": np.zeros(count),
            "b_deg": np.full(count, -6.0),
            "c_deg": np.full(count, 170.0),
            "kind": pyarrow.array(["PTP" if k % 17 == 3 else "LIN" for k in n]).dictionary_encode(),
            "feed_mm_per_min": np.where(n < 30, 600.0, 900.0),
        }
    ).replace_schema_metadata({b"made by": b"a test"})
    with parquet.ParquetWriter(path, content.schema, compression="gzip", use_dictionary=["kind"]) as writer:
        for start, size in ((0, 25), (25, 40), (65, count - 65)):
            writer.write_table(content.slice(start, size))
    return content


def row_groups(file):
    data = parquet.ParquetFile(file).metadata
    return [data.row_group(n).num_rows for n in range(data.num_row_groups)]


def test_a_long_table_in_pieces_is_the_file_of_the_whole_and_keeps_its_row_groups(model, tools, tmp_path):
    path, out = tmp_path / "long.parquet", tmp_path / "out.parquet"
    content = long_table(path)
    found = list(pieces(path, None, SIZE))
    assert len(found) > 3
    assert b"".join(piece.raw for piece in found) == read_program(path).raw
    whole = compensate(read_program(path), model, tools.process())
    parts = compensate_file(path, model, tools.process(), size=SIZE, processes=1, output=out)
    assert type(parts).__name__ == "LongCompensation"
    assert parts.digests == whole.digests
    assert parts.lines == whole.lines == 71
    write_together(parts.files(out))
    (expected,) = files_of(whole.program, whole.parts)
    assert out.read_bytes() == expected != path.read_bytes()
    assert row_groups(out) == row_groups(path) == [25, 40, 5]
    corrected = parquet.read_table(out)
    assert corrected.schema.equals(content.schema, check_metadata=True)
    assert corrected["note"].equals(content["note"])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["long.parquet", "out.parquet"]


def test_a_long_table_that_nothing_bends_stays_the_same_file(model, tools, tmp_path):
    path, out = tmp_path / "long.parquet", tmp_path / "out.parquet"
    long_table(path)
    process = tools.process(force=tools.constant("tool"))
    parts = compensate_file(path, model, process, size=SIZE, processes=1, output=out)
    write_together(parts.files(out))
    assert out.read_bytes() == path.read_bytes()


def test_a_cell_that_is_no_number_has_its_line_in_the_whole_table(model, tools, tmp_path):
    path = tmp_path / "long.parquet"
    content = long_table(path)
    values = content["x_mm"].to_pylist()
    values[61] = None
    parquet.write_table(content.set_column(1, "x_mm", pyarrow.array(values, pyarrow.float64())), path)
    with pytest.raises(InputError, match=r"line 63, column 1 \(x\)"):
        compensate_file(path, model, tools.process(), size=SIZE, processes=1)


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(st.tuples(*3 * [st.floats(-4000.0, 4000.0)]), min_size=1, max_size=6),
    st.tuples(*3 * [st.floats(-5.0, 5.0)]),
)
def test_generated_tables_keep_all_but_corrected_poses_and_read_back_what_was_wanted(saved, points, by):
    n, columns = len(points), np.array(points).T
    content = {
        **{f"{c}_mm": pyarrow.array(v) for c, v in zip("xyz", columns, strict=True)},
        "note": pyarrow.array([f"row {k}" for k in range(n)]),
    }
    path = saved(pyarrow.table(content))
    program = read_program(path)
    assert files_of(program, moved(program, 0.0)) == (path.read_bytes(),)
    (raw,) = files_of(program, moved(program, by))
    again = parquet.read_table(io.BytesIO(raw))
    assert again.column_names == list(content)
    assert again["note"].to_pylist() == content["note"].to_pylist()
    for c, v, step in zip("xyz", columns, by, strict=True):
        np.testing.assert_allclose(again[f"{c}_mm"].to_numpy(), v + step, rtol=0, atol=1e-9)
