"""Hardware besides springs in files: cell.yaml, TRUTH.yaml, model.json, process.yaml, and what `inspect` says of it."""

import numpy as np
import pytest
from test_gravity_compensator import BALANCING, SpringJudge, compensator
from test_gravity_compensator import K as K_JOINTS
from test_rules import BLOCK, run
from three_arms import KR270, random_postures

from drake_stiffness.assembly import campaign_effects, joint_spring, make_model
from drake_stiffness.campaign import CampaignFile, Noise
from drake_stiffness.cell import read_cell
from drake_stiffness.effects import make_effect
from drake_stiffness.errors import InputError
from drake_stiffness.jobs import identify_campaign, inspect, simulate
from drake_stiffness.model import load_model
from drake_stiffness.plant import build_arm
from toolpaths.process import check_model, read_process

PREDICT = """
import numpy as np
from drake_stiffness.model import load_model
from drake_stiffness.effects.effect import Cases
from drake_stiffness.simulation import simulate_readings
model = load_model(sys.argv[1])
q = np.array([[0.2, -1.0, 1.3, 0.4, 0.8, 0.1]]).T
cases = Cases(q, np.array([[0.0], [0], [-2500.0], [0], [0], [0]]), model.load_point)
print(*simulate_readings(model, cases, np.array([0]), np.array(["P1"])).p[:, 0])
"""


def test_a_stored_model_keeps_its_compensator_and_predicts_with_it_without_drake(tmp_path, arms, cells):
    arm, cell, effect = arms["kr270"], cells["kr270"], compensator()
    effects = [*(joint_spring(arm, n) for n in arm.joint_names), effect]
    model = make_model(cell, arm, effects, np.concatenate([K_JOINTS, BALANCING]))
    model.save(tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    assert again.effects[-1].settings() == effect.settings()
    assert again.without_links.names[-2:] == (
        "joint_2.gravity_compensator.spring",
        "joint_2.gravity_compensator.preload",
    )
    done = run(BLOCK + PREDICT, str(tmp_path / "model.json"))
    assert done.returncode == 0, done.stderr
    judge = SpringJudge(cell, effect.point_spring(arm.axis_F[1], BALANCING))
    q, wrench = np.array([0.2, -1.0, 1.3, 0.4, 0.8, 0.1]), np.array([0, 0, -2500.0, 0, 0, 0])
    X, _, _ = judge.equilibrium(q, wrench, cell.load_point_m, K_JOINTS, [None] * 7)
    expected = X[:3, :3] @ np.array(cell.reference_points_m["P1"]) + X[:3, 3]
    assert np.array(done.stdout.split(), dtype=float) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"anchor_m": [0.6, 0.1], "lever_m": 0.0}, "lever_m: 0.0"),
        ({"anchor_m": [0.0, 0.0], "lever_m": 0.2}, "not both zero"),
        ({"anchor_m": [0.6, "behind"], "lever_m": 0.2}, "behind"),
        ({"anchor_m": [0.6, 0.1], "lever_m": 0.2, "variant": "gas"}, "expected spring or stiffness"),
        ({"lever_m": 0.2}, "anchor_m"),
    ],
)
def test_settings_that_are_no_compensator_are_refused_with_what_was_found(settings, said):
    with pytest.raises(InputError, match=said):
        make_effect("gravity_compensator", "joint_2", settings)


def test_a_joint_that_slides_or_does_not_exist_has_no_compensator(arms):
    with pytest.raises(InputError, match="slides"):
        compensator("track").check(arms["track"], {})
    with pytest.raises(InputError, match="there is no such joint"):
        compensator("joint_9").check(arms["track"], {})


CELL = """
robot: {{model: {robot}, flange: flange}}
tool: {{mass_kg: 90.0, center_of_mass_m: [0.09, 0.01, 0.16]}}
reference_points_m: {{P1: [0.25, 0.0, 0.1]}}
springs: {{joints: all, links: all, template: symmetric}}
effects: [{effects}]
"""
ENTRY = "{kind: gravity_compensator, where: joint_2, settings: {anchor_m: [0.68593, 0.1203], lever_m: 0.18472}}"


def cell_with(tmp_path, effects):
    (tmp_path / "cell.yaml").write_text(CELL.format(robot=KR270 / "kr270.urdf", effects=effects))
    return tmp_path / "cell.yaml"


def test_inspect_counts_260_for_the_complete_model_with_a_compensator_and_leaves_links_and_joints_as_they_were(
    tmp_path,
):
    result = inspect(cell_with(tmp_path, ENTRY)).to_dict()
    assert result["counts"] == {"complete": 258, "symmetric": 153, "beam": 62}
    assert result["parameters_total"] == 260
    names = [p["name"] for p in result["effects"][0]["parameters"]]
    assert names == ["joint_2.gravity_compensator.spring", "joint_2.gravity_compensator.preload"]
    assert inspect(cell_with(tmp_path, "")).to_dict()["parameters_total"] == 258


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        (ENTRY.replace("gravity", "gravy"), "unknown kind of effect 'gravy_compensator'"),
        (ENTRY.replace("joint_2", "joint_9"), "'joint_9': there is no such joint"),
        (ENTRY.replace("lever_m", "levr_m"), "levr_m"),
        (ENTRY.replace("lever_m: 0.18472", "lever_m: -1"), "lever_m: -1"),
        ("{kind: joint_compliance, where: joint_2}", "springs stand under the key springs"),
        (ENTRY.replace("where", "at"), "effects.0"),
    ],
)
def test_hardware_that_cannot_be_is_refused_naming_file_and_entry(tmp_path, effects, said):
    with pytest.raises(InputError, match=said) as error:
        inspect(cell_with(tmp_path, effects))
    assert "cell.yaml" in str(error.value)


def test_a_virtual_campaign_with_a_compensator_takes_its_geometry_from_the_cell_and_the_fit_finds_it(tmp_path):
    cell = cell_with(tmp_path, ENTRY.replace("0.18472", "0.18472, lever_deg: -90"))
    cell.write_text(cell.read_text().replace("links: all", "links: none"))
    truth = [
        f"{{kind: joint_compliance, where: joint_{i + 1}, parameters: {{k: {k}}}}}"
        for i, k in enumerate(K_JOINTS.tolist())
    ]
    truth.append("{kind: gravity_compensator, where: joint_2, parameters: {spring: 1.5e5, preload: 68700.0}}")
    (tmp_path / "truth.yaml").write_text("effects: [" + ", ".join(truth) + "]\n")
    arm = build_arm(read_cell(cell))
    q = np.degrees(random_postures(arm, 6, np.random.default_rng(9)))
    rows = ["experiment,step," + ",".join(f"{n}_deg" for n in arm.joint_names) + ",fx_N,fy_N,fz_N,mx_Nm"]
    for e in range(6):
        for step, load in enumerate(("0,0,0,0", "0,0,-2500,300", "1500,2500,0,0")):
            rows.append(f"E{e},{step}," + ",".join(repr(float(v)) for v in q[:, e]) + f",{load}")
    (tmp_path / "plan.csv").write_text("\n".join(rows) + "\n")
    made = simulate(cell, tmp_path / "truth.yaml", tmp_path / "plan.csv", tmp_path / "out", 0.0, 0)
    (tmp_path / "out").mkdir()
    for name, text in made.files.items():
        (tmp_path / "out" / name).write_text(text)
    campaign = tmp_path / "out" / "campaign.yaml"
    campaign.write_text(campaign.read_text() + "quantity: position\n")
    model = identify_campaign(campaign).model
    assert model.x[-2:] == pytest.approx(BALANCING, rel=2e-3)


def test_what_the_campaign_estimates_too_stands_twice(tmp_path):
    cell = read_cell(cell_with(tmp_path, "{kind: joint_zero_offset, where: joint_3}"))
    campaign = CampaignFile(
        cell="c", measurements="m", noise=Noise(position_sigma_mm=0.01), estimate=("joint_zero_offsets",)
    )
    with pytest.raises(InputError, match="joint_zero_offset at 'joint_3' stands twice"):
        campaign_effects(campaign, cell, build_arm(cell))


def test_a_process_may_name_a_cell_without_the_compensator_that_the_model_has(tmp_path, arms):
    cell = cell_with(tmp_path, ENTRY)
    model = make_model(read_cell(cell), arms["kr270"], [joint_spring(arms["kr270"], "joint_2"), compensator()])
    (tmp_path / "bare.yaml").write_text(CELL.format(robot=KR270 / "kr270.urdf", effects=""))
    text = "cell: {}\nworkpiece: {{position_m: [1.6, 0, 0.8]}}\nposture_deg: [0, -90, 90, 0, 0, 0]\nforce: {{constant: {{fz_N: -1, frame: tool}}}}\n"
    for name in ("cell.yaml", "bare.yaml"):
        (tmp_path / "process.yaml").write_text(text.format(name))
        check_model(read_process(tmp_path / "process.yaml"), model)
