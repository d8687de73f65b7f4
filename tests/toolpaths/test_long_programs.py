"""A program that is corrected in pieces is corrected as the whole is, and says the same of itself."""

import gc
import weakref
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_stiffness.errors import InputError
from drake_stiffness.files import write_together
from toolpaths.account.folding import _fold_evenness, fold_notes
from toolpaths.account.tally import Tally, summary_of
from toolpaths.formats import read_program
from toolpaths.formats.pieces import pieces
from toolpaths.job import compensate
from toolpaths.long_programs import _Job, compensate_file
from toolpaths.program_builder import ProgramBuilder

SIZE = 1500
HEAD = "DEF long( )\r\n$BASE = BASE_DATA[1]\r\n$VEL.CP=0.05\r\nPTP HOME\r\n"


def line(n, words="XYZABC", kind="LIN"):
    numbers = zip("XYZABC", (220 + 2 * n, 150 - n, -5.0, 0.0, -6.0, 170.0), strict=True)
    return kind + " {" + ",".join(f"{w} {v:.3f}" for w, v in numbers if w in words) + "} C_DIS\r\n"


def source(count=60):
    """Whole poses, with arcs, partial poses, point-to-point moves, feeds and comments in between."""
    text = HEAD
    for n in range(count):
        text += line(n)
        text += {
            7: line(n + 0.5, "XYZ"),
            11: f"CIRC {{X {220.5 + 2 * n},Y {150.0 - n},Z -5.000}}," + line(n + 0.8)[4:],
            23: "$VEL.CP=0.02\r\n;caf\xe9 {X 1}\r\n",
            29: line(n, kind="PTP"),
            37: "WAIT SEC 1\r\n" + line(n + 0.5),
            41: "$TOOL = TOOL_DATA[3]\r\n",
        }.get(n, "")
    return text.encode("latin-1")


@pytest.fixture
def program(tmp_path):
    path = tmp_path / "long.src"
    path.write_bytes(source())
    return path


def both(path, model, process, **options):
    whole = compensate(read_program(path), model, process, **options)
    parts = compensate_file(path, model, process, size=SIZE, processes=1, output=path.with_name("out.src"), **options)
    return whole, parts


def corrected(result, path):
    write_together(result.files(path))
    return path.read_bytes()


def test_pieces_hold_every_byte_and_every_row_once(program):
    whole = read_program(program)
    found = list(pieces(program, None, SIZE))
    assert len(found) > 3
    assert b"".join(piece.raw for piece in found) == program.read_bytes()
    rows = [
        slice(bool(n), None) for n in range(len(found))
    ]  # the first row of a piece stands for the last of the one before
    for name in (
        "line",
        "kind",
        "role",
        "carries_force",
        "refused",
        "feed_mm_per_min",
        "blend_mm",
        "status",
        "position_mm",
        "orientation",
    ):
        joined = np.concatenate([getattr(piece, name)[own] for piece, own in zip(found, rows, strict=True)])
        np.testing.assert_array_equal(joined, getattr(whole, name), err_msg=name)
    follows = np.concatenate([piece.follows[own] for piece, own in zip(found, rows, strict=True)])
    np.testing.assert_array_equal(follows, whole.follows)


def test_a_piece_that_is_done_is_not_kept(program):
    """Without waiting for the collector of cycles: a million lines would pile up until it comes."""
    gc.disable()
    try:
        gc.collect()
        alive = [weakref.ref(piece) for piece in pieces(program, None, SIZE)]
        builders = sum(isinstance(found, ProgramBuilder) for found in gc.get_objects())
    finally:
        gc.enable()
    assert [ref for ref in alive if ref() is not None] == []
    assert builders == 0


def test_pieces_and_the_whole_give_the_same_bytes_and_the_same_account(program, model, tools, tmp_path):
    whole, parts = both(
        program, model, tools.process(force=tools.constant("path", fx_N=300.0, fy_N=200.0, fz_N=-300.0))
    )
    assert type(parts).__name__ == "LongCompensation"
    a, b = parts.to_dict(), whole.to_dict()
    assert a.keys() == b.keys()
    for key in ("corrected_points", "lines", "iterations", "refused", "half_printed_digit_mm"):
        assert a[key] == b[key], key
    assert {k: v for k, v in a["reserve"].items() if "margin" not in k} == {
        k: v for k, v in b["reserve"].items() if "margin" not in k
    }
    assert a["reserve"]["singularity_margin"] == pytest.approx(b["reserve"]["singularity_margin"])
    assert a["reserve"]["limit_margin"] == pytest.approx(b["reserve"]["limit_margin"])
    for key in ("correction_mm", "uncompensated_mm", "residual_mm", "joints_only_mm"):
        for name in ("mean", "rms", "max"):
            assert a[key][name] == pytest.approx(b[key][name], rel=1e-4), (key, name)
        assert a[key]["p95"] == pytest.approx(b[key]["p95"], rel=0.02)
    assert a["percent_compensated"] == pytest.approx(b["percent_compensated"])
    assert a["correction_mm"]["mean"] == pytest.approx(b["correction_mm"]["mean"], rel=1e-12)
    assert a["joints_only_mm"]["best_possible_rms"] == pytest.approx(b["joints_only_mm"]["best_possible_rms"], rel=1e-5)
    for one, two in zip(a["causes"], b["causes"], strict=True):
        assert one["where"] == two["where"]
        assert one["share"] == pytest.approx(two["share"], abs=1e-9)
    assert parts.digests == whole.digests
    assert parts.rows.size == whole.rows.size  # short enough to be kept as a whole
    np.testing.assert_array_equal(parts.line, whole.line)
    np.testing.assert_allclose(parts.path.postures.q, whole.path.postures.q, atol=1e-9)
    assert corrected(parts, tmp_path / "out.src") == whole.raw


def test_pieces_with_as_many_points_as_the_arm_has_joints(model, tools, tmp_path):
    """The points of an array are told from its joints by all pieces together."""
    path = tmp_path / "few.src"
    path.write_bytes((HEAD + "".join(line(n, kind="LIN" if n % 8 < 2 else "PTP") for n in range(80))).encode())
    counts = {int(piece.corrected.sum()) for piece in pieces(path, None, SIZE)}
    assert max(counts) == 6
    assert len(counts) > 1
    whole, parts = both(path, model, tools.process())
    np.testing.assert_allclose(parts.path.postures.q, whole.path.postures.q, atol=1e-9)
    np.testing.assert_array_equal(parts.line, whole.line)


def test_a_kink_at_the_border_of_two_pieces_is_seen(program, model, tools, tmp_path):
    """The force sets in at the first motion of the second piece: nothing but that step bends the path."""
    path = tmp_path / "even.src"
    path.write_bytes((HEAD + "".join(line(n) for n in range(60))).encode())
    found = list(pieces(path, None, SIZE))
    first = int(found[0].corrected.sum())
    process = tools.process(force={"table": "forces.csv", "frame": "world"})
    process._path = tmp_path / "process.yaml"
    (tmp_path / "forces.csv").write_text("fx_N,fz_N\n" + "10,0\n" * first + "900,-900\n" * (60 - first))
    whole, parts = both(path, model, process)
    assert len(found) > 2
    told, expected = parts.to_dict()["evenness"], whole.to_dict()["evenness"]
    assert told["kink_lines"] == expected["kink_lines"] == [int(found[1].line[1])]
    assert told["largest_mm_per_mm"] == pytest.approx(expected["largest_mm_per_mm"], rel=1e-6)
    assert [note for note in parts.notes if "kink" in note] == [note for note in whole.notes if "kink" in note]


def test_a_piece_that_knows_nothing_of_blends_or_steps_hides_none_of_the_others():
    """A piece with one point has no step, in whatever order the pieces come."""
    none = float("nan")
    keys = ("largest_change_within_a_blend_mm", "smallest_blend_radius_mm", "largest_blend_radius_mm")
    keys += ("share_of_steps_shorter_than_two_blend_radii", "median_spacing_mm")
    told = {"largest_mm_per_mm": 0.1, "kink_lines": []}
    one, other = told | dict.fromkeys(keys, none), told | dict.fromkeys(keys, 0.25)
    for parts in ([one, other], [other, one]):
        found = _fold_evenness(parts, np.array([1.0, 9.0]))
        assert [found[key] for key in keys] == [0.25] * 5
    unknown = _fold_evenness([one, one], np.ones(2))
    assert all(np.isnan(unknown[key]) for key in keys)


def test_a_force_table_is_read_in_step(program, model, tools, tmp_path):
    motions = int((read_program(program).role[read_program(program).corrected] != "end").sum())
    rows = "".join(f"{n % 7 * 50.0},{-n}\n" for n in range(motions))
    process = tools.process(force={"table": "forces.csv", "frame": "world"})
    process._path = tmp_path / "process.yaml"
    (tmp_path / "forces.csv").write_text("fx_N,fz_N\n" + rows)
    whole, parts = both(program, model, process)
    assert corrected(parts, tmp_path / "out.src") == whole.raw
    for text in ("fx_N,fz_N\n" + rows + "1,1\n", "fx_N,fz_N\n" + rows[: rows.rindex("\n", 0, -1) + 1]):
        (tmp_path / "forces.csv").write_text(text)
        with pytest.raises(InputError, match=r"forces.csv: .*expected one row per corrected motion"):
            compensate_file(program, model, process, size=SIZE, processes=1)


def test_a_table_comes_in_pieces_too(model, tools, tmp_path):
    path = tmp_path / "points.csv"
    rows = [f"{n},{220 + 2 * n:.3f},{150 - n:.3f},-5.000,0.000,-6.000,170.000" for n in range(70)]
    path.write_text("name,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\n" + "\n".join(rows))
    whole, parts = both(path, model, tools.process())
    assert parts.to_dict()["lines"] == whole.to_dict()["lines"] == 71
    assert corrected(parts, tmp_path / "out.csv") == whole.raw


def test_lines_that_cannot_be_corrected_have_their_lines(program, model, tools, tmp_path):
    program.write_bytes(source().replace(b"WAIT SEC 1\r\n", b"LIN_REL {X 1.0}\r\n"))
    number = program.read_bytes()[: program.read_bytes().index(b"LIN_REL")].count(b"\n") + 1
    with pytest.raises(InputError, match=f"line {number}, column 1"):
        compensate_file(program, model, tools.process(), size=SIZE, processes=1, output=tmp_path / "out.src")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["long.src"]  # nothing half-written is left
    whole, parts = both(program, model, tools.process(), keep_refused=True)
    assert parts.to_dict()["refused"] == whole.to_dict()["refused"]
    assert corrected(parts, tmp_path / "out.src") == whole.raw


def test_a_frame_that_changes_between_pieces_is_refused(program, model, tools):
    lines = program.read_bytes().splitlines(keepends=True)
    program.write_bytes(b"".join([*lines[:40], b"$BASE = BASE_DATA[2]\r\n", *lines[40:]]))
    with pytest.raises(InputError, match=r"line 41: .*changes between corrected motions"):
        compensate_file(program, model, tools.process(), size=SIZE, processes=1)
    # Exactly at a cut nothing but the frames of the piece before can tell.
    cut = len(next(pieces(program, None, SIZE)).raw.splitlines())
    program.write_bytes(b"".join([*lines[:cut], b"$BASE = BASE_DATA[2]\r\n", *lines[cut:]]))
    with pytest.raises(InputError, match="changes between corrected motions"):
        compensate_file(program, model, tools.process(), size=SIZE, processes=1)


def test_a_piece_that_was_started_on_another_branch_is_done_again(program, model, tools, tmp_path, monkeypatch):
    process = tools.process()
    whole = compensate(read_program(program), model, process)
    flipped = np.radians([0, -70, 120, 180, 50, 180])  # the wrist the other way
    original, guesses = _Job._tasks, []

    def guess_wrongly(job):
        for index, (program, own, lead) in enumerate(original(job)):
            wrong = (program, own, flipped if index == 2 else lead)
            job.sent[index] = wrong
            guesses.append(wrong[2])
            yield wrong

    monkeypatch.setattr(_Job, "_tasks", guess_wrongly)
    parts = compensate_file(program, model, process, size=SIZE, processes=1, output=tmp_path / "out.src")
    assert guesses[2] is flipped
    np.testing.assert_allclose(parts.path.postures.q, whole.path.postures.q, atol=1e-9)
    assert corrected(parts, tmp_path / "out.src") == whole.raw


def test_a_program_with_stored_points_is_read_as_a_whole(program, model, tools, tmp_path):
    program.write_bytes(source() + b"LIN XP1\r\n")
    pose = b"{X 342.000,Y 90.000,Z -5.000,A 0.000,B -6.000,C 170.000}"
    program.with_suffix(".dat").write_bytes(b"DEFDAT long\r\nDECL E6POS XP1=" + pose + b"\r\nENDDAT\r\n")
    result = compensate_file(program, model, tools.process(), size=SIZE, processes=1)
    assert len(result.program.parts) == 2
    assert result.refusals == ()


def test_two_processes_do_what_one_does(program, model, tools, tmp_path):
    process = tools.process()
    one = compensate_file(program, model, process, size=SIZE, processes=1, output=tmp_path / "one.src")
    two = compensate_file(program, model, process, size=SIZE, processes=2, output=tmp_path / "two.src")
    assert two.digests == one.digests
    np.testing.assert_allclose(two.path.postures.q, one.path.postures.q, atol=1e-12)


def test_a_gathered_program_nobody_takes_is_removed(program, model, tools, tmp_path):
    result = compensate_file(program, model, tools.process(), size=SIZE, processes=1, output=tmp_path / "out.src")
    assert Path(result.written).exists()
    written = Path(result.written)
    del result
    assert not written.exists()


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(0, 1e4), min_size=1, max_size=60), st.integers(0, 60))
def test_a_tally_in_two_parts_says_what_the_values_say(values, cut):
    values = np.array([*values, np.nan])
    tally = (Tally.of(values[:cut]) + Tally.of(values[cut:])).summary()
    exact = summary_of(values)
    for name in ("mean", "rms", "max"):
        assert tally[name] == pytest.approx(exact[name], rel=1e-9, abs=1e-9)
    known = np.sort(values[np.isfinite(values)])
    at = int(0.95 * (known.size - 1))
    above = known[min(at + 1, known.size - 1)]
    assert known[at] * 0.998 - 1e-8 <= tally["p95"] <= above * 1.002 + 1e-8


def test_notes_that_differ_in_numbers_are_said_once():
    assert fold_notes([["up to 3 %", "a"], ["up to 12.5 %", "a"], ["a"]]) == [
        "up to 12.5 % (and the like in 1 more pieces of the program)",
        "a",
    ]
