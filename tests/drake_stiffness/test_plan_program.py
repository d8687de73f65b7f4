"""Robot programs of plans: read back by readers that know nothing of the writer."""

import re
import sys
from itertools import pairwise, permutations
from pathlib import Path

import numpy as np
import pytest

from drake_stiffness.campaign import read_measurements
from drake_stiffness.errors import InputError
from drake_stiffness.shop.axis_words import read_words, word_values
from drake_stiffness.shop.plan_program import ProgramOptions, ascii_text, check_name, plan_program
from drake_stiffness.shop.visiting_order import postures, total_travel, travel, visiting_order
from drake_stiffness.shop.work import in_order

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
from plants.krl_reader import parse_program, read_axes

STEPS = ((0, 0, 0), (0, 0, -1250.0), (300.0, -400.0, 0))


def plan_text(arm, q, names=None, steps=STEPS, **more):
    """PLAN.csv of postures q (E, n), deg or mm."""
    units = ["_mm" if prismatic else "_deg" for prismatic in arm.prismatic]
    header = [
        "experiment", "step", *(n + u for n, u in zip(arm.joint_names, units, strict=True)), "fx_N", "fy_N", "fz_N", *more
    ]  # fmt: skip
    rows = [",".join(header)]
    for e, posture in enumerate(q):
        for s, force in enumerate(steps):
            name = names[e] if names else f"E{e + 1:02d}"
            added = [str(values[e]) for values in more.values()]
            rows.append(",".join([name, str(s), *(f"{v:.4f}" for v in posture), *(f"{f:g}" for f in force), *added]))
    return "\n".join(rows) + "\n"


def read_plan(tmp_path, arm, cell, q, *args, **more):
    path = tmp_path / "PLAN.csv"
    path.write_text(plan_text(arm, q, *args, **more))
    return read_measurements(path, arm, tuple(cell.reference_points_m), np.zeros(3), readings=False)


def some_postures(arm, number, seed=0):
    rng = np.random.default_rng(seed)
    unit = np.where(arm.prismatic, 1e3, 180 / np.pi)
    span = np.minimum(np.abs(np.maximum(arm.lower, -2)), np.minimum(arm.upper, 2)) * 0.6
    centre = np.clip(np.zeros(arm.num_joints), arm.lower + span * 0.5, arm.upper - span * 0.5)
    return np.round((centre + rng.uniform(-0.4, 0.4, (number, arm.num_joints)) * span) * unit, 4)


@pytest.fixture
def kr270(arms, cells):
    return arms["kr270"], cells["kr270"]


def test_the_joints_read_back_are_those_of_the_plan_to_the_printed_digit(tmp_path, kr270):
    arm, cell = kr270
    q = some_postures(arm, 5) + [0, -70, 60, 0, 0, 0]
    m = read_plan(tmp_path, arm, cell, q)
    text = plan_program(m, arm, "measure").decode("ascii")
    found = np.array([[words[f"A{n}"] for n in range(1, 7)] for words in read_axes(text)])
    np.testing.assert_allclose(found, q, atol=1e-9)
    assert parse_program(text).kinds == ()  # no Cartesian motion is in it


def test_the_projects_own_parser_reads_every_motion_of_it(tmp_path, kr270):
    from toolpaths.formats.krl import Krl

    arm, cell = kr270
    m = read_plan(tmp_path, arm, cell, some_postures(arm, 3) + [0, -70, 60, 0, 0, 0])
    raw = plan_program(m, arm, "measure", options=ProgramOptions(via=np.deg2rad([0, -90, 90, 0, 0, 0])))
    program = Krl().parse(raw, "measure.src")
    assert program.refusals == ()
    assert program.notes == ()


def test_every_step_has_a_stop_that_names_it_and_its_load(tmp_path, kr270):
    arm, cell = kr270
    m = read_plan(tmp_path, arm, cell, some_postures(arm, 2) + [0, -70, 60, 0, 0, 0])
    lines = plan_program(m, arm, "measure").decode().splitlines()
    stops = [line for line in lines if line.startswith("HALT")]
    # three steps and, because the last one is loaded, a stop to take the load off; one at the end
    assert len(stops) == 2 * 4 + 1
    assert "E01 step 0: no load" in stops[0]
    assert "E01 step 1: 1250 N (127.4 kg) down" in stops[1]
    assert "E01 step 2: 500 N" in stops[2]
    assert "37 deg from -y to +x" in stops[2]
    assert "E01: take the load off" in stops[3]
    messages = re.findall(r'^DS_TEXT\[\]="([^"]*)"$', "\n".join(lines), re.MULTILINE)
    assert len(messages) == len(stops)
    assert all(message in stop for message, stop in zip(messages, stops, strict=True))


def test_a_controller_can_read_it(tmp_path, kr270):
    """Header and end, declarations before the first statement, ASCII, lines that end in CR LF, strings that fit."""
    arm, cell = kr270
    names = ["Stänge 1", 'quote"; END', "x" * 120]
    m = read_plan(
        tmp_path, arm, cell, some_postures(arm, 3) + [0, -70, 60, 0, 0, 0], [n.replace('"', "'") for n in names]
    )
    raw = plan_program(m, arm, "measure")
    assert raw.isascii()
    assert raw.count(b"\n") == raw.count(b"\r\n")
    lines = raw.decode().splitlines()
    assert lines[0] == "&ACCESS RVP"
    code = [line.split(";")[0].strip() for line in lines if line.split(";")[0].strip() and not line.startswith("&")]
    assert code[0] == "DEF measure( )"
    assert code[1] == "DECL CHAR DS_TEXT[80]"
    assert code[-1] == "END"
    assert (
        lines.index("DECL CHAR DS_TEXT[80]") < lines.index("    BAS (#INITMOV,0 )") < lines.index("BAS (#VEL_PTP,10)")
    )
    for message in re.findall(r'DS_TEXT\[\]="(.*)"', raw.decode()):
        assert len(message) <= 80
        assert '"' not in message
    assert any("Stange 1 step 0" in line for line in lines)
    assert any(re.search(r"x{20,}\.\.\.: 1250 N \(127.4 kg\) down", line) for line in lines)


def test_what_must_be_checked_stands_at_the_top(tmp_path, kr270):
    arm, cell = kr270
    m = read_plan(tmp_path, arm, cell, some_postures(arm, 1) + [0, -70, 60, 0, 0, 0])
    text = plan_program(m, arm, "measure").decode()
    top = text[: text.index("PTP {")]
    assert "90.00 kg, centre of mass 90.0, 10.0, 160.0 mm" in top
    assert "collisions" in top
    assert "BAS (#TOOL" not in text
    assert "BAS (#TOOL,4)" in plan_program(m, arm, "measure", options=ProgramOptions(tool_number=4)).decode()


def test_the_arm_passes_a_safe_posture_between_experiments_if_one_is_given(tmp_path, kr270):
    arm, cell = kr270
    m = read_plan(tmp_path, arm, cell, some_postures(arm, 3) + [0, -70, 60, 0, 0, 0])
    safe = ProgramOptions(via=np.deg2rad([0, -90, 90, 0, 0, 0]))
    found = [words["A2"] for words in read_axes(plan_program(m, arm, "measure", options=safe).decode())]
    assert len(found) == 7
    assert found[::2] == [-90.0] * 4


def test_a_track_is_an_external_axis_in_millimetres(tmp_path, arms, cells):
    arm, cell = arms["track"], cells["track"]
    q = some_postures(arm, 2)
    m = read_plan(tmp_path, arm, cell, q)
    words = read_axes(plan_program(m, arm, "measure").decode())
    assert [list(w) for w in words] == [["A1", "A2", "A3", "A4", "A5", "A6", "E1"]] * 2
    np.testing.assert_allclose([w["E1"] for w in words], q[:, 0])
    np.testing.assert_allclose([w["A1"] for w in words], q[:, 1])
    assert "{E6AXIS: A1" in plan_program(m, arm, "measure").decode()


def test_signs_zeros_and_other_words_are_the_users(kr270):
    arm, _ = kr270
    words = read_words(["A1=-joint_1", "a2 = joint_2-90", "E1=joint_6"], arm)
    values = word_values(np.deg2rad([[10.0, 20, 30, 40, 50, 60]]), words, arm)
    found = dict(zip([w.word for w in words], values[0], strict=True))
    assert found == pytest.approx({"A1": -10, "A2": -70, "A3": 30, "A4": 40, "A5": 50, "E1": 60})


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (["A7=joint_1"], "A1 .. A6 or E1 .. E6"),
        (["A1=joint_9"], "no joint of that name; the arm has joint_1"),
        (["A1=joint_1", "A2=joint_1"], "joint 'joint_1' is given twice"),
        (["A1=joint_2"], "nothing says which word drives 'joint_1'"),
        (["A1=joint_1*2"], "no joint of that name"),
    ],
)
def test_a_wrong_axis_word_is_refused(kr270, texts, said):
    with pytest.raises(InputError, match=re.escape(said)):
        read_words(texts, kr270[0])


@pytest.mark.parametrize("name", ["1st", "a" * 25, "my-plan", "plän", ""])
def test_a_name_no_controller_takes_is_refused(name):
    with pytest.raises(InputError, match="1 to 24 letters"):
        check_name(name)


def test_text_is_made_ascii():
    assert ascii_text('Gr\u00f6\u00dfe "5"') == "Gro?e '5'"
    assert ascii_text("\u00e9 \u5b57") == "e ?"


def test_a_short_tour_is_shorter_and_a_random_one_comes_from_its_seed(tmp_path, kr270):
    arm, cell = kr270
    m = read_plan(tmp_path, arm, cell, some_postures(arm, 25) + [0, -70, 60, 0, 0, 0])
    orders = {how: visiting_order(m, arm.prismatic, how) for how in ("plan", "short", "random")}
    for order in orders.values():
        assert sorted(order) == list(range(25))
    length = {how: total_travel(m, arm.prismatic, order) for how, order in orders.items()}
    assert length["short"] < 0.6 * length["plan"]
    assert length["short"] < 0.6 * length["random"]
    assert (visiting_order(m, arm.prismatic, "random") == orders["random"]).all()
    assert (visiting_order(m, arm.prismatic, "random", seed=1) != orders["random"]).any()


def test_a_tour_of_seven_postures_is_nearly_the_shortest_of_all(tmp_path, kr270):
    """Going to the nearest posture every time makes some of them 7 % longer; turning stretches round mends that."""
    arm, cell = kr270
    ratio = []
    for seed in range(8):
        m = read_plan(tmp_path, arm, cell, some_postures(arm, 7, seed=seed) + [0, -70, 60, 0, 0, 0])
        apart = travel(postures(m), arm.prismatic)
        best = min(sum(apart[a, b] for a, b in pairwise((0, *p))) for p in permutations(range(1, 7)))
        ratio.append(total_travel(m, arm.prismatic, visiting_order(m, arm.prismatic, "short")) / best)
    assert max(ratio) < 1.06
    assert np.mean(ratio) < 1.02


@pytest.mark.parametrize("how", ["short", "random"])
def test_a_repeated_posture_is_approached_again(tmp_path, kr270, how):
    """Experiments of one posture in a row would say nothing of repeatability: the arm would stand still."""
    arm, cell = kr270
    q = np.repeat(some_postures(arm, 4) + [0, -70, 60, 0, 0, 0], 3, axis=0)
    m = read_plan(tmp_path, arm, cell, q)
    order = visiting_order(m, arm.prismatic, how)
    assert sorted(order) == list(range(12))
    assert (np.abs(np.diff(postures(m)[order], axis=0)).max(axis=1) > 1e-3).all()


def test_planned_times_give_the_planned_order(tmp_path, kr270):
    arm, cell = kr270
    m = read_plan(tmp_path, arm, cell, some_postures(arm, 3) + [0, -70, 60, 0, 0, 0], time_s=[300, 100, 200])
    order = visiting_order(m, arm.prismatic, "plan")
    assert order.tolist() == [1, 2, 0]
    rows = in_order(m, order).splitlines()
    assert [row.split(",")[0] for row in rows[1::3]] == ["E02", "E03", "E01"]
    assert "time_s" in rows[0]
    assert "time_s" not in in_order(m, np.array([0, 1, 2])).splitlines()[0]
