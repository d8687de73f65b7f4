"""A long milling program through `compensate`: seconds by stage and peak memory.

Run: python benchmarks/bench_compensate.py [--moves 100000]

The program is a serpentine of LIN moves over the domed pocket of examples/kr270, the tool leaning and turning along the
way; the model is identified once from examples/kr270/campaign.yaml. The stages are of one process that calls the library,
the command's own seconds and memory of another that runs `drake-stiffness compensate` as a user would. Beside it: the
same file merely read and rewritten, every point moved by 0.1 mm, without any mechanics.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import sysconfig
import tempfile
import time
from pathlib import Path
from typing import Any

from table import KR270, Stopwatch, child, peak_mib, show, worker

TASKS = ("compensate", "command", "rewrite")


def write_program(path: Path, moves: int) -> None:
    """A serpentine over 400 mm x 260 mm, rows as far apart as points, with the posture of pocket.src."""
    from math import pi, sin, sqrt

    stride = sqrt(400.0 * 260.0 / moves)
    across = max(2, round(400.0 / stride))
    down = -(-moves // across)
    head = [
        "&ACCESS RVP",
        "DEF serpentine( )",
        "$TOOL = TOOL_DATA[1]",
        "$BASE = BASE_DATA[1]",
        "PTP {X 20.000,Y 20.000,Z 60.000,A 0.000,B -6.000,C 164.000}",
    ]
    lines = []
    for number in range(moves):
        row, place = divmod(number, across)
        u = 2.0 * (place if row % 2 == 0 else across - 1 - place) / (across - 1) - 1.0
        v = 2.0 * row / max(down - 1, 1) - 1.0
        x, y, z = 220.0 + 200.0 * u, 150.0 + 130.0 * v, -4.0 - 6.0 * (u * u + v * v)
        a, b, c = 12.0 * sin(2 * pi * number / moves), 6.0 * u, 170.0 + 6.0 * v
        lines.append(f"LIN {{X {x:.3f},Y {y:.3f},Z {z:.3f},A {a:.3f},B {b:.3f},C {c:.3f}}} C_DIS")
    path.write_bytes("\r\n".join([*head, *lines, "END", ""]).encode("ascii"))


def time_compensate(folder: Path) -> dict[str, Any]:
    """Seconds by stage of the library's own functions."""
    start = time.perf_counter()
    from drake_stiffness.files import write_whole
    from drake_stiffness.model import load_model
    from toolpaths import job
    from toolpaths.formats import read_program
    from toolpaths.process import read_process

    watch = Stopwatch()
    watch.seconds["imports"] = time.perf_counter() - start
    before = peak_mib()
    for function, name in (
        ("_targets", "other"),
        ("_postures", "inverse kinematics"),
        ("mirror", "mirror iteration"),
        ("_write", "write"),
        ("_read_back", "read back"),
        ("_parse_again", "parse again"),
        ("_support", "support"),
    ):
        watch.watch(job, function, name)
    with watch("model"):
        model, process = load_model(folder / "model.json"), read_process(KR270 / "process.yaml")
    with watch("parse"):
        program = read_program(folder / "program.src")
    with watch("other"):
        result = job.compensate(program, model, process)
    with watch("write"):
        write_whole(folder / "corrected.src", result.raw)
    return {
        **watch.seconds,
        "total": time.perf_counter() - start,
        "cpu": time.process_time(),
        "imports_mib": before,
        "points": int(result.rows.size),
        "steps": result.steps,
        "before_mm": float(result.before_mm.mean()),
        "after_mm": float(result.after_mm.mean()),
        "method": result.method,
    }


def time_rewrite(folder: Path) -> dict[str, Any]:
    """Seconds to read the file, print every point 0.1 mm aside, and write it."""
    from drake_stiffness.files import write_whole
    from toolpaths.formats import read_program
    from toolpaths.rewriting import rewrite

    start = time.perf_counter()
    program = read_program(folder / "program.src")
    parsed = time.perf_counter() - start
    rewritten = rewrite(program, program.position_mm + 0.1, program.orientation, program.corrected)
    write_whole(folder / "moved.src", rewritten.raw)
    return {"parse": parsed, "total": time.perf_counter() - start}


def time_command(folder: Path) -> dict[str, Any]:
    """Wall seconds and peak memory of the command; this process is small, so its children's maximum is the command's."""
    import resource
    import subprocess

    tool = Path(sysconfig.get_path("scripts")) / "drake-stiffness"
    command = [str(tool), "compensate", str(folder / "program.src"), "--model", str(folder / "model.json")]
    command += ["--process", str(KR270 / "process.yaml"), "-o", str(folder / "by_command.src")]
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    seconds = time.perf_counter() - start
    unit = 1 if sys.platform == "darwin" else 1024
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {"total": seconds, "cpu": usage.ru_utime + usage.ru_stime, "peak_mib": usage.ru_maxrss * unit / 2**20}


def make_model(folder: Path) -> dict[str, Any]:
    from drake_stiffness.jobs import identify_campaign

    start = time.perf_counter()
    identify_campaign(KR270 / "campaign.yaml").model.save(folder / "model.json")
    return {"total": time.perf_counter() - start}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, nargs="+", default=[100000])
    parser.add_argument("--worker", nargs=2, metavar=("TASK", "FOLDER"), help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.worker:
        tasks = {"compensate": time_compensate, "command": time_command, "rewrite": time_rewrite, "model": make_model}
        found = tasks[args.worker[0]](Path(args.worker[1]))
        print(json.dumps({"peak_mib": peak_mib()} | found))
        return
    folder = Path(tempfile.mkdtemp(prefix="bench_compensate_"))
    try:
        made = child(worker(__file__, "model", str(folder)))
        if made.result is None:
            sys.exit(f"no model: {made.why}")
        for moves in args.moves:
            write_program(folder / "program.src", moves)
            size = (folder / "program.src").stat().st_size / 2**20
            ended = {task: child(worker(__file__, task, str(folder)), limit_s=600.0) for task in TASKS}
            report(moves, size, ended)
    finally:
        shutil.rmtree(folder)


def report(moves: int, size_mib: float, ended: dict[str, Any]) -> None:
    """Print the table of one program."""
    rows, notes = [], []
    f, c, r = (ended[task].result for task in TASKS)
    notes += [f"{task} ended without a result: {ended[task].why}" for task in TASKS if ended[task].result is None]
    if f is not None:
        stages = (
            "imports",
            "model",
            "parse",
            "inverse kinematics",
            "mirror iteration",
            "write",
            "read back",
            "parse again",
        )
        stages += ("support", "other", "total")
        for name in stages:
            label = {"read back": "read back: predict the printed points", "parse again": "read back: parse"}.get(
                name, name
            )
            rows.append(
                [label, f"{f[name]:.2f}", f"{f[name] / moves * 1e6:.1f}", f"{100 * f[name] / f['total']:.0f} %"]
            )
        rows.append(["CPU seconds of the process", f"{f['cpu']:.2f}", f"{f['cpu'] / moves * 1e6:.1f}", ""])
        rows.append(["moves per second", f"{moves / f['total']:,.0f}", "", ""])
        rows.append(["peak memory, MiB", f"{f['peak_mib']:.0f}", "", ""])
        notes.append(
            f"{f['points']} points corrected by {f['method']} in {f['steps']} iterations; predicted deviation {f['before_mm']:.3f} mm "
            f"before, {f['after_mm']:.5f} mm after; {f['imports_mib']:.0f} MiB are there after the imports"
        )
    if c is not None:
        rows.append(["the command as a user runs it", f"{c['total']:.2f}", f"{c['total'] / moves * 1e6:.1f}", ""])
        rows.append(["its CPU seconds", f"{c['cpu']:.2f}", f"{c['cpu'] / moves * 1e6:.1f}", ""])
        rows.append(["its peak memory, MiB", f"{c['peak_mib']:.0f}", "", ""])
    if r is not None:
        rows.append(["beside: read and rewrite the file", f"{r['total']:.2f}", f"{r['total'] / moves * 1e6:.1f}", ""])
        notes.append(f"of reading and rewriting, parsing takes {r['parse']:.2f} s; peak {r['peak_mib']:.0f} MiB")
    title = f"compensate, KR 270, {moves} LIN moves ({size_mib:.1f} MiB), loaded equilibrium with joints and 7 links"
    show(title, ("stage", "seconds", "us a move", "share"), rows, notes)


if __name__ == "__main__":
    main()
