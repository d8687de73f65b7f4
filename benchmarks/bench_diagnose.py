"""Diagnosis of a KR 270 with springs in all joints and links, something hidden in joint 3: seconds by stage, and peak memory.

Run: python benchmarks/bench_diagnose.py [--postures 8 16 32 64]

The campaign is that of examples/kr270_hidden (18 steps a posture, three points, friction after Dahl in joint 3) at more or fewer
postures; every diagnosis is a process of its own. A second table holds the campaign of 32 postures against a part of the
catalogue: what grows with the number of candidates. Seconds are those of a wall clock, with CPU seconds beside them.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

from table import ROOT, child, peak_mib, show, worker

HIDDEN = ROOT / "examples" / "kr270_hidden"
SEED = 5
# First words of what `diagnose` says it is doing, and the stage they begin.
STAGES = {
    "reading": "reading",
    "fitting": "base model",
    "trying": "naming",
    "leaving": "naming",
    "adding": "refits",
    "weighing": "naming",
    "confirming": "confirming",
    "placebos": "confirming",
    "planning": "next experiment",
}
# Kinds with one variant a place, and what is searched over many constants besides.
PARTS = {
    "springs alone": ("joint_compliance", "link_compliance", "base_compliance"),
    "no searched constants": (
        *("joint_compliance", "link_compliance", "base_compliance", "joint_backlash", "joint_coupling"),
        *("joint_zero_offset", "link_geometry", "payload", "force_sensor_bias", "force_sensor_misalignment", "scale"),
        *("tracker_drift", "tracker_frame", "reflector_offset"),
    ),
    "and hysteresis, hardening, compensator": (
        *("joint_compliance", "link_compliance", "base_compliance", "joint_backlash", "joint_hardening", "joint_coupling"),
        *("joint_zero_offset", "link_geometry", "payload", "force_sensor_bias", "force_sensor_misalignment", "scale"),
        *("tracker_drift", "tracker_frame", "reflector_offset", "joint_hysteresis", "gravity_compensator"),
    ),
    "whole catalogue": (),
}  # fmt: skip


def make_files(folder: Path, postures: int) -> Path:
    """The campaign's files; returns campaign.yaml."""
    sys.path.insert(0, str(HIDDEN))
    import make_campaign

    place = folder / "kr270_hidden"
    shutil.copytree(HIDDEN.parent / "kr270", folder / "kr270", ignore=shutil.ignore_patterns("*.csv", "*.src"))
    place.mkdir()
    for name in ("campaign.yaml", "cell.yaml"):
        shutil.copy(HIDDEN / name, place)
    table = make_campaign.make_table(postures=postures, seed=SEED)
    (place / "measurements.csv").write_text(table, encoding="utf-8", newline="")
    return place / "campaign.yaml"


def measure(postures: int, part: str) -> dict[str, Any]:
    """Seconds by stage and the answer of one diagnosis."""
    from drake_stiffness.diagnosis.job import diagnose_campaign
    from drake_stiffness.diagnosis.suspects import suspects
    from drake_stiffness.effects import catalogue

    if PARTS[part]:
        catalogue._BUILT_IN = tuple(cls for cls in catalogue._BUILT_IN if cls.kind in PARTS[part])
        catalogue.effect_kinds.cache_clear()
    seconds: dict[str, float] = defaultdict(float)
    with tempfile.TemporaryDirectory() as folder:
        path = make_files(Path(folder), postures)
        stage, last = "reading", time.perf_counter()
        first, cpu = last, time.process_time()

        def progress(text: str) -> None:
            nonlocal stage, last
            now = time.perf_counter()
            seconds[stage] += now - last
            stage, last = STAGES.get(text.split()[0], stage), now

        result = diagnose_campaign(path, progress=progress)
        progress("reading")
        total, cpu = time.perf_counter() - first, time.process_time() - cpu
    d = result.diagnosis
    return {
        "seconds": dict(seconds),
        "total": total,
        "cpu": cpu,
        "rows": result.task.measurements.case.size * 3,
        "variants": sum(len(s.variants) for s in suspects(d.search.base.model)),
        "verdict": d.verdict,
        "named": [n.tested.suspect.name for n in d.search.named],
        "peak_mib": peak_mib(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--postures", type=int, nargs="+", default=[8, 16, 32, 64])
    parser.add_argument("--limit-s", type=float, default=900.0, help="for every process")
    parser.add_argument("--worker", nargs=2, metavar=("POSTURES", "PART"), help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.worker:
        print(json.dumps(measure(int(args.worker[0]), args.worker[1])))
        return
    whole = "whole catalogue"
    runs = [(n, whole) for n in args.postures], [(32, part) for part in PARTS]
    known: dict[tuple[int, str], Any] = {}
    for title, wanted in zip(("by the number of postures", "by the number of candidates"), runs, strict=True):
        rows, notes = [], []
        for postures, part in wanted:
            key = (postures, part)
            if key not in known:
                known[key] = child(worker(__file__, str(postures), part), limit_s=args.limit_s)
            ended = known[key]
            f = ended.result
            if f is None:
                rows.append([f"{postures}", part, *["-"] * 10])
                notes.append(f"{postures} postures, {part}: ended without a result: {ended.why}")
                continue
            stages = [f"{f['seconds'].get(name, 0.0):.1f}" for name in dict.fromkeys(STAGES.values())]
            rows.append(
                [
                    f"{postures}",
                    part,
                    f"{f['rows']}",
                    f"{f['variants']}",
                    *stages,
                    f"{f['total']:.1f}",
                    f"{f['cpu']:.1f}",
                ]
                + [f"{f['peak_mib']:.0f}"]
            )
            notes.append(f"{postures} postures, {part}: {f['verdict']}, named {', '.join(f['named']) or 'nothing'}")
        head = ("postures", "kinds", "rows", "variants", *dict.fromkeys(STAGES.values()), "total", "CPU", "peak MiB")
        show(f"Diagnosis {title}, seconds by stage", head, rows, notes)


if __name__ == "__main__":
    main()
