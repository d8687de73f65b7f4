"""Several harmonics of one joint are one effect; what the search adds to a named one, and what it leaves out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from drake_stiffness.diagnosis.evidence import basis_of
from drake_stiffness.diagnosis.growth import further_suspects, grown, is_more_of, may_grow
from drake_stiffness.diagnosis.naming import Remaining, best_variant
from drake_stiffness.effects import make_effect
from drake_stiffness.effects.harmonics import JointPeriodicError
from drake_stiffness.errors import InputError


@dataclass(frozen=True, eq=False)
class Turning(Remaining):
    """What is left of readings of one angle."""

    q: np.ndarray

    def columns_of(self, effect):
        return np.column_stack([f(h * self.q) for h in effect.harmonics for f in (np.sin, np.cos)])


@pytest.fixture(scope="module")
def left():
    """A turning joint that errs once, twice and seven times a turn; once a turn is fitted already."""
    rng = np.random.default_rng(0)
    q = rng.uniform(-np.pi, np.pi, 300)
    r = 2 * np.sin(q) + 1.0 * np.sin(2 * q + 0.3) + 0.7 * np.cos(7 * q) + rng.normal(size=q.size)
    Q = basis_of(np.column_stack([np.sin(q), np.cos(q)]))
    return Turning(None, Q, r - Q @ (Q.T @ r), q.size - 2, q)


@pytest.fixture(scope="module")
def more(left):
    """What was found besides the named harmonic."""
    (suspect,) = further_suspects([JointPeriodicError("joint_1")])
    rests = [left.rest(variant) for variant in suspect.variants]
    return best_variant(left, suspect, rests, [basis_of(S) for S in rests])


def test_all_harmonics_that_are_beyond_doubt_join_and_no_others(left, more):
    assert set(grown(left, more, level=1e-5).harmonics) == {1.0, 2.0, 7.0}


def test_it_is_more_of_the_named_effect_and_not_a_second_of_the_kind(more):
    assert is_more_of(more, more.suspect.of)
    assert not is_more_of(more, JointPeriodicError("joint_1"))
    assert more.suspect.name != "joint_periodic_error at joint_1"
    assert may_grow(more, [more])


def test_an_effect_holds_no_more_than_six_harmonics():
    assert not list(JointPeriodicError("joint_1", harmonic=[1, 2, 3, 4, 5, 6]).further())
    assert len(list(JointPeriodicError("joint_1", harmonic=[1, 2]).further())) == 58


def test_several_harmonics_have_a_name_for_each_value_and_survive_writing():
    one, three = JointPeriodicError("joint_1", harmonic=2.0), JointPeriodicError("joint_1", harmonic=[1.0, 2.0, 7.5])
    assert [p.name for p in one.parameters] == ["sin", "cos"]
    assert [p.name for p in three.parameters] == ["sin_1", "cos_1", "sin_2", "cos_2", "sin_7_5", "cos_7_5"]
    again = make_effect(three.kind, three.where, three.settings())
    assert again.harmonics == three.harmonics
    assert one.settings()["harmonic"] == 2.0


@pytest.mark.parametrize("wrong", [0.0, -1.0, [], [1.0, 1.0], "teeth", [1.0, "two"], float("nan")])
def test_what_is_no_number_of_periods_is_refused(wrong):
    with pytest.raises(InputError, match="harmonic"):
        make_effect("joint_mesh_stiffness", "joint_1", {"harmonic": wrong})
