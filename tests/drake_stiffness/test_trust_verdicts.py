"""The three witnesses against a value: sign, collinearity, held-out readings; each on matrices made for it."""

import numpy as np
import pytest
from test_base_parameters import as_solution
from test_identifiability import with_springs

from drake_stiffness.assembly import make_model, spring_effects
from drake_stiffness.groups import find_groups
from drake_stiffness.model import Statistics
from drake_stiffness.statistics import GoodnessOfFit
from drake_stiffness.trust import HeldOut, compare, refitted_without, verdicts

GOOD = GoodnessOfFit(0.01, 1.0, 100, 0.5, False)
BAD = GoodnessOfFit(0.01, 9.0, 100, 0.0, True)


@pytest.fixture
def six(arms, cells):
    arm, cell = arms["kr270"], with_springs(cells["kr270"], joints="all", links="none")
    return make_model(cell, arm, spring_effects(cell, arm))


def fitted(model, A, y):
    """Least squares of y = A x + e, as the identification would hand it on; and its groups."""
    x = np.linalg.lstsq(A, y, rcond=None)[0]
    solution = as_solution(model.with_x(x * model.scales), A, y - A @ x)
    view, s, n = solution.identifiability, model.scales, x.size
    cov = view.covariance() * np.outer(s, s)
    return solution, find_groups(solution, Statistics(np.zeros(n), ("",) * n, ((),) * n, cov, view.unseen))


def other_readings(solution, A, y, postures=10):
    x = solution.model.x / solution.model.scales
    return HeldOut(y - A @ x, A, np.repeat(np.arange(postures), len(y) // postures), len(y))


def test_a_surely_negative_compliance_is_not_trusted_and_a_doubtful_sign_is_no_reason(six):
    A = 10 * np.random.default_rng(0).normal(size=(60, 6))
    for value, doubted in ((-1.0, True), (-0.01, False), (1.0, False)):
        solution, groups = fitted(six, A, A @ np.array([1, 1, value, 1, 1, 1]))
        found = verdicts(solution, groups, GOOD, None)
        assert bool(found) is doubted
        if doubted:
            assert found[0].what == "joint_3"
            line = found[0].line()
            assert line.startswith("NOT TRUSTWORTHY: joint_3 = -1e-06 +- ")
            assert "no objection" in line  # random columns are not collinear
            assert "missing" not in line
            assert "something is missing" in verdicts(solution, groups, BAD, None)[0].line()


def test_collinearity_names_the_column_that_imitates_it(six):
    rng = np.random.default_rng(1)
    A = 10 * rng.normal(size=(60, 6))
    A[:, 4] = A[:, 2] + 0.2 * rng.normal(size=60) * 10
    solution, groups = fitted(six, A, A @ np.array([1, 1, -2, 1, 4, 1.0]))
    line = verdicts(solution, groups, GOOD, None)[0].line()
    assert "with joint_5" in line
    share = np.sqrt(1 - 1 / (groups.values.covariance[2, 2] / six.scales[2] ** 2 * (A[:, 2] @ A[:, 2])))
    assert f"{100 * share:.1f} % of its column" in line


def test_an_effect_that_makes_held_out_readings_worse_is_named_and_no_other(six):
    """A missing effect that runs along column 4 in the fit and against it elsewhere."""
    rng = np.random.default_rng(2)
    A, B = 10 * rng.normal(size=(60, 6)), 10 * rng.normal(size=(60, 6))
    x = np.array([1.0, 1, 1, 0, 1, 1])
    solution, groups = fitted(six, A, A @ x + 2.0 * A[:, 3] + rng.normal(size=60))
    held = other_readings(solution, B, B @ x - 2.0 * B[:, 3] + rng.normal(size=60))
    named = [v.what for v in verdicts(solution, groups, GOOD, held)]
    assert named == ["joint_4", "the model"]
    outcome = compare(solution, held)
    assert outcome["joint_4"].with_it > 3 * outcome["joint_4"].without
    assert not any(c.better_without for name, c in outcome.items() if name != "joint_4")


def test_a_sound_model_passes_and_noise_alone_blames_nobody(six):
    rng = np.random.default_rng(3)
    blamed = 0
    for _ in range(40):
        A, B = rng.normal(size=(60, 6)), rng.normal(size=(60, 6))
        x = np.array([1.0, 1, 1, 0, 1, 1])
        solution, groups = fitted(six, A, A @ x + rng.normal(size=60))
        blamed += len(verdicts(solution, groups, GOOD, other_readings(solution, B, B @ x + rng.normal(size=60))))
    assert blamed <= 2


def test_leaving_out_is_a_new_fit_of_the_rest(six):
    rng = np.random.default_rng(4)
    A, y = rng.normal(size=(50, 6)), rng.normal(size=50)
    solution, _ = fitted(six, A, y)
    part = np.array([False, True, False, False, True, False])
    x = solution.model.x / six.scales + refitted_without(solution, part, coarse=False)
    assert x[part] == pytest.approx(0.0, abs=1e-12)
    assert x[~part] == pytest.approx(np.linalg.lstsq(A[:, ~part], y, rcond=None)[0])
