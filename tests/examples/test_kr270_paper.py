"""The paper's application on small campaigns: the truth is Table 1's, what is fitted finds it, and a program comes out better."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

KR270_PAPER = Path(__file__).parents[2] / "examples" / "kr270_paper"
sys.path.insert(0, str(KR270_PAPER))

import application  # noqa: E402
import fits  # noqa: E402
import world  # noqa: E402

from drake_stiffness.effects.gravity_compensator import GravityCompensator  # noqa: E402
from drake_stiffness.identification import identify  # noqa: E402
from drake_stiffness.jobs import inspect  # noqa: E402
from drake_stiffness.task import Task, read_task  # noqa: E402

K_C, S_0 = (world.TABLE_1[name][0] for name in ("k_c", "s_0"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("paper")


def test_the_complete_model_has_260_parameters() -> None:
    result = inspect(KR270_PAPER / "cell_spring.yaml").to_dict()
    assert result["counts"] == {"complete": 258, "symmetric": 153, "beam": 62}
    assert result["parameters_total"] == 260
    assert [(e["kind"], e["where"], e["unknowns"]) for e in result["effects"]] == [
        ("gravity_compensator", "joint_2", 2)
    ]


def test_the_printed_spring_would_pull_with_meganewtons() -> None:
    found = application.numbers_of_the_paper()
    assert found["pull, all angles"] == pytest.approx((0.37e6, 2.94e6), rel=0.01)
    assert found["share, within limits"] == pytest.approx((-0.130, 0.0856), abs=1e-3)
    assert found["torque, within limits"][0] < -3e5  # the arm weighs on joint 2 with less than 1e4


def test_the_plant_s_joint_2_varies_as_the_effect_says_though_it_knows_only_distances() -> None:
    q = np.radians(np.linspace(-140.0, -5.0, 28))
    for variant, lever_deg, x in (
        ("stiffness", 0.0, np.array([1 / K_C, S_0 / K_C])),
        ("spring", -90.0, world.BALANCING * np.array([1.0, S_0])),
    ):
        arm = world.true_arm(variant)
        spring = arm.stiffening or arm.compensator
        assert spring is not None
        ours = GravityCompensator("joint_2", (0.68593, 0.12030), 0.18472, lever_deg).stiffening(q, x)
        assert spring.stiffness_about_joint(arm.chain, q) == pytest.approx(ours, abs=1e-6 * np.abs(ours).max())


def test_a_spring_that_carries_the_arm_shows_in_positions_by_millimetres_and_in_displacements_hardly() -> None:
    moved, lifted = world.spring_in_readings(8)
    assert np.median(lifted) > 1e-3
    assert moved.max() < 50e-6
    assert np.median(moved) < world.TRACKER_M


@pytest.fixture(scope="module")
def few(folder: Path) -> tuple[Task, fits.Fitted]:
    task = read_task(world.write_campaign(folder, "stiffness", 15))
    o = task.observations()
    return task, fits.finished("complete", identify(task.model, o), o, "sdp")


def test_the_compensator_of_table_1_is_found_on_what_its_joint_stands_for(few: tuple[Task, fits.Fitted]) -> None:
    """What neighbours give way counts for the joint in part, and k_c then comes out larger by the square; s_0 stays."""
    task, fit = few
    assert fit.chi2_per_dof == pytest.approx(1.0, abs=0.1)
    share = fit.value("joint_2")[0] / world.TABLE_1["joint_2"][0]
    assert 0.8 < share < 1.4
    (k_c, k_sigma), (s_0, s_sigma) = fit.value("k_c"), fit.value("s_0")
    assert abs(k_c / share**2 - K_C) < 4 * k_sigma
    assert abs(s_0 - S_0) < 4 * s_sigma
    o = task.observations()
    without = task.model.subset([not isinstance(e, GravityCompensator) for e in task.model.effects])
    assert fits.finished("without", identify(without, o), o, "sdp").chi2_per_dof > 2.0


def test_a_milled_program_is_better_by_links_and_compensator_than_by_joints(
    folder: Path, few: tuple[Task, fits.Fitted]
) -> None:
    task, complete = few
    errors = application.mill(folder, "stiffness", [fits.simpler(task)[0], complete])
    raw = errors["uncompensated"]
    assert errors["complete"].percent_compensated(raw) > 99.5
    assert errors["complete"].max_mm < 0.02
    assert errors["joints only"].percent_compensated(raw) < 97.0
