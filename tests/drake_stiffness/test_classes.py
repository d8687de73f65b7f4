"""What a class of suspects holds: the truth, however the noise falls, and little else."""

from dataclasses import replace

import numpy as np
import pytest

from drake_stiffness.diagnosis import evidence
from drake_stiffness.diagnosis.classes import beyond_noise, choices_among, confounded_with, may_be
from drake_stiffness.diagnosis.suspects import Suspect

ROWS, TRIALS = 60, 2000


def trial(S, r):
    Q = evidence.basis_of(S)
    fit = Q @ (Q.T @ r)
    return evidence.Tested(
        Suspect("some", "where", ()), 0, float(fit @ fit), 0.0, 0.0, 0.0, np.zeros(Q.shape[1]), fit, (Q,)
    )


def like(rng, truth, correlation):
    """A column of that correlation with a unit vector."""
    across = rng.normal(size=ROWS)
    across -= truth * (truth @ across)
    return correlation * truth + np.sqrt(1 - correlation**2) * across / np.linalg.norm(across)


@pytest.mark.parametrize("sigma", [3.0, 6.0, 15.0])
@pytest.mark.parametrize("freedom", ["as free", "the truth is freer", "the truth is simpler", "the truth is a part"])
def test_the_truth_is_left_out_of_the_class_of_another_once_in_a_hundred(freedom, sigma):
    rng = np.random.default_rng(4)
    truth = np.eye(ROWS)[0]
    true, chosen = truth[:, None], like(rng, truth, 0.8)[:, None]
    if freedom == "the truth is freer":
        true = np.hstack([true, rng.normal(size=(ROWS, 4))])
    elif freedom != "as free":
        chosen = np.hstack([chosen, rng.normal(size=(ROWS, 4))])
        if freedom == "the truth is a part":
            chosen[:, 1] = truth
    data = sigma * truth + rng.normal(size=(TRIALS, ROWS))
    pairs = [(trial(true, r), trial(chosen, r)) for r in data]
    out = np.mean([not may_be(a, b, 1.0) for a, b in pairs])
    # At most once in a hundred; 20 in 2000 and three standard deviations of that count.
    assert out < 0.0167, f"left out {100 * out:.1f} %"


def test_the_best_of_many_choices_does_not_push_the_truth_out():
    """Twenty variants that resemble the truth alike: one of them leads by what noise lends the best of twenty."""
    rng = np.random.default_rng(6)
    truth = np.eye(ROWS)[0]
    variants = [evidence.basis_of(like(rng, truth, 0.85)[:, None]) for _ in range(20)]
    unpaid = paid = 0
    for r in 3.0 * truth + rng.normal(size=(TRIALS, ROWS)):
        best = trial(max(variants, key=lambda Q: float(((Q.T @ r) ** 2).sum())), r)
        true = trial(truth[:, None], r)
        unpaid += not may_be(true, best, 1.0)
        paid += not may_be(true, best, 1.0, choices_among(variants, r))
    assert unpaid > 0.05 * TRIALS
    assert paid < 0.0167 * TRIALS, f"left out {100 * paid / TRIALS:.1f} %"


def test_neighbouring_constants_are_no_choice_and_neither_are_hopeless_ones():
    rng = np.random.default_rng(7)
    one = rng.normal(size=(ROWS, 2))
    near = [evidence.basis_of(one + 0.01 * k * rng.normal(size=one.shape)) for k in range(9)]
    assert choices_among(near, one[:, 0]) == 1
    apart = [evidence.basis_of(np.eye(ROWS)[:, 2 * k : 2 * k + 2]) for k in range(9)]
    assert choices_among(apart, np.ones(ROWS)) == 9
    assert choices_among(apart, np.where(np.arange(ROWS) < 4, 1.0, 0.1)) == 2


def test_who_is_far_behind_is_not_in_the_class():
    rng = np.random.default_rng(5)
    truth = np.eye(ROWS)[0]
    other = np.hstack([like(rng, truth, 0.8)[:, None], rng.normal(size=(ROWS, 2))])
    data = 15.0 * truth + rng.normal(size=(500, ROWS))
    kept = np.mean([may_be(trial(other, r), trial(truth[:, None], r), 1.0) for r in data])
    assert kept < 0.01


def named(name, S, r):
    return replace(trial(S, r), suspect=Suspect(name, "where", ()))


def class_of(chosen, others, r, **searched):
    return [
        t.suspect.kind
        for t in confounded_with(
            chosen, others, r, 1.0, {f"{name} at where": bases for name, bases in searched.items()}
        )
    ]


@pytest.mark.parametrize(("values", "choices"), [(1, 1), (6, 1), (2, 40)])
def test_noise_alone_explains_nothing_beyond_itself(values, choices):
    rng = np.random.default_rng(8)
    own = []
    for _ in range(TRIALS):
        r, Q = rng.normal(size=ROWS), np.linalg.qr(rng.normal(size=(ROWS, values * min(choices, 20))))[0]
        variants = [Q[:, values * k : values * (k + 1)] for k in range(Q.shape[1] // values)]
        best = trial(max(variants, key=lambda P: float(((P.T @ r) ** 2).sum())), r)
        own.append(beyond_noise(best, 1.0, len(variants)))
    assert -0.15 * (1 if choices == 1 else 7) < np.mean(own) < 0.15, (
        "two log n is a little more than the best of n gains"
    )


def test_what_another_of_the_class_leads_by_far_is_not_in_it():
    """Three suspects: the chosen one is simple, the best explains far more, the third just less than the chosen one."""
    rng = np.random.default_rng(9)
    truth = np.eye(ROWS)[0]
    chosen, third = like(rng, truth, 0.85)[:, None], like(rng, truth, 0.7)[:, None]
    data = 7.0 * truth + rng.normal(size=(500, ROWS))
    kept = {"true": 0, "third": 0}
    alone = 0
    for r in data:
        one, other, best = named("chosen", chosen, r), named("third", third, r), named("true", truth[:, None], r)
        alone += class_of(one, [other], r) == ["third"]
        for name in class_of(one, [other, best], r):
            kept[name] += 1
    assert kept["true"] > 0.99 * len(data)
    assert kept["third"] < 0.25 * alone


@pytest.mark.parametrize("sigma", [5.0, 8.0, 15.0])
@pytest.mark.parametrize("freedom", [1, 5, 8])
def test_a_true_effect_of_many_values_stays_beside_a_simpler_one(sigma, freedom):
    """The truth points anywhere in its span; one column that correlates 0.9 with it was chosen."""
    rng = np.random.default_rng(10)
    left_out = n = 0
    for _ in range(1500):
        span = np.linalg.qr(rng.normal(size=(ROWS, freedom)))[0]
        truth = span @ rng.normal(size=freedom)
        truth /= np.linalg.norm(truth)
        simple = like(rng, truth, 0.9)
        r = sigma * truth + rng.normal(size=ROWS)
        left_out += class_of(named("simple", simple[:, None], r), [named("true", span, r)], r) == []
        n += 1
    assert left_out < 0.03 * n, f"left out {100 * left_out / n:.1f} %"


def test_a_lucky_constant_is_paid_for_in_the_class():
    rng = np.random.default_rng(11)
    truth = np.eye(ROWS)[0]
    choice = [evidence.basis_of(rng.normal(size=(ROWS, 2))) for _ in range(60)]
    with_choice = without = 0
    for r in 4.0 * truth + rng.normal(size=(500, ROWS)):
        true = named("true", truth[:, None], r)
        lucky = named("lucky", max(choice, key=lambda Q: float(((Q.T @ r) ** 2).sum())), r)
        without += class_of(true, [lucky], r) == ["lucky"]
        with_choice += class_of(true, [lucky], r, lucky=choice) == ["lucky"]
    assert with_choice < 0.8 * without


@pytest.mark.parametrize(("rivals", "at_most"), [(1, 0.015), (5, 0.025), (15, 0.05)])
def test_more_rivals_push_the_truth_out_of_the_class_of_one_of_them_a_few_times_in_a_hundred(rivals, at_most):
    rng = np.random.default_rng(12)
    truth = np.eye(ROWS)[0]
    left_out = 0
    for _ in range(1000):
        r = 6.0 * truth + rng.normal(size=ROWS)
        some = [named(f"rival {k}", like(rng, truth, 0.88)[:, None], r) for k in range(rivals)]
        left_out += "true" not in class_of(some[0], [*some, named("true", truth[:, None], r)], r)
    assert left_out <= at_most * 1000, f"left out {left_out / 10:.1f} %"
