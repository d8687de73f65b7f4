"""Geometry alone against geometry with joint compliance, on a campaign of absolute positions: ten random halves.

Run: python examples/ur10/halves.py FOLDER [--halves 10] [--method sdp]

FOLDER holds cell.yaml, campaign.yaml and what they name (the UR10 series of the ipa-robot-accuracy set, rewritten in the
format of docs/reference.md). Nothing in it is changed: every fit runs on a copy.
"""

from __future__ import annotations

import argparse
import logging
import shutil
import tempfile
from pathlib import Path

import numpy as np
import yaml
from rich.console import Console
from rich.progress import track
from rich.table import Table

from drake_stiffness.effects.compliance import JointCompliance
from drake_stiffness.jobs import Identified, identify_campaign


def fit_half(folder: Path, work: Path, seed: int, springs: str, method: str) -> Identified:
    """Identify on a random half; `springs` is 'none' or 'all' joints."""
    shutil.copytree(folder, work, dirs_exist_ok=True)
    for path in work.iterdir():
        path.chmod(0o644)
    cell = yaml.safe_load((work / "cell.yaml").read_text())
    cell["springs"] = {"joints": springs, "links": "none"}
    (work / "cell.yaml").write_text(yaml.safe_dump(cell))
    campaign = yaml.safe_load((work / "campaign.yaml").read_text())
    campaign["hold_out"] = {"fraction": 0.5, "seed": seed}
    (work / "campaign.yaml").write_text(yaml.safe_dump(campaign))
    return identify_campaign(work / "campaign.yaml", method)


def main() -> None:
    """Print held-out errors and compliances."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--halves", type=int, default=10)
    parser.add_argument("--method", default="sdp", choices=("sdp", "least-squares"))
    arguments = parser.parse_args()
    logging.getLogger("drake_stiffness").setLevel(logging.ERROR)
    console = Console(highlight=False)
    errors, compliances, names = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        for seed in track(range(arguments.halves), description="halves", console=Console(stderr=True)):
            fits = [fit_half(arguments.folder, Path(folder) / s, seed, s, arguments.method) for s in ("none", "all")]
            errors.append([fit.model.fit["held_out_rms_mm"] for fit in fits])
            model = fits[1].model
            springs = [i for i, e in enumerate(model.effects) if isinstance(e, JointCompliance)]
            names = [model.effects[i].where for i in springs]
            compliances.append([model.x[model.slices[i]][0] for i in springs])
    before, after = np.array(errors).T
    gain = before - after
    console.print(
        f"held-out 3-D RMS, mean of {arguments.halves} halves: geometry {before.mean():.4f} mm, with joint compliance "
        f"{after.mean():.4f} mm; paired gain {gain.mean():.4f} mm, standard deviation {gain.std(ddof=1):.4f} mm, smallest "
        f"{gain.min():.4f} mm"
    )
    last = fits[1].model
    assert last.statistics is not None
    table = Table(title="Joint compliance, 1e-6 rad/(N m)")
    for name in ("joint", "mean of halves", "spread", "sigma of the last half", "group of the last half"):
        table.add_column(name)
    for column, name in enumerate(names):
        k = np.array(compliances)[:, column] * 1e6
        i = last.names.index(name)
        sigma = last.statistics.sigma[i] * 1e6
        shown = f"{sigma:.2f}" if np.isfinite(sigma) else "-"
        table.add_row(name, f"{k.mean():.2f}", f"{k.std(ddof=1):.2f}", shown, last.statistics.group[i])
    console.print(table)
    for line in fits[1].warnings:
        console.print(f"! {line}", markup=False)


if __name__ == "__main__":
    main()
