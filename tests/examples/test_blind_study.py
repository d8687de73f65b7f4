"""Blind trials as a study: the program sees campaigns and no truth; truths and answers meet in records that are scored."""

from __future__ import annotations

import json
from pathlib import Path

from blind_trials.as_study import STUDY, collect, make_one
from blind_trials.records import read_failures, read_records

from drake_stiffness.studies.study_file import read_study

ANSWER = {
    "verdict": "consistent",
    "level": 1e-4,
    "effects": [],
    "rejected": [],
    "untestable": [],
    "gap": {"held_out_p_value_after": 0.4},
}


def test_campaigns_are_jobs_and_their_answers_are_scored(tmp_path: Path) -> None:
    for folder in ("campaigns", "truths"):
        (tmp_path / folder).mkdir()
    (tmp_path / "study.yaml").write_text(STUDY)
    for seed in (3, 4, 5):
        assert make_one(tmp_path, "one", 8, seed) == f"one_{seed}"
    study = read_study(tmp_path / "study.yaml")
    assert [(job.name, job.command) for job in study.jobs] == [(f"one_{seed}", "diagnose") for seed in (3, 4, 5)]
    truth = json.loads((tmp_path / "truths/one_3.json").read_text())
    hidden = truth["hidden"][0]["kind"].encode()
    assert not any(hidden in path.read_bytes() for path in (tmp_path / "campaigns").rglob("*") if path.is_file())
    for name, code in (("one_3", 0), ("one_4", 3)):
        answer = tmp_path / "answers" / name
        answer.mkdir(parents=True)
        (answer / "state.json").write_text(json.dumps({"exit_code": code, "seconds": 9.0, "reason": "no"}))
        (answer / "result.json").write_text(json.dumps(ANSWER))
    said = list(collect(tmp_path, tmp_path / "answers"))
    assert "-> consistent: nothing" in said[0]
    assert said[1:] == ["one_4: exit code 3", "one_5: not answered yet"]
    (record,) = read_records(tmp_path / "records")
    assert (record.seed, record.verdict, record.level, record.seconds) == (3, "consistent", 1e-4, 9.0)
    assert read_failures(tmp_path / "records") == [("one_4", "exit code 3: no")]
