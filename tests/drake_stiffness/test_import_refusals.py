"""What is wrong with an export, or with the map that explains it, is said; what belongs nowhere is never lost."""

import re
from pathlib import Path

import numpy as np
import pytest
from tracker_exports import (
    START,
    force_log,
    make_folder,
    rows_of,
    tracker_a,
    tracker_b,
    tracker_c,
    write_lines,
    write_map,
)

from drake_stiffness.errors import InputError
from drake_stiffness.importing.readings import import_readings


@pytest.fixture
def folder(tmp_path):
    return make_folder(tmp_path)


def refused(folder, **content):
    with pytest.raises(InputError) as error:
        import_readings(write_map(folder, **content))
    return str(error.value)


def test_a_column_that_is_not_there_is_named_with_the_nearest_one(folder):
    readings = tracker_a(folder)
    readings["columns"]["x"] = "x(mm)"
    message = refused(folder, readings=readings)
    assert "no column 'x(mm)' (readings.columns x of the map). Did you mean 'X [mm]'?" in message
    assert "Columns found: Messung, Stufe, Ziel" in message


def test_an_unknown_key_of_the_map_is_named_with_the_nearest_one(folder):
    message = refused(folder, readings=tracker_a(folder) | {"delimeter": ";"})
    assert "readings.0.delimeter: unknown key" in message
    assert "Did you mean 'delimiter'?" in message


def test_two_readings_of_one_step_are_refused_unless_samples_are_expected(folder):
    rows = rows_of(folder)
    message = refused(folder, readings=tracker_a(folder, [*rows, rows[4]]))
    assert "a.txt, line 89: a second reading of point 'P2' for" in message
    assert "(the first: a.txt, line 9)" in message
    assert "samples: mean" in message


def test_a_reading_that_fits_two_steps_in_time_is_refused(folder):
    readings = tracker_c(folder)
    readings["match"] = {"by": "time", "window_s": 25}
    message = refused(folder, readings=readings, start=START.isoformat())
    assert re.search(
        r"c.tsv, line \d+: at .* s it fits experiment 'E\d\d', step \d; experiment 'E\d\d', step \d", message
    )
    assert "make match.window_s smaller" in message


def test_rows_that_belong_nowhere_are_refused_or_listed_never_lost(folder):
    rows = rows_of(folder)
    strange = [row | {"experiment": "E99"} for row in rows[:2]] + [rows[5] | {"point": "P2"}]
    readings = tracker_a(folder, [*rows[:5], *rows[6:], *strange[:2]])
    text = (folder / "a.txt").read_text("cp1252").replace("Refl 2", "Nest 2", 1)
    (folder / "a.txt").write_bytes(text.encode("cp1252"))
    message = refused(folder, readings=readings)
    assert "a.txt, lines 88-89: no step of the plan fits (matched by columns)" in message
    assert "the points 'Nest 2' are none of the cell's (P1, P2, P3)" in message
    result = import_readings(write_map(folder, readings=readings, unmatched="list"))
    assert len(result.unmatched) == 2
    assert result.rows == 84 - 1 - 1
    assert len(result.missing) == 2
    assert any(line.endswith(": no P2") for line in result.missing)


def test_a_step_without_force_is_named(folder):
    rows = [row for row in rows_of(folder) if (row["experiment"], row["step"]) != ("E03", "2")]
    forces = force_log(folder, rows)
    message = refused(folder, readings=tracker_c(folder), forces=forces, start=START.isoformat())
    assert "f.log: no force for experiment 'E03', step 2 (within 4 s)" in message


def test_a_force_that_would_serve_two_steps_is_refused(folder):
    forces = force_log(folder)
    forces["match"]["window_s"] = 20
    message = refused(folder, readings=tracker_c(folder), forces=forces, start=START.isoformat())
    assert "this force would serve experiment" in message
    assert "window_s (20 s) smaller" in message


@pytest.mark.parametrize(
    ("wrong", "remedy"),
    [
        ({"sign": 1}, "-1 times the planned force. Write sign: -1 (found: 1)"),
        ({"unit": "N"}, "0.001 times the planned force. Write unit: kN (found: N) under forces"),
        ({"unit": "kgf", "sign": 1}, "Write unit: kN (found: kgf) and sign: -1 (found: 1)"),
        ({"unit": "N", "zero_below_N": 20}, "Write unit: kN (found: N)"),
    ],
)
def test_a_force_log_in_another_unit_or_sign_than_stated_is_refused_with_what_to_write(folder, wrong, remedy):
    forces = force_log(folder) | wrong
    assert remedy in refused(folder, readings=tracker_c(folder), forces=forces, start=START.isoformat())


def test_a_force_log_that_no_unit_explains_is_taken_with_a_warning(folder):
    """Half the planned force was hung, or the sensor's axes are others: nobody can tell which."""
    rows = [row | {f"f{a}_N": f"{0.5 * float(row[f'f{a}_N'])}" for a in "xyz"} for row in rows_of(folder)]
    for changed in ({"rows": rows}, {"turn": [0, 0, 0]}):
        forces, readings = force_log(folder, **changed), tracker_c(folder)
        result = import_readings(write_map(folder, readings=readings, forces=forces, start=START.isoformat()))
        assert any("more than 20 % off the planned force at 16 of 16" in line for line in result.warnings)


def test_a_wrong_entry_of_a_list_is_not_also_called_a_short_list(folder):
    message = refused(folder, readings=tracker_a(folder) | {"unit": "cm"})
    assert message.count("Mend this value") == 1
    assert "at least 1 item" in refused(folder, readings=[])


def test_a_log_whose_clock_is_late_by_a_step_is_noticed(folder):
    """Within an experiment every step then gets the load of the one before; its first step gets none."""
    forces = force_log(folder)
    forces["time"]["offset_s"] = 30.0
    message = refused(folder, readings=tracker_c(folder), forces=forces, start=START.isoformat())
    assert "f.log: no force for experiment" in message
    assert "Are the clocks the same? Set time.offset_s or start." in message


def test_loads_that_belong_to_other_steps_are_noticed(folder):
    rows = rows_of(folder)
    swap = {"0": "1", "1": "0"}
    lines = [
        "e,s,f",
        *(f"{r['experiment']},{swap.get(r['step'], r['step'])},{r['fz_N']}" for r in rows if r["point"] == "P1"),
    ]
    write_lines(folder / "f.csv", lines)
    match = {"experiment": "e", "step": "s"}
    forces = {"file": "f.csv", "unit": "N", "column": "f", "along": "z", "match": match}
    message = refused(folder, readings=tracker_a(folder), forces=forces)
    assert "step 0" in message
    assert "unloaded, but the log reads 1250 N there" in message


@pytest.mark.parametrize(("unit", "times"), [("m", 1000), ("inch", 25.4), ("um", 0.001)])
def test_readings_in_another_unit_than_stated_are_noticed(folder, unit, times):
    (line,) = import_readings(write_map(folder, readings=tracker_a(folder) | {"unit": unit})).warnings
    assert "is readings.unit right" in line
    assert float(re.search(r": (\S+) times", line)[1]) == pytest.approx(times, rel=0.02)


def test_a_tracker_that_stands_elsewhere_is_noticed(folder):
    rows = [row | {"x_mm": f"{float(row['x_mm']) + 500:.5f}"} for row in rows_of(folder)]
    (line,) = import_readings(write_map(folder, readings=tracker_a(folder, rows))).warnings
    assert "tracker_frame: unknown" in line


def test_by_order_every_point_needs_as_many_readings_as_there_are_steps(folder):
    message = refused(folder, readings=tracker_b(folder, rows_of(folder)[:-3]))
    assert "27 rows; matched by order, the 28 steps of the plan need 28" in message


def test_decimal_commas_that_nobody_announced_are_no_numbers(folder):
    message = refused(folder, readings=tracker_a(folder) | {"decimal": "."})
    assert "a.txt, line 5, column 'X [mm]'" in message
    assert "expected a number" in message


def test_a_wrong_delimiter_is_suspected(folder):
    readings = tracker_a(folder) | {"delimiter": "tab", "drop": []}
    assert "the header is one cell, 'Messung;Stufe;Ziel" in refused(folder, readings=readings)


def test_another_encoding_is_said(folder):
    assert "is not utf-8; set encoding (cp1252" in refused(folder, readings=tracker_a(folder) | {"encoding": "utf-8"})


def test_clocks_run_past_midnight(folder):
    from drake_stiffness.importing.foreign_tables import read_times
    from drake_stiffness.importing.map_file import Time
    from drake_stiffness.tables import Table

    table = Table(Path("t.csv"), ("t",), [["23:59:58"], ["23:59:59,5"], ["00:00:01"]], [2, 3, 4])
    times, start = read_times(table, Time(column="t", format="clock"), None)
    np.testing.assert_allclose(times, [0, 1.5, 3])
    later = Table(Path("t.csv"), ("t",), [["00:00:10"]], [2])
    np.testing.assert_allclose(read_times(later, Time(column="t", format="clock"), start)[0], [12])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"plan": None}, "without plan"),
        ({"readings": {"file": "a.txt", "unit": "mm"}}, "give either columns: {x, y, z}"),
        ({"forces": {"file": "f.log", "unit": "N", "column": "F"}}, "column and along belong together"),
        (
            {"forces": {"file": "f.log", "unit": "N", "column": "F", "along": "z", "match": {"how": "since"}}},
            "logs take nearest or average",
        ),
        (
            {"readings": {"file": "a.txt", "unit": "cm", "point": "P1", "columns": {"x": "X", "y": "Y", "z": "Z"}}},
            "'mm', 'm'",
        ),
        ({"readings": {"file": "a.txt", "unit": "mm", "decimal": ","}}, "the comma cannot both"),
        ({"start": "tomorrow"}, "start: found 'tomorrow'"),
        ({"joints": {"file": "PLAN.csv", "columns": {"joint_9": "A"}}}, "has no column"),
    ],
)
def test_a_map_that_says_too_little_or_too_much_is_refused(folder, change, said):
    assert said in refused(folder, **({"readings": tracker_a(folder)} | change))


def test_a_reading_long_after_its_step_belongs_nowhere(folder):
    readings = tracker_c(folder)
    readings["match"]["window_s"] = 15  # the third point is read 21 s after the step began
    message = refused(folder, readings=readings, start=START.isoformat())
    assert "no step of the plan fits (matched by time)" in message
