"""How many unknowns the source paper's model has, and how many of them any measurement can tell apart.

    python examples/paper/counts.py [FOLDER]

writes `counts.md` and `counts.svg` (tables and figure of docs/paper_counts.md) to FOLDER, `out/paper` unless given.
"""

from __future__ import annotations

import base64
import sys
from pathlib import Path

import numpy as np

from drake_stiffness.cell import Cell, read_cell
from drake_stiffness.files import write_whole
from drake_stiffness.inspection import complete_effects, inspect_cell, singular_values
from drake_stiffness.invariants import algebraic_rank, chain_rank, invariant_forms
from drake_stiffness.plant import build_arm
from drake_stiffness.report import figures as f
from drake_stiffness.springs import TEMPLATES

CELL = Path(__file__).parents[1] / "kr270" / "cell.yaml"


def markdown(header: tuple[str, ...], rows: list[tuple[object, ...]]) -> str:
    """A table."""
    return "".join("| " + " | ".join(map(str, row)) + " |\n" for row in (header, ("---",) * len(header), *rows))


def algebra_table() -> str:
    """Ranks from what joints leave unchanged: no posture, no robot."""
    rows: list[tuple[object, ...]] = []
    for name, tracks in (("six revolute joints", 0), ("a prismatic joint, then six revolute ones", 1)):
        sums = []
        for template, size in (("full", 36), ("symmetric", 21)):
            slide, turn = (len(invariant_forms(kind, template)) for kind in (True, False))
            middle = f" - {slide}" * tracks
            total = algebraic_rank([True] * tracks + [False] * 6, template)
            sums.append(f"{7 + tracks} x {size}{middle} - 6 x {turn} = {total}")
        rows.append((name, *sums))
    return markdown(("chain", "full", "symmetric"), rows)


def ranks_table(cell: Cell) -> str:
    """Ranks of the KR 270 for ordinary and special load and reading points (flange frame, z is the last axis)."""
    load, points, arm = cell.load_point_m, cell.reference_points_m, build_arm(cell)
    places = {
        "load point and three points anywhere": (load, points),
        "load point on the last axis": ((0.0, 0.0, 0.25), points),
        "load point at the centre of the wrist": ((0.0, 0.0, -0.24), points),
        "two points": (load, {name: points[name] for name in ("P1", "P2")}),
        "one point": (load, {"P1": points["P1"]}),
        "one point, where the load acts": (load, {"P1": load}),
        "one point, on the last axis": (load, {"P1": (0.0, 0.0, 0.1)}),
    }
    rows: list[tuple[object, ...]] = []
    for name, (at, read) in places.items():
        special = cell.model_copy(update={"load_point_m": at, "reference_points_m": read})
        found = inspect_cell(special, arm, identifiability=True).identifiable
        rows.append((name, *(e["rank"] for e in found), f"{min(e['singular_gap'] for e in found):.0e}"))
    return markdown(("KR 270", *(f"{t}, {kind}" for t in TEMPLATES for kind in ("wrench", "force")), "least gap"), rows)


def templates_table(cell: Cell) -> str:
    """Ranks of the beam template without any posture: default beam axes, and x, y or z of every spring frame."""
    arm, rows = build_arm(cell), []
    for name, axes in (("default", {}), *((a, dict.fromkeys(arm.link_names, a)) for a in "xyz")):
        springs = cell.springs.model_copy(update={"beam_axes": axes})
        effects = complete_effects(cell.model_copy(update={"springs": springs}), arm, "beam")
        rank, gap = chain_rank(arm, [effect.basis for effect in effects[arm.num_joints :]])
        rows.append((name, rank, f"{gap:.0e}"))
    return markdown(("beam axes", "rank of 62", "gap"), rows)


def gap_figure(cell: Cell) -> str:
    """Singular values of the observation matrix under full wrenches, with the drop that makes the rank, as a data URI."""
    made, ax = f.new(3.6, width=9.0)
    for template, colour in zip(TEMPLATES, (f.GREY, f.BLUE, f.ORANGE), strict=True):
        values = singular_values(cell, build_arm(cell), template, "wrench")
        x = np.arange(1, values.size + 1)
        ax.semilogy(x, np.maximum(values, 1e-18), ".", ms=3, color=colour, label=f"{template}: {values.size} unknowns")
    ax.set_xlabel("number of the singular value")
    ax.set_ylabel("singular value")
    f.legend(ax, markerscale=3.0)
    return f.uri(made)


def main(folder: Path) -> None:
    """The tables, on the screen and in a file, and the figure."""
    cell = read_cell(CELL)
    text = "\n".join([algebra_table(), ranks_table(cell), templates_table(cell)])
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "counts.md", text)
    write_whole(folder / "counts.svg", base64.b64decode(gap_figure(cell).split(",", 1)[1]))
    print(text)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out/paper"))
