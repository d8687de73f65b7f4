"""The chosen variant is made as good as it can be, and of forms that fit as well the one is taken that stays bounded."""

from types import SimpleNamespace

import numpy as np
import pytest

from drake_stiffness.diagnosis.evidence import basis_of
from drake_stiffness.diagnosis.naming import best_variant, refine
from drake_stiffness.diagnosis.suspects import Suspect
from drake_stiffness.effects.hardening import JointHardening

ROWS = 50
BOLD, TAME = JointHardening("j"), JointHardening("j", form="two_slopes", knee=100.0)
BEST_KNEE = 120.0


class Left:
    """What a model leaves, as `refine` asks for it: the bold form along one axis, the tame one near it, nearest at one knee."""

    def __init__(self, explained_by_bold, seen_up_to=np.inf):
        self.r = np.random.default_rng(3).normal(size=ROWS)
        self.r[:2] = explained_by_bold, 0.0
        self.dof, self.per_dof = ROWS, 1.0
        self.scene = SimpleNamespace(shows=lambda effect: effect.knee is None or effect.knee <= seen_up_to)

    def rest(self, effect):
        apart = 0.0 if effect.knee is None else 0.25 + abs(np.log(effect.knee / BEST_KNEE))
        return (np.eye(ROWS)[0] + apart * np.eye(ROWS)[1])[:, None]


def refined(left, *variants):
    suspect = Suspect("joint_hardening", "j", variants)
    rests = [left.rest(effect) for effect in variants]
    chosen = best_variant(left, suspect, rests, [basis_of(S) for S in rests])
    return chosen.effect, refine(left, chosen)


@pytest.mark.parametrize(("strength", "kept"), [(8.0, TAME), (80.0, BOLD)])
def test_a_form_that_stays_bounded_is_taken_where_it_fits_within_noise_and_only_there(strength, kept):
    first, then = refined(Left(strength), BOLD, TAME)
    assert first is BOLD
    assert then.form == kept.form


def test_a_knee_moves_to_where_it_fits_best_but_not_where_the_loads_do_not_show_it():
    assert refined(Left(80.0), TAME)[1].knee == pytest.approx(BEST_KNEE, rel=0.06)
    assert 100.0 <= refined(Left(80.0, seen_up_to=110.0), TAME)[1].knee <= 110.0
