"""Runs blind trials through the program's own job, on files; resumes where it stopped: one JSON a trial.

Run: python examples/blind_trials/run.py OUT --plan one --trials 100 [--first 0] [--arm kr270] [--kind KIND] [--postures 16]
     [--processes 2] [--classes]
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")
HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parents[1]), str(HERE.parent)]

import numpy as np  # noqa: E402

from blind_trials.classes import likenesses  # noqa: E402
from blind_trials.generator import PLANS, POSTURES, Trial, make_trial, truth_of, write_files  # noqa: E402

#: A trial that takes more processor time than this has failed, s.
LIMIT_S = 400
#: Seeds of the plans do not overlap.
FIRST_SEED = {plan: 100_000 * (k + 1) for k, plan in enumerate(PLANS)}


def diagnose_files(campaign: Path) -> dict[str, Any]:
    """What the program says of the files, and the level a suspect's p-value had to be below."""
    from drake_stiffness.diagnosis.job import diagnose_campaign

    started = time.monotonic()
    done = diagnose_campaign(campaign)
    level = done.diagnosis.search.first.level
    return {"document": json.loads(json.dumps(done.document)), "level": level, "seconds": time.monotonic() - started}


def one_trial(
    seed: int,
    plan: str,
    arm: str | None,
    kind: str | None,
    sigma: float | None,
    classes: bool,
    designs: Path,
    postures: int = POSTURES,
) -> dict[str, Any]:
    """Make a campaign, have it diagnosed, and set the truth beside the answer; TimeoutError if that takes too long."""
    started = time.monotonic()
    signal.signal(signal.SIGPROF, _too_long)
    signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
    trial = make_trial(seed, plan, arm=arm, kind=kind, sigma=sigma, postures=postures, designs=designs)
    record = {"truth": truth_of(trial), "postures": postures, "making_seconds": time.monotonic() - started}
    with tempfile.TemporaryDirectory() as folder:
        record |= diagnose_files(write_files(trial, Path(folder)))
    signal.setitimer(signal.ITIMER_PROF, 0)
    if classes:
        record["likenesses"] = _likenesses(trial, record["document"])
    return record


def _too_long(*_: object) -> None:
    raise TimeoutError(f"no answer in {LIMIT_S} s of processor time")


def _likenesses(trial: Trial, document: dict[str, Any]) -> dict[str, dict[str, float]]:
    """How like the suspects are to every hidden effect that was named (also within a class) or that the catalogue lacks."""
    rng = np.random.default_rng([trial.seed, 3])
    out = {}
    for p in trial.placed:
        named = any(p.hidden.name in members(e) for e in document["effects"])
        if (named or not p.hidden.known) and p.hidden.kind != "outliers":
            out[p.hidden.name] = likenesses(trial.oracle_kept, p.hidden, _suspects(document), rng)
    return out


def _suspects(document: dict[str, Any]) -> set[str]:
    """All that the program tried."""
    names = {f"{r['kind']} at {r['where']}" for r in document["rejected"]}
    return names.union(*(members(e) for e in document["effects"])) - {
        f"{u['kind']} at {u['where']}" for u in document["untestable"]
    }


def members(entry: dict[str, Any]) -> set[str]:
    """All that an entry of `effects` may be."""
    return {f"{m['kind']} at {m['where']}" for m in [entry, *entry["confounded_with"]]}


def run(folder: Path, jobs: list[tuple[int, str]], options: argparse.Namespace) -> Iterator[str]:
    """Trials that are not done yet; a line of progress each."""
    folder.mkdir(parents=True, exist_ok=True)
    todo = [(seed, plan) for seed, plan in jobs if not (folder / f"{plan}_{seed}.json").exists()]
    yield f"{len(jobs) - len(todo)} done before, {len(todo)} to do"
    with ProcessPoolExecutor(options.processes) as pool:
        running = {
            pool.submit(
                one_trial,
                seed,
                plan,
                options.arm,
                options.kind,
                options.sigma,
                options.classes,
                folder / "designs",
                options.postures,
            ): (seed, plan)
            for seed, plan in todo
        }
        for k, future in enumerate(as_completed(running), 1):
            seed, plan = running[future]
            error = future.exception()
            if error is not None:
                text = "".join(traceback.format_exception(error))
                (folder / f"{plan}_{seed}.failed").write_text(text, encoding="utf-8")  # tried again by the next run
                yield f"{k}/{len(todo)} {plan} {seed}: FAILED {error}"
                continue
            record = future.result()
            path = folder / f"{plan}_{seed}.json"
            path.with_suffix(".part").write_text(json.dumps(record), encoding="utf-8")
            path.with_suffix(".part").rename(path)
            path.with_suffix(".failed").unlink(missing_ok=True)
            yield f"{k}/{len(todo)} {plan} {seed}: {summary(record)}"


def summary(record: dict[str, Any]) -> str:
    """One line: truth and answer."""
    t, d = record["truth"], record["document"]
    base = f"{t['arm']} {t['quantity'][:4]} {'links' if t['links'] else 'joints'}"
    true = ", ".join(f"{h['kind']} at {h['where']} {h['sigma']:.1f}" for h in t["hidden"]) or "nothing"
    said = "; ".join(
        " = ".join([e["kind"] + " at " + e["where"], *sorted(members(e) - {e["kind"] + " at " + e["where"]})])
        for e in d["effects"]
    )
    return f"[{base}] {true} -> {d['verdict']}: {said or 'nothing'} ({record['making_seconds']:.0f}+{record['seconds']:.0f} s)"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--plan", choices=PLANS, required=True)
    parser.add_argument("--trials", type=int, required=True)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--arm")
    parser.add_argument("--kind")
    parser.add_argument("--sigma", type=float)
    parser.add_argument(
        "--postures", type=int, default=POSTURES, help="experiments a campaign, 18 steps of 3 points each"
    )
    parser.add_argument("--classes", action="store_true", help="also compute the oracle's classes (half a minute each)")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    first = FIRST_SEED[options.plan] + options.first
    for line in run(options.out, [(first + k, options.plan) for k in range(options.trials)], options):
        print(line, flush=True)


if __name__ == "__main__":
    main()
