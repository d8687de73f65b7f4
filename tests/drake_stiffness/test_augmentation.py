"""What more postures would bring is what they bring when they are measured."""

import re

import numpy as np
import pytest
from three_arms import KR270

from drake_stiffness.design.augmentation import measured_information, settings_like, what_more
from drake_stiffness.design.criteria import Determinant
from drake_stiffness.design.design import choose
from drake_stiffness.design.job import plan_measurements
from drake_stiffness.design.plan_table import experiment_names
from drake_stiffness.design.space import prepare
from drake_stiffness.errors import InputError
from drake_stiffness.jobs import identify_campaign
from drake_stiffness.observation import columns
from drake_stiffness.task import read_task


@pytest.fixture(scope="module")
def found():
    return identify_campaign(KR270 / "campaign.yaml")


def test_the_start_is_the_information_of_the_observation_matrix(found):
    task = read_task(KR270 / "campaign.yaml")
    A = columns(task.observations(), found.model)
    R = measured_information(found.groups, ("E01",)).R
    np.testing.assert_allclose(R.T @ R, A.T @ A, rtol=1e-8, atol=1e-9 * (A.T @ A).max())


def test_added_postures_only_add_information(found):
    settings = settings_like(found.measurements, 0.012).model_copy(update={"candidates": 100, "random_plans": 10})
    measured = measured_information(found.groups, found.measurements.experiments)
    space = prepare(found.model, 4, settings, measured=measured)
    before = Determinant().value(space.information.start)
    d = choose(space, Determinant(), 4)
    assert before < d.random.min() < d.random.max() < d.value <= d.relaxation.bound
    one = choose(space, Determinant(), 1)  # a single posture is enough where everything is determined already
    assert before < one.value < d.value


def test_every_doubtful_parameter_gets_a_suggestion_that_holds(found):
    """The suggested posture, measured as often as it is said: the ratio by full algebra, without rank updates."""
    groups, m = found.groups, found.measurements
    suggestions = what_more(found.model, groups, m, 0.012)
    doubtful = [name for name, group in zip(groups.base_names, groups.group, strict=True) if group == "G1~"]
    assert [s.parameter for s in suggestions] == doubtful != []
    settings = settings_like(m, 0.012).model_copy(update={"candidates": 400})
    space = prepare(found.model, 1, settings, measured=measured_information(groups, m.experiments))
    for s in suggestions:
        k = groups.base_names.index(s.parameter)
        c = groups.found.matrix[k] @ space.basis
        F = space.information.of(np.arange(space.candidates.number))
        after = [c @ np.linalg.solve(space.information.start + f, c) for f in F]
        before = c @ np.linalg.solve(space.information.start, c)
        best = int(np.argmin(after))
        assert s.q == pytest.approx(space.candidates.q[:, best])
        one = s.ratio * np.sqrt(before / after[best])
        if s.postures == 1:
            assert s.reached == pytest.approx(one, rel=1e-6)
            assert s.reached > 5
        else:
            assert one < 5
        assert s.ratio == pytest.approx(groups.ratio[k])
        assert s.text.startswith(f"{s.parameter} (ratio ")
        assert re.search(r"joint_1 -?\d+ deg.* N \(.* kg\) down", s.text)


def test_a_doubtful_joint_is_told_by_the_moment_about_its_axis(tmp_path):
    """A short, weakly loaded campaign leaves wrist joints in doubt."""
    rows = (KR270 / "measurements.csv").read_text().splitlines()
    (tmp_path / "m.csv").write_text("\n".join([rows[0], *(r for r in rows if r[:3] in ("E01", "E02", "E03"))]))
    cell = (KR270 / "cell.yaml").read_text().replace("kr270.urdf", str(KR270 / "kr270.urdf"))
    (tmp_path / "cell.yaml").write_text(cell.replace("links: all", "links: none"))
    sigma = 4.0
    text = f"cell: cell.yaml\nmeasurements: m.csv\nnoise: {{position_sigma_mm: {sigma}}}\n"
    (tmp_path / "campaign.yaml").write_text(text)
    found = identify_campaign(tmp_path / "campaign.yaml")
    suggestions = what_more(found.model, found.groups, found.measurements, sigma)
    assert suggestions, found.groups.ratio
    for s in suggestions:
        own, used = map(
            float, re.search(r"moment about its axis \((\d+) N m; the campaign's largest: (\d+) N m", s.text).groups()
        )
        assert own > 0
        assert used > 0


def test_a_plan_that_augments_goes_on_with_names_loads_and_noise_of_the_campaign(found):
    result = plan_measurements(KR270 / "cell.yaml", 2, "d", campaign=KR270 / "campaign.yaml")
    assert result.names == ("E31", "E32")
    assert "-3500.000" in result.text
    assert result.designed.space.settings.noise.position_sigma_mm == 0.012
    assert len(result.suggestions) > 0
    assert result.to_dict()["measured_before"] == list(found.measurements.experiments)


def test_a_campaign_of_another_cell_is_refused(tmp_path):
    other = (KR270 / "cell.yaml").read_text().replace("mass_kg: 90.0", "mass_kg: 80.0")
    (tmp_path / "cell.yaml").write_text(other.replace("kr270.urdf", str(KR270 / "kr270.urdf")))
    with pytest.raises(InputError, match="campaign can only go on with the robot"):
        plan_measurements(tmp_path / "cell.yaml", 2, "d", campaign=KR270 / "campaign.yaml")


def test_names_of_experiments_go_on_where_others_end():
    assert experiment_names(3) == ("E01", "E02", "E03")
    assert experiment_names(2, ("E07", "home")) == ("E08", "E09")
    assert experiment_names(101)[-1] == "E101"
