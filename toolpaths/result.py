"""What `compensate` hands back: the corrected program and an honest account of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolpaths.process import Process
from toolpaths.program import Program, Refusal
from toolpaths.rewriting import Insertion

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Compensation:
    """A corrected program and what is known about it.

    Attributes
    ----------
    program : Program
        As it was.
    parts : tuple of bytes
        The corrected program, one entry a file of it (`Program.parts`).
    rows : (N,)
        Rows of the program that were corrected.
    line : (N,)
    target_mm : (N, 3)
        Where the tool is wanted, in the program's base frame.
    correction_mm : (N, 3)
        What the numbers of the program move by, in that frame.
    force_N : (N, 3)
        Force on the tool, world axes.
    before_mm, one_shot_mm, after_mm : (N,)
        Predicted distance of the tool from where it is wanted: uncorrected, one step of the iteration, and as printed.
    process : Process
        What it was corrected for.
    sigma_mm : (N,)
        Standard deviation of the predicted deflection from the parameters' covariance; NaN where unknown.
    unsupported : (N,)
        Share of the prediction that the campaign does not support.
    contraction : float
        Largest ratio of successive steps.
    steps : int
    quantum_mm : float
        Half a printed digit, the most that printing costs per word.
    method : str
        Inverse kinematics used.
    refusals : tuple of Refusal
        Motions under force that stay as they were.
    insertions : tuple of Insertion
    notes : list of str
        What the user should know.
    """

    program: Program
    parts: tuple[bytes, ...]
    rows: NDArray[np.int_]
    line: NDArray[np.int_]
    target_mm: Floats
    correction_mm: Floats
    force_N: Floats
    before_mm: Floats
    one_shot_mm: Floats
    after_mm: Floats
    process: Process
    sigma_mm: Floats
    unsupported: Floats
    contraction: float
    steps: int
    quantum_mm: float
    method: str
    refusals: tuple[Refusal, ...]
    insertions: tuple[Insertion, ...]
    notes: list[str]

    @property
    def raw(self) -> bytes:
        """The corrected file with the motions."""
        return self.parts[0]

    def files(self, output: Path) -> list[tuple[Path, bytes]]:
        """What to write where: companions go beside the output under its name and their own suffix."""
        paths = [output, *(output.with_suffix(Path(part.path).suffix) for part in self.program.parts[1:])]
        return list(zip(paths, self.parts, strict=True))

    def to_dict(self) -> dict[str, Any]:
        """For `--json`."""
        size = np.linalg.norm(self.correction_mm, axis=1)
        return {
            "corrected_points": int(self.rows.size),
            "lines": self.program.raw.count(b"\n") + (not self.program.raw.endswith(b"\n")),
            "correction_mm": _summary(size),
            "uncompensated_mm": _summary(self.before_mm),
            "one_shot_residual_mm": _summary(self.one_shot_mm),
            "residual_mm": _summary(self.after_mm),
            "percent_compensated": percent(self.before_mm, self.after_mm, self.quantum_mm),
            "model_sigma_mm": _summary(self.sigma_mm),
            "unsupported_share": float(self.unsupported.max(initial=0.0)),
            "iterations": self.steps,
            "largest_contraction": self.contraction,
            "half_printed_digit_mm": self.quantum_mm,
            "inverse_kinematics": self.method,
            "refused": [{"line": r.line, "reason": r.reason, "words": list(r.words)} for r in self.refusals],
            "inserted": [{"line": i.line, "words": list(i.words), "text": i.text} for i in self.insertions],
            "notes": self.notes,
        }


def _summary(values: Floats) -> dict[str, float]:
    known = values[np.isfinite(values)]
    if not known.size:
        return {"mean": float("nan"), "rms": float("nan"), "p95": float("nan"), "max": float("nan")}
    return {
        "mean": float(known.mean()),
        "rms": float(np.sqrt((known**2).mean())),
        "p95": float(np.percentile(known, 95)),
        "max": float(known.max()),
    }


def percent(before: Floats, after: Floats, quantum: float) -> float:
    """Percent of the mean deviation that is compensated; NaN where there was none that printing could show."""
    return float(100 * (1 - after.mean() / before.mean())) if before.size and before.mean() > quantum else float("nan")
