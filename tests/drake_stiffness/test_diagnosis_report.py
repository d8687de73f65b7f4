"""The report of a diagnosis: what was found is on the page, with the figures of the example in the docs; nothing is asked of others."""

import base64
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
if str(ROOT / "examples") not in sys.path:
    sys.path.insert(0, str(ROOT / "examples"))

from drake_stiffness.diagnosis.document import diagnosis_document  # noqa: E402
from drake_stiffness.diagnosis.job import Diagnosed, diagnose_campaign  # noqa: E402
from drake_stiffness.diagnosis.outliers import Outlier  # noqa: E402
from drake_stiffness.diagnosis.words import effect_words, p_words  # noqa: E402
from drake_stiffness.report.diagnosis import answer, diagnosis_report  # noqa: E402
from drake_stiffness.report.diagnosis_arm import residual_arrows  # noqa: E402
from drake_stiffness.report.diagnosis_evidence import next_section  # noqa: E402
from drake_stiffness.report.diagnosis_scene import scene_html  # noqa: E402
from drake_stiffness.report.diagnosis_shape import shapes, without_effect  # noqa: E402
from drake_stiffness.report.solids import arrow  # noqa: E402

HIDDEN = ROOT / "examples" / "kr270_hidden"


@pytest.fixture(scope="module")
def found():
    return diagnose_campaign(HIDDEN / "campaign.yaml")


@pytest.fixture(scope="module")
def page(found):
    return diagnosis_report(found)


def with_changes(result: Diagnosed, **changes) -> Diagnosed:
    """The same result with another diagnosis."""
    d = replace(result.diagnosis, **changes)
    return replace(result, diagnosis=d, document=diagnosis_document(d, {}, None))


def text_of(page: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", re.sub(r"<style>.*?</style>", "", page, flags=re.DOTALL)))


def test_the_committed_campaign_is_what_the_example_makes():
    from kr270_hidden.make_campaign import make_table

    assert (HIDDEN / "measurements.csv").read_text(encoding="utf-8") == make_table()


def test_friction_that_another_law_made_is_found_at_its_joint_and_closes_the_gap(found):
    document = found.document
    assert document["verdict"] == "explained"
    (entry,) = document["effects"]
    assert entry["evidence"]["p_value"] < document["level"] < 0.01
    assert (entry["kind"], entry["where"], entry["confounded_with"]) == ("joint_hysteresis", "joint_3", [])
    # The plant: 0.135 urad/(N m) behind friction that breaks away at 400 N m.
    assert entry["parameters"]["amplitude"]["value"] == pytest.approx(0.135e-6 * 400, rel=0.1)
    assert document["gap"]["held_out_p_value_after"] > 0.01


def test_the_figures_of_the_page_in_the_docs_are_those_the_example_gives(found):
    text = (ROOT / "docs" / "diagnose.md").read_text(encoding="utf-8")
    gap = found.document["gap"]
    for name, keys in {
        "fitted": ("before_rms_mm", "after_rms_mm", "noise_rms_mm"),
        "held out": ("held_out_before_rms_mm", "held_out_after_rms_mm", "noise_rms_mm"),
    }.items():
        row = re.search(rf"^\| {name} \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|", text, re.MULTILINE)
        assert row is not None
        assert [float(v) for v in row.groups()] == pytest.approx([gap[k] for k in keys], abs=6e-5)
    said = re.search(r"goes from ([\d.]+) to ([\d.]+) \(p = ([\d.]+)\)", text)
    assert said is not None
    shown = [gap[f"held_out_{k}"] for k in ("chi2_per_dof_before", "chi2_per_dof_after", "p_value_after")]
    assert [float(v) for v in said.groups()] == pytest.approx(shown, abs=6e-3)
    width = re.search(r"amplitude ([\d.]+) mrad", text)
    assert width is not None
    value = found.document["effects"][0]["parameters"]["amplitude"]["value"]
    assert float(width[1]) == pytest.approx(value * 1e3, abs=6e-5)


def test_the_page_says_what_was_found_where_and_what_could_not_be(found, page):
    text = text_of(page)
    assert "Explained: the named effects close the gap." in text
    assert "joint hysteresis at joint_3" in text
    assert found.document["where_in_words"]["before"] in text
    for part in ("The gap", "Where the gap is", "The arm", "Suspects", "Ruled out", "Untestable", "Provenance"):
        assert part in text
    for entry in found.document["untestable"]:
        assert entry["kind"] in text
        assert entry["lacks"] in text
    assert ("What to measure next" in text) == (found.document["next_experiment"] is not None)


def test_the_page_asks_for_nothing_outside_itself(page):
    assert page.count("<img") >= 5
    assert all(src.startswith("data:image/") for src in re.findall(r'src="([^"]{0,40})', page))
    assert "http" not in text_of(page)
    assert len(page) < 3e6


def test_what_the_effect_does_is_what_its_removal_leaves(found):
    """Readings are the model without the effect, what the effect does, and what is left of both: in a joint's deflection."""
    d = found.diagnosis
    (shape,) = shapes(d, d.search.named[0])
    assert shape.x.size == d.observations.measurements.cases.number
    # The base model left a loop; with the effect in the model a level cloud is left.
    assert np.nanstd(shape.after) < 0.25 * np.nanstd(shape.before)
    amplitude = found.document["effects"][0]["parameters"]["amplitude"]["value"] * 1e6
    assert np.abs(shape.itself).max() == pytest.approx(amplitude, rel=1e-6)
    assert shape.branch is not None
    assert set(np.unique(shape.branch)) == {-1.0, 0.0, 1.0}
    loading, unloading = (shape.before[shape.branch == sign].mean() for sign in (1, -1))
    assert loading * unloading < 0


def test_the_scene_is_one_page_that_holds_the_arm_and_its_arrows(found):
    page = scene_html(found.diagnosis)
    assert 1e6 < len(page) < 2e7
    experiment = residual_arrows(
        found.diagnosis.search.base.model, found.model, found.diagnosis.observations
    ).experiment
    for part in ("/arm/links", "/arm/joints", f"/before/experiment {experiment}", f"/after/experiment {experiment}"):
        assert in_scene(page, part)
    assert not re.search(r'<script[^>]+src="http', page)


def in_scene(page: str, part: str) -> bool:
    """Whether a path is among the objects of a static Meshcat page, which holds them as base64."""
    blobs = re.findall(r"base64,([A-Za-z0-9+/=]{40,})", page)
    return any(part.encode() in base64.b64decode(blob) for blob in blobs)


def test_an_arrow_is_closed_and_points_from_its_start_to_its_end():
    vertices, faces = arrow(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 2.0]), 0.1)
    edges = np.sort(np.hstack([faces[[0, 1]], faces[[1, 2]], faces[[2, 0]]]), axis=0)
    _, count = np.unique(edges, axis=1, return_counts=True)
    assert (count == 2).all()
    assert vertices[2].max() == 2.0
    assert vertices[2].min() == 0.0
    a, b, c = (vertices[:, k].T for k in faces)
    # Outward faces enclose a positive volume: a cylinder of 1.5 m and a cone of 0.5 m, of ten sides.
    area = 5 * np.sin(2 * np.pi / 10)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert volume == pytest.approx(area * (0.1**2 * 1.5 + 0.25**2 * 0.5 / 3), rel=1e-9)


def test_a_model_without_an_effect_has_the_values_of_the_others(found):
    d = found.diagnosis
    model = d.search.solution.model
    less = without_effect(model, d.search.named[0].effect)
    assert less.names == tuple(n for n in model.names if "hysteresis" not in n)
    values = dict(zip(model.names, model.x, strict=True))
    assert less.x.tolist() == [values[name] for name in less.names]


def test_nothing_named_gives_a_page_of_one_model(found):
    search = replace(found.diagnosis.search, named=(), solution=found.diagnosis.search.base)
    plain = with_changes(found, search=search, verdict="unexplained", after=found.diagnosis.before)
    text = text_of(diagnosis_report(plain))
    assert "Unexplained: a gap remains that no known effect closes." in text
    assert "What remains:" in text
    assert "Missing" not in text
    assert "goes from" not in text


def test_outliers_a_class_a_withdrawn_name_and_false_noise_are_called_out(found):
    d = found.diagnosis
    (n,) = d.search.named
    other = next(t for t in d.search.first.failed + d.search.first.passed if t.suspect.kind == "joint_hardening")
    search = replace(d.search, named=(replace(n, confounded=(other,)),), faults={"<b> at joint_1": "it broke"})
    odd = Outlier("E07:4", 1e-12, 300.0, 9.0, 1.0, 3)
    noise = replace(d.noise, ratio=3.0, p_value=0.0)
    changed = with_changes(found, search=search, outliers=(odd,), withdrawn={"x at joint_9": "wrong"}, noise=noise)
    page = diagnosis_report(changed)
    text = text_of(page)
    for words in ("OUTLIER E07:4", "ONE OF A CLASS", other.suspect.name, "WITHDRAWN: x at joint_9", "IMPLAUSIBLE"):
        assert words in text
    assert "<b> at" not in page
    assert "&lt;b&gt; at joint_1" in page


def test_a_refuted_name_is_told_apart_from_one_whose_form_is_wrong(found):
    """Held-out readings that refused a name say a little too much for the next one, and the page says so."""
    name, limits = "joint_backlash at joint_2", found.document["not_detectable_above"]
    assert name in {f"{x['kind']} at {x['where']}" for x in limits}
    wrong = with_changes(found, withdrawn={name: "its form does not fit"})
    refuted = with_changes(found, withdrawn={name: "it is refuted"}, refuted=frozenset({name}))
    for one, last, second in ((wrong, "no kind of the catalogue describes", False), (refuted, "fits as well", True)):
        text = text_of(diagnosis_report(one))
        assert last in text
        assert ("they refused another name before" in text) == second
        assert name not in {f"{x['kind']} at {x['where']}" for x in one.document["not_detectable_above"]}
    assert "refused another name" not in text_of(diagnosis_report(found))


def test_the_answer_names_the_effect_with_its_value_in_units_people_read(found):
    assert "joint hysteresis at joint_3 (amplitude = 0.0529" in answer(found)
    assert "mrad" in answer(found)


def test_words_for_an_effect_leave_out_what_stands_in_its_noise():
    unknown = {"value": 1e-8, "unit": "m/s", "sigma": 1e-9}
    quiet = {"value": 1e-10, "unit": "m/s", "sigma": 1e-9}
    entry = {"kind": "tracker_drift", "where": "tracker", "settings": {"start_s": 3.0}}
    entry["parameters"] = {"vx": unknown, "vy": quiet, "vz": quiet, "vw": quiet}
    assert effect_words(entry) == "tracker drift at tracker (vx = 1e-08 +- 1e-09 m/s, (3 more))"
    assert p_words(0.0) == "p < 1e-300"
    assert p_words(0.0123) == "p = 0.012"


def test_a_plan_for_the_next_experiment_is_on_the_page_and_in_it_as_a_file():
    table = "experiment,step,joint_1_deg,track_mm,fx_N\nE21,0,12.5,100,0\nE21,1,12.5,100,9\nE22,0,-3.5,200,0\n"
    pair = {"effect": {"kind": "a", "where": "b"}, "rival": {"kind": "c", "where": "d"}}
    pair |= {"sigma_now": 1.5, "sigma_expected": 7.25}
    plan = {"purpose": ["tell a from c"], "expected_separation": [pair], "postures": 2, "plan_csv": table}
    section = str(next_section(plan))
    text = text_of(section)
    for words in ("2 more postures", "tell a from c", "a at b c at d 1.50 7.25", "E21 12.5 100", "E22 -3.5 200"):
        assert words in text
    assert text.count("E21") == 1
    (content,) = re.findall(r'href="data:text/csv;base64,([^"]+)"', section)
    assert base64.b64decode(content).decode() == table
    assert next_section(None) == ""
