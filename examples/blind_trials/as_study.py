"""Blind trials as a study: campaigns as folders for `drake-stiffness study`, their truths outside the folders that it sees.

1. python examples/blind_trials/as_study.py make OUT --plan one --trials 100
       writes OUT/campaigns/one_200000/ (campaign.yaml, cell.yaml, the robot, measurements.csv), OUT/truths/one_200000.json and
       OUT/study.yaml; what is written already is not made again
2. drake-stiffness study OUT/study.yaml -o OUT/answers
       diagnoses all of them on all cores (or, with --scheduler, on a cluster), and goes on where it was stopped
3. python examples/blind_trials/as_study.py collect OUT
       sets the truths beside the answers: a file a trial in OUT/records, of the form that run.py writes
4. python examples/blind_trials/score.py OUT/records
       makes the tables

run.py does the same in one go, and with --classes also what an oracle would have confounded.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")
HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parents[1]), str(HERE.parent)]

from blind_trials.generator import PLANS, POSTURES, make_trial, truth_of, write_files  # noqa: E402
from blind_trials.run import FIRST_SEED, summary  # noqa: E402

STUDY = """\
# Campaigns with something hidden, or nothing: drake-stiffness study study.yaml -o answers
command: diagnose
inputs: campaigns/*/campaign.yaml
"""


def make(out: Path, plan: str, seeds: list[int], postures: int, processes: int) -> Iterator[str]:
    """Write campaigns, truths and the study; the name of every trial when it is there."""
    for folder in ("campaigns", "truths"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    (out / "study.yaml").write_text(STUDY, encoding="utf-8")
    missing = [seed for seed in seeds if not (out / "truths" / f"{plan}_{seed}.json").exists()]
    with ProcessPoolExecutor(processes) as pool:
        yield from pool.map(partial(make_one, out, plan, postures), missing)


def make_one(out: Path, plan: str, postures: int, seed: int) -> str:
    """Write one campaign, and last its truth."""
    name = f"{plan}_{seed}"
    trial = make_trial(seed, plan, postures=postures, designs=out / "designs")
    write_files(trial, out / "campaigns" / name)
    path = out / "truths" / f"{name}.json"
    path.with_suffix(".part").write_text(json.dumps(truth_of(trial)), encoding="utf-8")
    path.with_suffix(".part").rename(path)
    return name


def collect(out: Path, answers: Path) -> Iterator[str]:
    """Write a record for every trial that was answered; a line each."""
    records = out / "records"
    records.mkdir(exist_ok=True)
    for path in sorted((out / "truths").glob("*.json")):
        folder = answers / path.stem
        state = json.loads((folder / "state.json").read_text(encoding="utf-8")) if folder.is_dir() else {}
        if state.get("exit_code") is None:
            yield f"{path.stem}: not answered yet"
            continue
        if state["exit_code"] != 0:
            (records / f"{path.stem}.failed").write_text(f"exit code {state['exit_code']}: {state['reason']}\n")
            yield f"{path.stem}: exit code {state['exit_code']}"
            continue
        document = json.loads((folder / "result.json").read_text(encoding="utf-8"))
        record = {
            "truth": json.loads(path.read_text(encoding="utf-8")),
            "document": document,
            "level": document["level"],
            "seconds": state["seconds"],
            "making_seconds": 0.0,
        }
        (records / path.name).write_text(json.dumps(record), encoding="utf-8")
        (records / f"{path.stem}.failed").unlink(missing_ok=True)
        yield f"{path.stem}: {summary(record)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    steps = parser.add_subparsers(dest="step", required=True)
    making = steps.add_parser("make", help="write campaigns, truths and study.yaml")
    making.add_argument("out", type=Path)
    making.add_argument("--plan", choices=PLANS, required=True)
    making.add_argument("--trials", type=int, required=True)
    making.add_argument("--first", type=int, default=0)
    making.add_argument("--postures", type=int, default=POSTURES, help="experiments a campaign")
    making.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    collecting = steps.add_parser("collect", help="set truths beside answers")
    collecting.add_argument("out", type=Path)
    collecting.add_argument("answers", type=Path, nargs="?", help="folder of the study's -o; default OUT/answers")
    options = parser.parse_args()
    if options.step == "make":
        first = FIRST_SEED[options.plan] + options.first
        seeds = list(range(first, first + options.trials))
        lines = make(options.out, options.plan, seeds, options.postures, options.processes)
    else:
        lines = collect(options.out, options.answers or options.out / "answers")
    for line in lines:
        print(line, flush=True)


if __name__ == "__main__":
    main()
