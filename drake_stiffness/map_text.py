"""What `map` prints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from rich.console import Console

    from toolpaths.stiffness_map import StiffnessMap


def show_map(console: Console, found: StiffnessMap, best: int) -> None:
    """Best place, worst place, and the one that process.yaml has."""
    from rich.table import Table

    sound = np.isfinite(found.measure)
    table = Table(title=f"{int(sound.sum())} of {sound.size} places can be machined")
    for name in ("place", "x m", "y m", "z m", "um per 100 N, worst direction", "along the program, mm"):
        table.add_column(name, justify="left" if name == "place" else "right")
    for label, place in (("best", best), ("worst", int(np.nanargmax(found.measure))), ("as it is now", found.here)):
        mean = f"{found.mean_mm[place]:.4f}" if found.by_program else ""
        worst = f"{found.worst_um[place]:.1f}" if sound[place] else str(found.state[place])
        table.add_row(label, *(f"{v:.3f}" for v in found.place_m[place]), worst, mean if sound[place] else "")
    console.print(table)
    here = found.measure[found.here]
    if np.isfinite(here) and here > 0:
        gain = 100 * (1 - found.measure[best] / here)
        console.print(
            f"Moved to the best place, the {'workpiece' if found.by_program else 'tool point'} bends {gain:.0f} % less."
        )
