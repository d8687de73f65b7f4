"""The command `groups` and its page say what the library found."""

import json

import pytest
from three_arms import KR270
from typer.testing import CliRunner

from drake_stiffness.cli import app
from drake_stiffness.jobs import identify_campaign
from drake_stiffness.report.groups import groups_report

CAMPAIGN = KR270 / "campaign.yaml"


@pytest.fixture(scope="module")
def found():
    return identify_campaign(CAMPAIGN)


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    folder = tmp_path_factory.mktemp("groups")
    words = ["groups", str(CAMPAIGN), "--json", str(folder / "g.json"), "--report", str(folder / "g.html")]
    result = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.output
    return result.output, json.loads((folder / "g.json").read_text()), (folder / "g.html").read_text()


def test_the_json_has_gap_relations_base_map_and_directions(told, found):
    _, content, _ = told
    groups = found.groups
    assert content["rank"] == 32
    assert content["singular_gap"] > 1e9
    assert len(content["singular_values"]) == 62
    assert content["G2"] == []
    first = content["base"][0]
    assert first["name"] == "joint_1"
    assert first["combination"]["joint_1"] == 1.0
    assert first["combination"]["base_link.k66"] == pytest.approx(1.0, abs=1e-9)
    assert first["ratio"] == pytest.approx(abs(first["value"]) / first["sigma"])
    assert first["group"] == "G1+"
    # the map gives the values of the base parameters in the model from the model's own parameters
    rows = content["map"]
    by_hand = [sum(c * x for c, x in zip(row, found.model.x, strict=True)) for row in rows["matrix"]]
    assert by_hand == pytest.approx([entry["model_value"] for entry in content["base"]], rel=1e-6, abs=1e-15)
    assert rows["parameters"] == list(found.model.names)
    sub = {entry["base"]: entry for entry in content["subgroups"]}
    assert sub["joint_3"]["members"] == ["joint_3", "link_2.k35", "link_2.k55"]
    assert sub["joint_3"]["relation"] == "joint_3 + 0.8696 link_2.k35 + link_2.k55"
    assert sub["joint_3"]["sentence"] == "joint_3 merges with link_2.k35 and link_2.k55"
    ratios = [entry["ratio"] for entry in content["eigen_directions"]]
    assert len(ratios) == 32
    assert ratios == sorted(ratios, reverse=True)
    assert any(pair["says"] == "sum known" for pair in content["collinear"])
    assert len(groups.base_names) == 32


def test_merged_partners_of_the_model_are_those_of_the_sums(told, found):
    _, content, _ = told
    partners = dict(zip(found.model.names, found.model.statistics.merged_with, strict=True))
    for entry in content["subgroups"]:
        base, *members = entry["members"]
        assert set(members) <= set(partners[base])
        assert all(base in partners[member] for member in members)


def test_terminal_and_page_show_the_gap_and_every_sum(told):
    text, content, page = told
    for shown in (text, page):
        assert "Rank 32 of 62 parameters" in shown
        for entry in content["subgroups"][:6]:
            assert entry["relation"] in shown
    assert "joint_3 merges with link_2.k35 and link_2.k55" in text
    assert "data:image/svg+xml" in page


def test_thresholds_reach_groups_and_model(tmp_path, found):
    strict = identify_campaign(CAMPAIGN, upper=50.0, lower=20.0)
    assert strict.groups.group.count("G1+") == sum(found.groups.ratio > 50)
    assert strict.groups.group.count("G1-") == sum(found.groups.ratio < 20)
    lonely = [i for i, g in enumerate(found.model.statistics.group) if g == "G1+"]
    assert lonely
    assert all(strict.model.statistics.group[i] == "G1-" for i in lonely)
    result = CliRunner().invoke(app, ["identify", str(CAMPAIGN), "-o", str(tmp_path / "m.json"), "--upper", "1"])
    assert "0 <= lower <= upper" in str(result.exception)


def test_the_page_says_so_where_nothing_merges(tmp_path):
    alone = identify_campaign(KR270 / "campaign_joints_only.yaml")
    page = groups_report(alone, alone.groups)
    assert "Nothing merges" in page
    assert "No two estimates correlate" in page
    assert alone.groups.base_names == tuple(f"joint_{i}" for i in range(1, 7))
    assert (alone.groups.values.sigma == pytest.approx(alone.model.statistics.sigma)) is True
