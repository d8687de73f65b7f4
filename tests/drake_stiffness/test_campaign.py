"""campaign.yaml and measurements.csv: units, order, hold-out, and what is refused."""

import logging

import numpy as np
import pytest
from synthetic import VERTICAL, plan, table, table_text
from three_arms import KR270

from drake_stiffness.campaign import HoldOut, read_campaign_file, read_measurements
from drake_stiffness.errors import InputError
from drake_stiffness.hold_out import held_out_experiments, posture_groups

HEAD = (
    "experiment,step,point,joint_1_deg,joint_2_deg,joint_3_deg,joint_4_deg,joint_5_deg,joint_6_deg,fz_kN,x_mm,y_mm,z_mm"
)
ROWS = [
    "B,1,P1,10,-90,90,0,0,0,-2.5,1001,2000,3000",
    "B,0,P1,10,-90,90,0,0,0,0,1000,2000,3000",
    "A,0,P2,20,-80,70,10,20,30,0,1,2,3",
    "A,2,P2,20,-80,70,10,20,30,1,2,2,3",
]


def read(tmp_path, arms, text=None, *, head=HEAD, rows=ROWS, readings=True):
    path = tmp_path / "m.csv"
    path.write_text("\n".join([head, *rows]) + "\n" if text is None else text)
    return read_measurements(path, arms["kr270"], ("P1", "P2"), np.zeros(3), readings=readings)


def test_rows_become_cases_ordered_by_experiment_and_step_in_si(tmp_path, arms):
    m = read(tmp_path, arms)
    assert m.experiments == ("B", "A")
    assert m.cases.step.tolist() == [0, 1, 0, 2]
    assert m.cases.wrench[2].tolist() == [0, -2500, 0, 1000]
    assert m.cases.q[:, 0] == pytest.approx(np.radians([10, -90, 90, 0, 0, 0]))
    assert m.case.tolist() == [1, 0, 2, 3]
    assert m.position[0] == pytest.approx([1.001, 2.0, 3.0])
    assert m.unloaded.tolist() == [True, False, True, False]
    assert [m.line(i) for i in range(4)] == [2, 3, 4, 5]
    assert np.isnan(m.orientation).all()
    assert np.isnan(m.cases.time_s).all()


def test_other_units_say_the_same(tmp_path, arms):
    plain = read(tmp_path, arms)
    head = (
        HEAD.replace("joint_1_deg", "joint_1_rad")
        .replace("fz_kN", "fz_N")
        .replace("x_mm", "x_um")
        .replace("y_mm", "y_m")
    )
    rows = []
    for row in ROWS:
        c = row.split(",")
        c[3], c[9] = repr(float(np.radians(float(c[3])))), str(1000 * float(c[9]))
        c[10], c[11] = str(1000 * float(c[10])), str(float(c[11]) / 1000)
        rows.append(",".join(c))
    other = read(tmp_path, arms, head=head, rows=rows)
    assert other.position == pytest.approx(plain.position, rel=1e-12)
    assert other.cases.q == pytest.approx(plain.cases.q, rel=1e-12)
    assert np.array_equal(other.cases.wrench, plain.cases.wrench)


def test_a_plan_without_points_reads_every_point_and_needs_no_readings(tmp_path, arms):
    head = HEAD.replace(",point", "").replace(",x_mm,y_mm,z_mm", "")
    m = read(tmp_path, arms, head=head, rows=["A,0,10,-90,90,0,0,0,0", "A,1,10,-90,90,0,0,0,1"], readings=False)
    assert m.position is None
    assert m.point.tolist() == ["P1", "P2", "P1", "P2"]
    assert m.case.tolist() == [0, 0, 1, 1]


def changed(row, column, value, head=HEAD):
    cells = ROWS[row].split(",")
    cells[head.split(",").index(column)] = value
    return [*ROWS[:row], ",".join(cells), *ROWS[row + 1 :]]


BAD = {
    "missing column": ({"head": HEAD.replace("joint_3_deg", "joint_3_degrees")}, ["joint_3_degrees", "line 1"]),
    "joint missing": ({"head": HEAD.replace(",joint_3_deg", ""), "rows": ["A,0,P1,1,-90,0,0,0,0,1,2,3"]}, ["missing column 'joint_3_deg' or 'joint_3_rad'"]),
    "joint in metres": ({"head": HEAD.replace("joint_3_deg", "joint_3_mm")}, ["unknown column 'joint_3_mm'", "joint_3_deg"]),
    "unknown joint": ({"head": HEAD.replace("fz_kN", "joint_7_deg")}, ["joint_7_deg"]),
    "wrong unit": ({"head": HEAD.replace("fz_kN", "fz_lbf")}, ["line 1", "fz_lbf", "Did you mean 'fz_"]),
    "no experiment column": ({"head": HEAD.replace("experiment", "note")}, ["missing column 'experiment'"]),
    "no readings": ({"head": HEAD.replace("x_mm,y_mm,z_mm", "time_s,note,repeat")}, ["missing column 'x_mm'", "dx_mm"]),
    "half a reading": ({"head": HEAD.replace("y_mm", "note")}, ["missing column 'y_mm'"]),
    "both kinds": ({"head": HEAD.replace("y_mm", "dy_mm")}, ["both positions"]),
    "nan": ({"rows": changed(1, "y_mm", "nan")}, ["line 3", "column 'y_mm'", "'nan'"]),
    "word": ({"rows": changed(3, "x_mm", "12,5").copy()[:3] + [changed(3, "x_mm", "12.5mm")[3]]}, ["line 5", "column 'x_mm'", "'12.5mm'"]),
    "empty joint": ({"rows": changed(0, "joint_2_deg", "")}, ["line 2", "column 'joint_2_deg'", "empty cell"]),
    "step": ({"rows": changed(0, "step", "1.5")}, ["line 2", "column 'step'", "1.5"]),
    "unknown point": ({"rows": changed(2, "point", "P7")}, ["line 4", "column 'point'", "'P7'", "P1, P2"]),
    "no name": ({"rows": changed(2, "experiment", " ")}, ["line 4", "column 'experiment'"]),
    "duplicate": ({"rows": [*ROWS, ROWS[1]]}, ["line 6", "the first is line 3", "'B'", "step 0", "'P1'"]),
    "other load in one step": ({"rows": [*ROWS, "A,2,P1,20,-80,70,10,20,30,1.5,2,2,3"]}, ["line 6", "line 5", "same step"]),
    "other posture in one step": ({"rows": [*ROWS, "A,2,P1,20,-80,71,10,20,30,1,2,2,3"]}, ["line 6", "line 5"]),
    "other posture in one experiment": ({"rows": changed(0, "joint_4_deg", "5")}, ["'B'", "joint_4", "one arm configuration"]),
    "weight": ({"head": HEAD.replace("fz_kN", "weight")}, ["line 2", "column 'weight'", "-2.5"]),
    "all weights 0": ({"head": HEAD + ",weight", "rows": [r + ",0" for r in ROWS]}, ["weight 0", "nothing is left"]),
    "half an orientation": ({"head": HEAD + ",rx_mrad,ry_mrad", "rows": [r + ",1,2" for r in ROWS]}, ["rx_mrad, ry_mrad and rz_mrad"]),
    "an orientation with a gap": ({"head": HEAD + ",rx_mrad,ry_mrad,rz_mrad", "rows": [r + ",1,2," for r in ROWS]}, ["line 2", "rx, ry and rz"]),
    "one load in two units": ({"head": HEAD.replace("x_mm", "fz_N")}, ["fz_N and fz_kN"]),
}  # fmt: skip


@pytest.mark.parametrize("name", list(BAD))
def test_a_table_with_a_fault_is_refused_naming_line_and_column(tmp_path, arms, name):
    changes, words = BAD[name]
    with pytest.raises(InputError) as error:
        read(tmp_path, arms, **changes)
    for word in ["m.csv", *words]:
        assert word in str(error.value)


def test_numbered_repeats_are_no_duplicates(tmp_path, arms):
    m = read(tmp_path, arms, head=HEAD + ",repeat", rows=[ROWS[1] + ",1", ROWS[1] + ",2", ROWS[0] + ",1"])
    assert m.case.tolist() == [0, 0, 1]


def test_a_posture_outside_the_limits_is_a_warning_with_its_row(tmp_path, arms, caplog):
    rows = [r.replace("10,-90,90", "10,-150,90") for r in ROWS]
    with caplog.at_level(logging.WARNING, "drake_stiffness"):
        read(tmp_path, arms, rows=rows)
    assert "line 3: joint 'joint_2' stands at -150 deg" in caplog.text
    assert "-140 .. -5" in caplog.text
    assert "joint_3" not in caplog.text


# -- the split -------------------------------------------------------------------------------------------------------------


def posed(tmp_path, arms, cells, shared):
    """12 experiments, of which those in `shared` have the posture of experiment 0."""
    arm, cell = arms["kr270"], cells["kr270"]
    cases = plan(arm, cell, 12, np.random.default_rng(0), [VERTICAL])
    for e in shared:
        cases.q[:, cases.experiment == e] = cases.q[:, [0]] + 1e-9
    return table(tmp_path, cell, arm, cases, np.zeros((3, 3, cases.number)))


def test_experiments_of_one_posture_are_held_out_together(tmp_path, arms, cells, caplog):
    m = posed(tmp_path, arms, cells, [4, 7])
    groups = posture_groups(m.cases)
    assert groups[0] == groups[4] == groups[7]
    assert len(set(groups.tolist())) == 10
    for seed in range(30):
        held = held_out_experiments(m, HoldOut(fraction=0.3, seed=seed), "campaign.yaml")
        assert held[0] == held[4] == held[7]
        assert held.sum() == 3 + 2 * held[0]
    with caplog.at_level(logging.WARNING, "drake_stiffness"):
        held = held_out_experiments(m, HoldOut(experiments=("E004", "E010")), "campaign.yaml")
    assert np.flatnonzero(held).tolist() == [0, 4, 7, 10]
    assert "E000, E007" in caplog.text


def test_postures_within_a_millionth_of_a_radian_are_one_wherever_they_lie(tmp_path, arms, cells):
    """Two commands a nanoradian apart on either side of a rounding edge are still one posture."""
    arm, cell = arms["kr270"], cells["kr270"]
    cases = plan(arm, cell, 2, np.random.default_rng(1), [VERTICAL])
    cases.q[:] = np.round(cases.q[:, [0]], 6) + 0.5e-6
    cases.q[0, cases.experiment == 0] -= 1e-9
    cases.q[0, cases.experiment == 1] += 1e-9
    m = table(tmp_path, cell, arm, cases, np.zeros((3, 3, cases.number)))
    assert len(set(posture_groups(m.cases).tolist())) == 1


def test_the_split_depends_on_its_seed_alone(tmp_path, arms, cells):
    m = posed(tmp_path, arms, cells, [])
    splits = [tuple(held_out_experiments(m, HoldOut(fraction=0.25, seed=s), "c")) for s in (0, 0, 1, 2)]
    assert splits[0] == splits[1]
    assert len(set(splits)) > 1
    assert not held_out_experiments(m, None, "c").any()


def test_a_split_that_names_nothing_or_leaves_nothing_is_refused(tmp_path, arms, cells):
    m = posed(tmp_path, arms, cells, [])
    with pytest.raises(InputError, match=r"hold_out.experiments: no experiment 'E99'.*E000"):
        held_out_experiments(m, HoldOut(experiments=("E99",)), "campaign.yaml")
    with pytest.raises(InputError, match="leaves no experiment"):
        held_out_experiments(m, HoldOut(experiments=m.experiments), "campaign.yaml")


# -- campaign.yaml -----------------------------------------------------------------------------------------------------------

SMALL = "cell: cell.yaml\nmeasurements: m.csv\nnoise: {position_sigma_mm: 0.012}\n"
BAD_CAMPAIGNS = {
    "zero sigma": (SMALL.replace("0.012", "0"), ["noise.position_sigma_mm", "found 0", "greater than 0"]),
    "negative sigma": (SMALL.replace("0.012", "-1"), ["noise.position_sigma_mm", "found -1"]),
    "sigma in um": (SMALL.replace("sigma_mm", "sigma_um"), ["noise.position_sigma_um", "Did you mean 'position_sigma_mm'"]),
    "no noise": ("cell: c\nmeasurements: m\n", ["noise: missing"]),
    "quantity": (SMALL + "quantity: velocity\n", ["quantity", "'velocity'", "'displacement' or 'position'"]),
    "frame": (SMALL + "tracker_frame: moon\n", ["tracker_frame", "'moon'"]),
    "estimate": (SMALL + "estimate: [masses]\n", ["estimate.0", "'masses'", "joint_zero_offsets"]),
    "fraction": (SMALL + "hold_out: {fraction: 1.5}\n", ["hold_out.fraction", "1.5", "less than 1"]),
    "both": (SMALL + "hold_out: {fraction: 0.5, experiments: [A]}\n", ["hold_out", "either fraction"]),
    "neither": (SMALL + "hold_out: {seed: 3}\n", ["hold_out", "either fraction"]),
    "key": (SMALL + "holdout: {}\n", ["holdout", "Did you mean 'hold_out'"]),
}  # fmt: skip


@pytest.mark.parametrize("name", list(BAD_CAMPAIGNS))
def test_a_campaign_with_a_fault_is_refused_naming_key_and_value(tmp_path, name):
    text, words = BAD_CAMPAIGNS[name]
    (tmp_path / "campaign.yaml").write_text(text)
    with pytest.raises(InputError) as error:
        read_campaign_file(tmp_path / "campaign.yaml")
    for word in ["campaign.yaml", *words]:
        assert word in str(error.value)


def test_the_campaign_of_the_example_reads(arms, cells):
    campaign = read_campaign_file(KR270 / "campaign.yaml")
    assert campaign.noise.position_sigma_mm == 0.012
    assert campaign.quantity == "displacement"
    m = read_measurements(
        KR270 / campaign.measurements,
        arms["kr270"],
        tuple(cells["kr270"].reference_points_m),
        np.zeros(3),
        readings=True,
    )
    assert len(m.experiments) >= 30


def test_a_written_table_comes_back_to_the_last_digit(tmp_path, arms, cells):
    arm, cell = arms["track"], cells["track"]
    cases = plan(arm, cell, 3, np.random.default_rng(2), [VERTICAL, (1, 2, 3, 4, 5, 6.5)])
    p = np.random.default_rng(3).normal(size=(3, 3, cases.number))
    m = table(tmp_path, cell, arm, cases, p)
    for name in ("q", "wrench", "experiment", "step", "time_s"):
        assert np.array_equal(getattr(m.cases, name), getattr(cases, name)), name
    assert np.array_equal(m.position, p.transpose(2, 0, 1).reshape(-1, 3))
    assert "track_m" in table_text(arm, cases, ("A",), p[:1])
