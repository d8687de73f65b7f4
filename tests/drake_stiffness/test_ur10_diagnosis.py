"""What a real UR10 that is believed rigid lacks first, where the data lie beside the project. The whole run is docs/ur10_diagnosis.md."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drake_stiffness.diagnosis.bench import Bench
from drake_stiffness.diagnosis.confirmation import held_out
from drake_stiffness.diagnosis.generic import fit_process
from drake_stiffness.diagnosis.rigidity import noise_of_remainder, noise_shown
from drake_stiffness.diagnosis.search import most_convincing
from drake_stiffness.diagnosis.signatures import Scene
from drake_stiffness.diagnosis.suspects import separate_untestable, suspects
from drake_stiffness.identification import identify
from drake_stiffness.observation import observe, restrict
from drake_stiffness.start import starting_model
from drake_stiffness.task import read_task

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "ur10_series_b"
SHOULDER = ("joint_compliance", "shoulder_lift_joint")
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"the measured data are not in this checkout ({DATA})")


@pytest.fixture(scope="module")
def first_round():
    """Every suspect against geometry alone, on half the postures; a quarter takes no part. Bench, round, held-out readings, said."""
    task, said = read_task(DATA / "campaign.yaml"), []
    part = np.arange(task.held.size) % 4
    o, o_held = (
        observe(restrict(task.measurements, which), task.displacement, task.campaign.noise)
        for which in (part < 2, part == 3)
    )
    base = identify(starting_model(task.model, o.measurements), o)
    testable, untestable = separate_untestable(suspects(base.model), base.model, o.measurements, task.displacement)
    bench = Bench(base, o, testable, 0, said.append)
    return bench, bench.round((), set()), o_held, said, untestable


def test_the_shoulder_that_gives_way_under_weight_goes_first(first_round):
    bench, tested, o_held, said, _ = first_round
    chosen = most_convincing(tested.passed, bench.left(()))
    assert (chosen.suspect.kind, chosen.suspect.where) == SHOULDER
    joined = bench.join((), chosen, tested)
    fit = bench.fit([joined.effect])
    assert 9e-6 < fit.model.values[-1][0] < 18e-6  # rad/(N m)
    before, after = held_out(bench.base, o_held)[0], held_out(fit, o_held)[0]
    assert 0.40 < before.rms_mm < 0.50
    assert after.rms_mm < before.rms_mm - 0.015
    assert [text.split()[0] for text in said] == ["trying", "adding"]


def test_joints_that_weight_does_not_turn_show_no_compliance(first_round):
    _, tested, *_ = first_round
    passed = {t.suspect.where for t in tested.passed if t.suspect.kind == "joint_compliance"}
    assert not passed & {"shoulder_pan_joint", "wrist_3_joint"}


def test_one_reflector_and_no_repeats_still_show_that_the_stated_noise_is_too_small(first_round):
    bench = first_round[0]
    assert noise_shown(Scene(bench.base.model, bench.o), bench.base.residual).dof <= 0
    shown = noise_of_remainder(fit_process(bench.left(()), bench.base.identifiability.seen), bench.o.sigma_p)
    assert shown.implausible
    assert 1.8 < shown.ratio < 2.7


def test_what_needs_loads_or_times_is_untestable_and_never_absent(first_round):
    kinds = {u.kind for u in first_round[4]}
    assert {"joint_hysteresis", "joint_hardening", "tracker_drift"} <= kinds
