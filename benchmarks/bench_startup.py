"""How long commands take before they do anything: wall time of whole processes.

Run: python benchmarks/bench_startup.py [--rounds 7]

All are started in turn, several rounds. `predict` and `compensate` work on the smallest input there is (one row, one
move), so what they show is start-up.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

from table import KR270, environment, in_turn, show, spread

MOVE = "DEF one( )\nLIN {X 220.000,Y 150.000,Z -4.000,A 0.000,B 0.000,C 170.000}\nEND\n"


def imported(tool: str) -> list[str]:
    """Which heavy packages `--help` imports."""
    code = f"import sys; sys.argv = [{tool!r}, '--help']\nfrom drake_stiffness.cli import main\ntry:\n main()\n"
    code += "except SystemExit:\n pass\nheavy = ('numpy', 'scipy', 'pydrake', 'cvxpy', 'matplotlib', 'pydantic', 'rich', 'eaik')\n"
    code += "print(*[n for n in heavy if n in sys.modules], file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stderr.split()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    args = parser.parse_args()
    tool = str(Path(sysconfig.get_path("scripts")) / "drake-stiffness")
    with tempfile.TemporaryDirectory(prefix="bench_startup_") as name:
        folder = Path(name)
        model, out = str(folder / "model.json"), str(folder / "out")
        subprocess.run(
            [tool, "identify", str(KR270 / "campaign.yaml"), "-o", model], check=True, stdout=subprocess.DEVNULL
        )
        (folder / "one.src").write_text(MOVE)
        # Two lines of the campaign: the header and one unloaded reading.
        (folder / "one.csv").write_text("\n".join((KR270 / "measurements.csv").read_text().splitlines()[:2]) + "\n")
        process = str(KR270 / "process.yaml")
        commands = {
            "python -c pass": [sys.executable, "-c", "pass"],
            "python -c 'import numpy'": [sys.executable, "-c", "import numpy"],
            "drake-stiffness --help": [tool, "--help"],
            "drake-stiffness compensate --help": [tool, "compensate", "--help"],
            "drake-stiffness predict, one row": [tool, "predict", str(folder / "one.csv"), "-o", out],
            "drake-stiffness compensate, one move": [tool, "compensate", str(folder / "one.src"), "-o", out],
            "drake-stiffness inspect": [tool, "inspect", str(KR270 / "cell.yaml")],
        }
        commands["drake-stiffness predict, one row"].insert(2, model)
        commands["drake-stiffness compensate, one move"] += ["--model", model, "--process", process]

        def run(command: list[str]) -> None:
            done = subprocess.run(command, capture_output=True, text=True, env=environment())
            if done.returncode:
                sys.exit(f"{' '.join(command)}: exit code {done.returncode}\n{done.stderr}")

        seconds = in_turn({name: (lambda c=c: run(c)) for name, c in commands.items()}, args.rounds)
        rows = [[name, spread(s, 1.0, 3)] for name, s in seconds.items()]
        note = f"heavy packages that --help imports: {', '.join(imported(tool)) or 'none'}"
        show(f"Start-up, {args.rounds} rounds in turn", ("command", "seconds (median, smallest-largest)"), rows, [note])


if __name__ == "__main__":
    main()
