"""Forces of milling against teeth on their true paths: the table and the figure of docs/milling.md.

    python examples/milling/teeth.py [FOLDER]

The truth is `examples/plants/turning_teeth.py`: every tooth on its trochoid, no averaging, no code shared with the package.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import signs

EXAMPLES = Path(__file__).parents[1]
sys.path.insert(0, str(EXAMPLES))

from plants.turning_teeth import TurningCutter  # noqa: E402

from drake_stiffness.files import write_whole  # noqa: E402
from toolpaths.milling.cutters import Cutter  # noqa: E402
from toolpaths.milling.engagement import SIDES, Engagement  # noqa: E402
from toolpaths.milling.laws import linear_edge  # noqa: E402
from toolpaths.milling.library import LIBRARY  # noqa: E402
from toolpaths.milling.mechanistic import average_wrench, wrench_over_turn  # noqa: E402

R, TEETH, HELIX, DEPTH, CHIP = 10e-3, 4, np.radians(30), 3e-3, 0.1e-3
AL = LIBRARY["Al7075-T6"]
# name, corner radius mm, mode, radial depth mm
CASES = (
    ("slot", 0.0, "slot", 20.0),
    ("up, 4 mm wide", 0.0, "up", 4.0),
    ("down, 4 mm wide", 0.0, "down", 4.0),
    ("bull-nose 3 mm, slot", 3.0, "slot", 20.0),
    ("ball, slot", 10.0, "slot", 20.0),
)


def true_forces(corner: float, mode: str, width: float, angles: np.ndarray) -> np.ndarray:
    """(A, 4) force and torque of the teeth on their paths."""
    cutter = TurningCutter(
        R, corner * 1e-3, TEETH, HELIX, *(tuple(k * s for k in ks) for ks, s in ((AL.cutting, 1e6), (AL.edge, 1e3)))
    )
    wall = {"slot": (-1.0, 1.0), "up": (R - width * 1e-3, 1.0), "down": (-1.0, -R + width * 1e-3)}[mode]
    return cutter.forces(DEPTH, wall, CHIP, angles)


def row(name: str, corner: float, mode: str, width: float) -> str:
    """Averages of both, as a row of the table."""
    angles = np.linspace(0, 2 * np.pi / TEETH, 360, endpoint=False)
    cut = Engagement(np.array([DEPTH]), np.array([width * 1e-3]), np.array([SIDES[mode]]))
    law = linear_edge(AL.cutting, AL.edge)
    ours = average_wrench(Cutter(R, corner * 1e-3, TEETH, HELIX), law, cut, np.array([CHIP]))[[0, 1, 2, 5], 0]
    true = true_forces(corner, mode, width, angles).mean(axis=0)
    cells = [f"{a:.1f} ({b:.1f})" for a, b in zip(ours, true, strict=True)]
    return f"| {name} | " + " | ".join(cells) + " |"


def figure(path: Path) -> None:
    """Which way forces push, and one slot over a quarter of a turn with its mean."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "milling"
    import matplotlib.pyplot as plt

    made, (left, right) = plt.subplots(1, 2, figsize=(12, 4), width_ratios=(1.6, 1), layout="constrained")
    signs.draw(left)
    angles = np.linspace(0, 2 * np.pi / TEETH, 200)
    cut = Engagement(np.array([DEPTH]), np.array([2 * R]), np.array([0]))
    ours = wrench_over_turn(Cutter(R, 0.0, TEETH, HELIX), linear_edge(AL.cutting, AL.edge), cut, CHIP, angles).sum(
        axis=0
    )
    true = true_forces(0.0, "slot", 20.0, angles)
    for place, (name, colour) in enumerate((("F_x", "tab:blue"), ("F_y", "tab:orange"), ("F_z", "tab:green"))):
        right.plot(np.degrees(angles), true[:, place], color=colour, lw=4, alpha=0.35)
        right.plot(np.degrees(angles), ours[place], color=colour, lw=1.3, label=f"${name}$")
        right.axhline(ours[place].mean(), color=colour, ls=":", lw=1.2)
    right.set(
        xlabel="turn of the spindle, deg",
        ylabel="force on the tool, N",
        title="a slot: wide the true teeth, dotted the mean",
    )
    right.legend(frameon=False)
    made.savefig(path, metadata={"Date": None})


def main(folder: Path) -> None:
    """The table on the screen and in a file, and the figure."""
    head = "| cut | F_x, N | F_y, N | F_z, N | torque, N m |\n|---|---|---|---|---|"
    text = "\n".join([head, *(row(*case) for case in CASES)]) + "\n"
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "milling.md", text)
    figure(folder / "milling.svg")
    print(text)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out/milling"))
