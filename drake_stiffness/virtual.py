"""Tables written back: plans with simulated readings, measurements with predictions."""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path

import numpy as np

from drake_stiffness.campaign import Measurements
from drake_stiffness.rotations import Array

# A campaign must state a noise; a noise-free simulation states that of a good laser tracker.
STATED_SIGMA_MM = 0.012


def with_columns(m: Measurements, added: dict[str, Array]) -> str:
    """The rows of a table, cells untouched, with columns added; NaN becomes an empty cell.

    A plan without a `point` column gets one, and a row per reference point.
    """
    table = m.table
    old = [name for name in table.header if name not in added]
    keep = [table.column(name) for name in old]
    lacks_point = "point" not in table.header
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([*old, *(["point"] if lacks_point else []), *added])
    texts = [[_cell(v) for v in values] for values in added.values()]
    for reading, row in enumerate(m.row):
        cells = [table.rows[row][place] for place in keep]
        point = [str(m.point[reading])] if lacks_point else []
        writer.writerow([*cells, *point, *(text[reading] for text in texts)])
    return out.getvalue()


def _cell(value: float) -> str:
    return f"{value:.6f}" if np.isfinite(value) else ""


def campaign_files(m: Measurements, p: Array, cell: Path, folder: Path, sigma_mm: float, seed: int) -> dict[str, str]:
    """campaign.yaml and measurements.csv of a virtual campaign.

    Parameters
    ----------
    p : (3, M)
        Simulated positions, m.
    folder : Path
        Where the files will stand.
    """
    noise = np.random.default_rng(seed).normal(scale=sigma_mm, size=p.shape) if sigma_mm > 0 else 0.0
    noisy = p * 1e3 + noise
    table = with_columns(m, {f"{axis}_mm": noisy[c] for c, axis in enumerate("xyz")})
    stated = sigma_mm if sigma_mm > 0 else STATED_SIGMA_MM
    path = Path(os.path.relpath(cell.resolve(), folder.resolve())).as_posix()
    campaign = (
        f"# A virtual campaign: simulated readings, seed {seed}, noise {sigma_mm:g} mm a coordinate.\n"
        f"cell: {path}\n"
        "measurements: measurements.csv\n"
        f"noise: {{position_sigma_mm: {stated:g}}}\n"
    )
    return {"campaign.yaml": campaign, "measurements.csv": table}
