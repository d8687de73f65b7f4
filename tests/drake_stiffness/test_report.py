"""Reports: the numbers of the result are on the page, nothing outside is asked for, hostile names stay text."""

from __future__ import annotations

import base64
import re
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from drake_stiffness import jobs
from drake_stiffness.effects.compliance import JointCompliance
from drake_stiffness.report import (
    DemoRow,
    RobustnessRow,
    compensation_report,
    demo_report,
    identification_report,
    inspection_report,
)
from drake_stiffness.report.compensation_plots import top_view_figure
from drake_stiffness.report.evidence import evidence, shares
from drake_stiffness.report.identification import answer
from drake_stiffness.report.identification_plots import load_figure
from drake_stiffness.report.page import Markup, html, length, number, table
from drake_stiffness.report.springs_tables import joint_table, shorten
from toolpaths.formats import read_program
from toolpaths.job import compensate
from toolpaths.process import read_process
from toolpaths.program import Refusal
from toolpaths.rewriting import Insertion

EXAMPLE = Path(__file__).parents[2] / "examples" / "kr270"
VOID = {"meta", "img", "br", "hr", "link", "input"}
HOSTILE = "<script>alert('x')</script> & \"$y$\""


class Structure(HTMLParser):
    """Open tags, attributes and text of a page; unbalanced tags are collected."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.wrong: list[str] = []
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.text: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, {name: value or "" for name, value in attrs}))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.wrong.append(tag)

    def handle_data(self, data):
        if "style" not in self.open:
            self.text.append(data)


def read(page: str) -> Structure:
    found = Structure()
    found.feed(page)
    found.close()
    return found


def text_of(page: str) -> str:
    return " ".join(read(page).text)


@pytest.fixture(scope="module")
def identified():
    return jobs.identify_campaign(EXAMPLE / "campaign.yaml")


@pytest.fixture(scope="module")
def compensated(identified):
    program = read_program(EXAMPLE / "pocket.src", None)
    return compensate(program, identified.model, read_process(EXAMPLE / "process.yaml"))


def demo_page(identified, compensated) -> str:
    before = compensated.before_mm
    distances = {
        "uncompensated": before,
        "joints only": 0.08 * before,
        "full": 0.002 * before,
        "oracle": 0.0017 * before,
    }
    rows = [
        DemoRow(name, d.mean(), np.percentile(d, 95), d.max(), 100 * (1 - d.mean() / before.mean()))
        for name, d in distances.items()
    ]
    robustness = [RobustnessRow("as stated", 1.67, 0.134, 0.00335, 0.00284), RobustnessRow(HOSTILE, 4.0, 0.3, 0.2, 0.2)]
    return demo_report("Milling", rows, robustness, identified, compensated, distances)


@pytest.fixture(scope="module")
def pages(identified, compensated):
    cell = EXAMPLE / "cell.yaml"
    return {
        "inspection": inspection_report(jobs.inspect(cell, identifiability=True), cell),
        "identification": identification_report(identified),
        "compensation": compensation_report(compensated, identified.model),
        "demo": demo_page(identified, compensated),
    }


KINDS = ("inspection", "identification", "compensation", "demo")


@pytest.mark.parametrize("kind", KINDS)
def test_a_page_is_whole_small_and_asks_for_nothing(pages, kind):
    page = pages[kind]
    found = read(page)
    assert page.startswith("<!DOCTYPE html>")
    assert not found.wrong
    assert not found.open
    assert len(page.encode("utf-8")) < 2_000_000
    assert not {tag for tag, _ in found.tags} & {"script", "link", "iframe", "object", "embed"}
    for _, attributes in found.tags:
        for name in ("src", "href", "srcset", "action"):
            assert attributes.get(name, "data:image/").startswith("data:image/")
    assert "@import" not in page
    assert "url(" not in re.sub(r"base64,[^\"]+", "", page)


@pytest.mark.parametrize("kind", KINDS)
def test_pictures_have_captions_and_point_nowhere_outside(pages, kind):
    found = read(pages[kind])
    pictures = [attributes for tag, attributes in found.tags if tag == "img"]
    assert pictures
    assert all(picture["alt"] for picture in pictures)
    assert sum(tag == "figcaption" for tag, _ in found.tags) == len(pictures)
    for picture in pictures:
        head, _, data = picture["src"].partition(";base64,")
        content = base64.b64decode(data)
        if head == "data:image/svg+xml":
            drawing = content.decode("utf-8")
            assert drawing.startswith("<svg")
            assert not re.findall(r'href="(?!#|data:image/png;)', drawing)
        else:
            assert content.startswith(b"\x89PNG")


@pytest.mark.parametrize("kind", KINDS)
def test_no_page_says_nan(pages, kind):
    assert not re.findall(r"\b(nan|inf|None|array)\b|np\.", text_of(pages[kind]), flags=re.IGNORECASE)


def test_equal_input_gives_equal_pictures(compensated, identified):
    for draw in (
        lambda: top_view_figure(
            compensated.target_mm, compensated.correction_mm, np.isnan(compensated.account.evenness.spacing_mm)
        )[0],
        lambda: load_figure(evidence(identified)),
    ):
        assert draw() == draw()


def test_inspection_shows_counts_ranks_and_chain(pages):
    text = text_of(pages["inspection"])
    for shown in (
        "258",
        "153",
        "62",
        "32",
        "joint_1",
        "-140 .. -5 deg",
        "parent-side frame of joint 'joint_2'",
        "long axis x",
    ):
        assert shown in text


def test_identification_shows_the_fit_and_every_spring(pages, identified):
    text, fit = text_of(pages["identification"]), identified.model.fit
    assert "explains the readings to their noise" in text
    for value in (fit["chi2_per_dof"], fit["residual_rms_mm"], fit["held_out_rms_mm"]):
        assert number(value) in text
    merged = identified.model.statistics.group.count("G3")
    assert f"{merged} of {identified.model.x.size} parameters are determined in combination only" in text
    for name in identified.model.names:
        assert name in text
    i = identified.model.names.index("joint_2")
    assert number(identified.model.x[i] * 1e6, 4) in text
    assert identified.model.provenance["inputs"]["measurements"]["sha256"] in text
    for line in identified.warnings:
        assert line.partition(": ")[2][1:] in text


def test_expected_noise_agrees_with_a_right_model(identified):
    e = evidence(identified)
    # 1156 degrees of freedom and 288 held-out coordinates: a few percent of scatter.
    assert identified.model.fit["residual_rms_mm"] == pytest.approx(e.fit_noise_mm, rel=0.07)
    assert identified.model.fit["held_out_rms_mm"] == pytest.approx(e.held_noise_mm, rel=0.12)


def test_shares_sum_to_one_and_match_the_loaded_equilibrium(identified):
    from drake_stiffness.simulation import simulate_displacement

    model, m = identified.model, identified.measurements
    s = shares(model, m, displacement=True)
    assert sum(s.share) == pytest.approx(1.0, abs=1e-12)
    loaded = ~m.unloaded[m.case]
    moved = np.linalg.norm(simulate_displacement(model, m.cases, m.case, m.point).dp[:, loaded], axis=0) * 1e3
    # Linear theory against finite rotations, 17 mm at most on a 3 m arm.
    assert s.mean_mm == pytest.approx(moved.mean(), rel=0.03)
    assert s.largest_mm == pytest.approx(moved.max(), rel=0.03)


def test_joints_that_the_loads_hide_are_named(identified):
    model = identified.model
    group = list(model.statistics.group)
    group[model.names.index("joint_1")], group[model.names.index("joint_6")] = "G2", "G1-"
    hidden = replace(identified, model=replace(model, statistics=replace(model.statistics, group=tuple(group))))
    assert "The loads say nothing of the compliance of joint_1 and joint_6." in answer(hidden, evidence(hidden))
    text = text_of(joint_table(hidden))
    assert "NO: its torques are too small to show" in text
    assert "NO: cannot be told from zero" in text


def test_a_rejected_noise_is_said_first(identified):
    model = identified.model
    bad = replace(model, fit=model.fit | {"noise_rejected": True, "chi2_per_dof": 9.0, "held_out_rms_mm": float("nan")})
    text = answer(replace(identified, model=bad), evidence(identified))
    assert "does NOT explain the readings" in text
    assert "3.0 times larger" in text
    assert "No experiment was held out" in text


def test_compensation_shows_its_summary(pages, compensated):
    text, d = text_of(pages["compensation"]), compensated.to_dict()
    for key in ("correction_mm", "uncompensated_mm", "one_shot_residual_mm", "residual_mm", "model_sigma_mm"):
        for value in d[key].values():
            assert number(value) in text
    assert f"{d['percent_compensated']:.2f} % compensated" in text
    assert "the model's own predictions" in text
    assert "repeatability" in text


def test_short_programs_without_force_or_statistics(identified, tmp_path):
    lines = (EXAMPLE / "pocket.src").read_text().splitlines()
    (tmp_path / "short.src").write_text(next(line for line in lines if line.startswith("LIN")) + "\n")
    idle = (EXAMPLE / "process.yaml").read_text().replace("cell: cell.yaml", "")
    (tmp_path / "process.yaml").write_text(re.sub(r"constant: \{.*\}", "constant: {fz_N: 0, frame: tool}", idle))
    bare = replace(identified.model, statistics=None, fit={}, provenance={})
    short = compensate(read_program(tmp_path / "short.src", None), bare, read_process(tmp_path / "process.yaml"))
    text = text_of(compensation_report(short, bare))
    assert "could not hold a correction" in text
    assert "carries no statistics" in text
    assert not re.findall(r"\b(nan|inf|None)\b", text)


def test_names_from_users_stay_text_and_refused_lines_are_listed(identified, compensated):
    model, m = identified.model, identified.measurements
    fit = model.fit | {"covariance": HOSTILE, "solver": HOSTILE}
    made = model.provenance | {"inputs": {HOSTILE: {"file": HOSTILE, "sha256": HOSTILE}}, "program": HOSTILE}
    arm = replace(model.arm, joint_names=(HOSTILE, *model.arm.joint_names[1:]))
    first = JointCompliance(HOSTILE)
    dirty = replace(
        identified,
        model=replace(model, arm=arm, effects=(first, *model.effects[1:]), fit=fit, provenance=made),
        measurements=replace(m, experiments=tuple(HOSTILE + name for name in m.experiments)),
        warnings=[f"NOT SEEN: {HOSTILE}", HOSTILE],
    )
    program = replace(compensated.program, path=f"/tmp/{HOSTILE.replace('/', '')}.src")
    job = replace(
        compensated,
        program=program,
        refusals=(Refusal(17, HOSTILE, ("X",)), Refusal(18, "a rapid", carries_force=False)),
        insertions=(Insertion(19, ("Y",), f"Y 12.5, {HOSTILE}"),),
        notes=[HOSTILE],
        method=HOSTILE,
    )
    page = compensation_report(job, dirty.model)
    for found in (read(identification_report(dirty)), read(page)):
        assert "script" not in {tag for tag, _ in found.tags}
        assert not found.wrong
        assert HOSTILE in " ".join(found.text)
    for shown in ("2 lines were left uncorrected", "motions under force on line 17.", "a rapid", "Y 12.5,"):
        assert shown in text_of(page)


def test_hostile_cells_are_inspected_as_text(tmp_path):
    robot = (EXAMPLE / "kr270.urdf").read_text().replace("joint_3", "&lt;b&gt;joint_3 $x$")
    (tmp_path / "kr270.urdf").write_text(robot)
    cell = tmp_path / "<b>cell.yaml"
    cell.write_text((EXAMPLE / "cell.yaml").read_text())
    found = read(inspection_report(jobs.inspect(cell), cell))
    assert "b" not in {tag for tag, _ in found.tags}
    assert "<b>joint_3 $x$" in " ".join(found.text)


def test_compensation_needs_neither_drake_nor_cvxpy(identified, tmp_path):
    identified.model.save(tmp_path / "model.json")
    code = f"""
import sys
for name in ("pydrake", "drake", "cvxpy", "clarabel"):
    sys.modules[name] = None
from drake_stiffness.model import load_model
from drake_stiffness.report import compensation_report
from toolpaths.formats import read_program
from toolpaths.job import compensate
from toolpaths.process import read_process
model = load_model({str(tmp_path / "model.json")!r})
result = compensate(read_program({str(EXAMPLE / "pocket.src")!r}, None), model, read_process({str(EXAMPLE / "process.yaml")!r}))
page = compensation_report(result, model)
assert page.endswith("</html>\\n")
assert "matplotlib.pyplot" not in sys.modules
"""
    (tmp_path / "shop_floor.py").write_text(code)
    done = subprocess.run([sys.executable, tmp_path / "shop_floor.py"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("value", "shown"),
    [(float("nan"), "–"), (None, "–"), (0.0, "0"), (1.0084, "1.01"), (0.024329, "0.0243"), (9.999, "10.0"), (-123456.0, "-123000"),
     (1.234e-7, "1.23e-7"), (float("inf"), "–")],
)  # fmt: skip
def test_numbers(value, shown):
    assert number(value) == shown


def test_lengths_change_unit_below_a_hundredth():
    assert (length(1.6734), length(0.000483), length(None)) == ("1.67 mm", "0.48 µm", "not known")


def test_markup_is_kept_and_text_escaped():
    assert html("<i>") == "&lt;i&gt;"
    assert html(Markup("<i>")) == "<i>"
    assert "<td>&lt;b&gt;</td>" in table(("h",), [("<b>",)])


def test_long_lists_are_shortened():
    names = ["joint_1", "link_1.k11", "link_1.k22", "link_2.k66", "link_3.k11", "link_3.k22"]
    assert shorten(names) == "joint_1, link_1 (k11, k22), link_2 (k66) and 2 more"
