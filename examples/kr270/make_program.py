"""Writes pocket.src: a domed pocket in three levels, the tool turning along the way. Checks that the arm reaches it.

Run: python examples/kr270/make_program.py
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from plants.chain import read_chain  # noqa: E402
from plants.krl_reader import parse_program  # noqa: E402
from plants.process import Process  # noqa: E402

WIDTH, HEIGHT = 400.0, 260.0  # pocket along X and Y, mm
CENTRE = np.array([220.0, 150.0])
LEVELS = (-4.0, -8.0, -12.0)  # mm
OFFSETS = (0.0, 35.0, 70.0, 105.0)  # the loops of a level, from the wall inwards, mm
STRIDE = 19.0  # between waypoints, mm

HEAD = r"""&ACCESS RVP
&REL 1
&PARAM TEMPLATE = C:\KRC\Roboter\Template\vorgabe
DEF pocket( )
;FOLD INI;%{PE}
  ;FOLD BASISTECH INI
    GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )
    INTERRUPT ON 3
    BAS (#INITMOV,0 )
  ;ENDFOLD (BASISTECH INI)
;ENDFOLD (INI)
;FOLD TOOL AND BASE
$TOOL = TOOL_DATA[1] ; spindle, see cell.yaml
$BASE = BASE_DATA[1] ; see process.yaml
;ENDFOLD (TOOL AND BASE)
$APO.CDIS = 0.5
$VEL.CP = 0.05
;FOLD PTP HOME
PTP {A1 0.0, A2 -90.0, A3 90.0, A4 0.0, A5 0.0, A6 0.0}
;ENDFOLD (PTP HOME)
; approach above the pocket
"""
TAIL = """; retract
{retract}
;FOLD PTP HOME
PTP {{A1 0.0, A2 -90.0, A3 90.0, A4 0.0, A5 0.0, A6 0.0}}
;ENDFOLD (PTP HOME)
END
"""


def pose(x: float, y: float, level: float, progress: float) -> str:
    """The words of a pose on the domed floor of a level; the tool leans with the slope and slowly turns."""
    u, v = (x - CENTRE[0]) / (WIDTH / 2), (y - CENTRE[1]) / (HEIGHT / 2)
    z = level - 6.0 * (u * u + v * v)
    a, b, c = 12.0 * np.sin(2 * np.pi * progress), 6.0 * u, 170.0 + 6.0 * v
    return f"{{X {x:.3f},Y {y:.3f},Z {z:.3f},A {a:.3f},B {b:.3f},C {c:.3f}}}"


def loop(offset: float) -> Iterator[tuple[float, float]]:
    """Waypoints of one rectangular loop, `offset` inside the wall, back to its start."""
    half = np.array([WIDTH / 2 - offset, HEIGHT / 2 - offset])
    corners = CENTRE + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    for a, b in pairwise(corners):
        pieces = int(np.ceil(np.linalg.norm(b - a) / STRIDE))
        for k in range(1, pieces + 1):
            x, y = a + (b - a) * k / pieces
            yield float(x), float(y)


def level_lines(number: int, level: float) -> Iterator[str]:
    """One level: all loops from the wall inwards."""
    yield f"; level {number}: Z {level:.1f} mm at the centre"
    points = [point for offset in OFFSETS for point in loop(offset)]
    for k, (x, y) in enumerate(points):
        yield f"LIN {pose(x, y, level, k / len(points))} C_DIS"


def finish_lines() -> Iterator[str]:
    """A finishing pass along the wall with two rounded corners, by CIRC."""
    level, radius = LEVELS[-1], 40.0
    left, right = CENTRE[0] - WIDTH / 2, CENTRE[0] + WIDTH / 2
    low, high = CENTRE[1] - HEIGHT / 2, CENTRE[1] + HEIGHT / 2
    slant = radius * (1 - np.sqrt(0.5))
    yield ";FOLD FINISH"
    yield "; left out by the programmer: LIN {X 0.000,Y 0.000,Z 80.000,A 0.000,B 0.000,C 170.000}"
    yield f"LIN {pose(left, low, level, 0.0)} C_DIS"
    yield f"LIN {pose(right - radius, low, level, 0.2)} C_DIS"
    yield f"CIRC {pose(right - slant, low + slant, level, 0.25)},{pose(right, low + radius, level, 0.3)} C_DIS"
    yield f"LIN {pose(right, high - radius, level, 0.5)} C_DIS"
    yield f"CIRC {pose(right - slant, high - slant, level, 0.55)},{pose(right - radius, high, level, 0.6)} C_DIS"
    yield f"LIN {pose(left, high, level, 0.8)} C_DIS"
    yield f"LIN {pose(left, low, level, 1.0)}"
    yield ";ENDFOLD (FINISH)"


def program_text() -> str:
    """The whole program, lines ended by CR LF."""
    start = CENTRE - [WIDTH / 2, HEIGHT / 2]
    above = f"{{X {start[0]:.3f},Y {start[1]:.3f},Z 60.000,A 0.000,B -6.000,C 164.000}}"
    lines = [f"PTP {above}", f"LIN {pose(*start, LEVELS[0], 0.0)} C_DIS"]
    for number, level in enumerate(LEVELS, start=1):
        lines += level_lines(number, level)
    lines += finish_lines()
    text = HEAD + "\n".join(lines) + "\n" + TAIL.format(retract=f"LIN {above}")
    return text.replace("\n", "\r\n")


def main() -> None:
    """Write the program and say how far it stays from limits and singularities."""
    text = program_text()
    (HERE / "pocket.src").write_bytes(text.encode("ascii"))
    chain, job, program = read_chain(HERE / "kr270.urdf"), Process.from_file(HERE / "process.yaml"), parse_program(text)
    q = job.joints(chain, program)
    spare = np.rad2deg(np.minimum(q - chain.lower, chain.upper - q).min(axis=0))
    smallest = np.linalg.svd(chain.jacobian(q, job.tool.p), compute_uv=False)[:, -1].min()
    print(f"{sum(kind == 'LIN' for kind in program.kinds)} LIN moves, {len(q)} poses under force")
    print("joints from", np.rad2deg(q.min(axis=0)).round(1), "to", np.rad2deg(q.max(axis=0)).round(1), "deg")
    print("nearest to a limit", spare.round(1), f"deg; smallest singular value of J {smallest:.3f}")
    if spare.min() < 10.0 or smallest < 0.1 or np.abs(np.rad2deg(q[:, 4])).min() < 10.0:
        raise SystemExit("the program comes too near to a limit or a singularity")


if __name__ == "__main__":
    main()
