"""A long milling program through `compensate`: seconds by stage, waypoints a second and peak memory.

Run: python benchmarks/bench_compensate.py [--moves 100000 1000000]

The program is a serpentine of LIN moves over the domed pocket of examples/kr270, the tool leaning and turning along the
way; the model is identified once from examples/kr270/campaign.yaml. The stages are of one process that corrects the first piece
of the program (or all of it, if it is one piece); the command's own seconds and memory are those of `drake-stiffness compensate`
as a user runs it, piece by piece in two processes, with the loaded equilibrium and with --linear. Beside it: the same file
merely read and rewritten, and a plain loop over pinocchio that does joint-only linear deflection, point after point.
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

TASKS = ("compensate", "command", "linear", "rewrite", "pinocchio")
# So many points of the pinocchio loop are timed.
LOOP = 2000


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
    """Seconds by stage of the library's own functions on the first piece."""
    start = time.perf_counter()
    from drake_stiffness.model import load_model
    from toolpaths import job, loaded_path, printing
    from toolpaths.account import account
    from toolpaths.formats.pieces import pieces
    from toolpaths.process import read_process

    watch = Stopwatch(time.process_time)
    watch.seconds["imports"] = time.process_time()
    before = peak_mib()
    for module, function, name in (
        (loaded_path, "postures_on", "inverse kinematics"),
        (job, "mirror", "loaded equilibrium and correction"),
        (job, "write_poses", "write"),
        (job, "read_back", "read back"),
        (printing, "read_again", "parse again"),
        (account, "residual_interval", "intervals"),
    ):
        watch.watch(module, function, name)
    with watch("model"):
        model, process = load_model(folder / "model.json"), read_process(KR270 / "process.yaml")
    with watch("parse"):
        program = next(pieces(folder / "program.src", None))
    with watch("other"):
        result = job.compensate(program, model, process)
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
    """Seconds to read the file, print every point 0.1 mm aside, and write it, piece by piece."""
    from toolpaths.formats.pieces import pieces
    from toolpaths.rewriting import rewrite

    start = time.perf_counter()
    watch = Stopwatch()
    with (folder / "moved.src").open("wb") as out:
        source = pieces(folder / "program.src", None)
        while True:
            with watch("parse"):
                program = next(source, None)
            if program is None:
                break
            out.write(rewrite(program, program.position_mm + 0.1, program.orientation, program.corrected).raw)
    return {"parse": watch.seconds["parse"], "total": time.perf_counter() - start, "cpu": time.process_time()}


def time_command(folder: Path, *options: str) -> dict[str, Any]:
    """Wall and CPU seconds and peak memory of the command; this process is small, so its children's maximum is the command's."""
    import resource
    import subprocess

    tool = Path(sysconfig.get_path("scripts")) / "drake-stiffness"
    command = [str(tool), "compensate", str(folder / "program.src"), "--model", str(folder / "model.json")]
    command += ["--process", str(KR270 / "process.yaml"), "-o", str(folder / "by_command.src"), *options]
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    seconds = time.perf_counter() - start
    unit = 1 if sys.platform == "darwin" else 1024
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {"total": seconds, "cpu": usage.ru_utime + usage.ru_stime, "peak_mib": usage.ru_maxrss * unit / 2**20}


def time_linear(folder: Path) -> dict[str, Any]:
    """The command with deflections superposed."""
    return time_command(folder, "--linear")


def time_pinocchio(folder: Path) -> dict[str, Any]:
    """Seconds of a plain loop: Newton from the posture before, J k J^T of the joints, the target moved, Newton again."""
    import numpy as np
    import pinocchio as pin

    from drake_stiffness.model import load_model
    from toolpaths.compensation import bench_of
    from toolpaths.formats.pieces import pieces
    from toolpaths.loaded_path import targets
    from toolpaths.process import posture, read_process

    model, process = load_model(folder / "model.json"), read_process(KR270 / "process.yaml")
    bench = bench_of(model, process.reference, process.geometry)
    start = posture(process, model)
    program = next(pieces(folder / "program.src", None))
    R, p = targets(program, process, bench, start)
    rows = np.flatnonzero(program.corrected)[:LOOP]
    k, force = bench.loaded.k_joint, np.array([240.0, 180.0, -400.0])
    robot = pin.buildModelFromUrdf(str(KR270 / "kr270.urdf"))
    data, frame = robot.createData(), robot.getFrameId("flange")
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    tcp = pin.SE3(bench.R_ET, bench.p_ET)

    def solve(q: np.ndarray, goal: pin.SE3) -> tuple[np.ndarray, np.ndarray]:
        for _ in range(20):
            pin.computeJointJacobians(robot, data, q)
            pin.updateFramePlacement(robot, data, frame)
            J = pin.getFrameJacobian(robot, data, frame, axes)
            here = data.oMf[frame] * tcp
            arm = here.translation - data.oMf[frame].translation
            J = np.vstack([J[:3] - pin.skew(arm) @ J[3:], J[3:]])
            off = np.concatenate([goal.translation - here.translation, pin.log3(goal.rotation @ here.rotation.T)])
            if np.abs(off).max() < 1e-9:
                break
            q = q + np.linalg.solve(J, off)
        return q, J

    began, began_cpu = time.perf_counter(), time.process_time()
    q, worst = start, 0.0
    for row in rows.tolist():
        q, J = solve(q, pin.SE3(R[row], p[row]))
        wrench = np.concatenate([R[row] @ force, np.zeros(3)])
        twist = J @ (k * (J.T @ wrench))
        solve(q, pin.SE3(pin.exp3(-twist[3:]) @ R[row], p[row] - twist[:3]))
        worst = max(worst, float(np.linalg.norm(twist[:3])))
    assert 1e-5 < worst < 1e-2, worst
    seconds, cpu = time.perf_counter() - began, time.process_time() - began_cpu
    return {"each": seconds / rows.size, "each_cpu": cpu / rows.size}


def make_model(folder: Path) -> dict[str, Any]:
    from drake_stiffness.jobs import identify_campaign

    start = time.perf_counter()
    identify_campaign(KR270 / "campaign.yaml").model.save(folder / "model.json")
    return {"total": time.perf_counter() - start}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, nargs="+", default=[100000, 1000000])
    parser.add_argument("--worker", nargs=2, metavar=("TASK", "FOLDER"), help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.worker:
        tasks = {
            "compensate": time_compensate,
            "command": time_command,
            "linear": time_linear,
            "rewrite": time_rewrite,
            "pinocchio": time_pinocchio,
            "model": make_model,
        }
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
            ended = {task: child(worker(__file__, task, str(folder)), limit_s=1200.0) for task in TASKS}
            report(moves, size, ended)
    finally:
        shutil.rmtree(folder)


def report(moves: int, size_mib: float, ended: dict[str, Any]) -> None:
    """Print the table of one program."""
    rows = []
    notes = [f"{task} ended without a result: {ended[task].why}" for task in TASKS if ended[task].result is None]
    found = {task: ended[task].result for task in TASKS}
    f, loop = found["compensate"], found["pinocchio"]

    def row(label: str, seconds: float, count: int, peak: float | None = None) -> list[str]:
        each = seconds / count
        return [label, f"{seconds:.2f}", f"{each * 1e6:.1f}", f"{1 / each:,.0f}", f"{peak:.0f}" if peak else ""]

    if f is not None:
        names = ("parse", "inverse kinematics", "loaded equilibrium and correction", "intervals", "write")
        for name in (*names, "read back", "parse again", "other"):
            label = {"read back": "read back: predict the printed points", "parse again": "read back: parse"}.get(
                name, name
            )
            rows.append(row(f"CPU of a piece of {f['points']}: {label}", f[name], f["points"]))
        notes.append(
            f"a piece: {f['points']} points by {f['method']} in {f['steps']} iterations; predicted deviation {f['before_mm']:.3f} mm before, "
            f"{f['after_mm']:.5f} mm after; {f['imports_mib']:.0f} MiB are there after the imports; CPU {f['cpu']:.2f} s"
        )
    for task, label in (("command", "the command, loaded equilibrium"), ("linear", "the command, --linear")):
        if found[task] is not None:
            c = found[task]
            rows.append(row(label, c["total"], moves, c["peak_mib"]))
            rows.append(row("  its CPU seconds", c["cpu"], moves))
    if found["rewrite"] is not None:
        r = found["rewrite"]
        rows.append(row("beside: read and rewrite the file", r["total"], moves, r["peak_mib"]))
        rows.append(row("  its CPU seconds, imports included", r["cpu"], moves))
        notes.append(f"of reading and rewriting, parsing takes {r['parse']:.2f} s")
    if loop is not None:
        rows.append(row("beside: pinocchio loop, joints alone, linear", loop["each"] * moves, moves, loop["peak_mib"]))
        rows.append(row("  its CPU seconds", loop["each_cpu"] * moves, moves))
        notes.append(f"the pinocchio loop was timed over {LOOP} points and neither reads nor prints a program")
    title = f"compensate, KR 270, {moves} LIN moves ({size_mib:.1f} MiB), joints and 7 links"
    show(title, ("stage", "seconds", "us a point", "points a second", "peak MiB"), rows, notes)


if __name__ == "__main__":
    main()
