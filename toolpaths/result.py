"""What `compensate` hands back: the corrected program and an honest account of it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolpaths.account.account import Account
from toolpaths.account.residual import LEVEL
from toolpaths.account.tally import summary_of
from toolpaths.formats import files_of, paths_beside
from toolpaths.loaded_path import LoadedPath
from toolpaths.probing.closed_loop import Learnt
from toolpaths.process import Process
from toolpaths.program import Program, Refusal
from toolpaths.rewriting import Insertion
from toolpaths.spin import Spin

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
    deflection_mm : (N, 3)
        Where the uncorrected tool is predicted to be less where it is wanted, world axes.
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
    account : Account
        Intervals, causes, evenness, reserves, turning points.
    path : LoadedPath
        Postures and wrenches of the program as it was.
    learnt : Learnt, optional
        What a probe added.
    spin : Spin, optional
        Turn of the tool about its axis, where it was chosen.
    """

    program: Program
    parts: tuple[bytes, ...]
    rows: NDArray[np.int_]
    line: NDArray[np.int_]
    target_mm: Floats
    correction_mm: Floats
    force_N: Floats
    deflection_mm: Floats
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
    account: Account
    path: LoadedPath
    learnt: Learnt | None = None
    spin: Spin | None = None

    @property
    def raw(self) -> bytes:
        """The corrected file with the motions."""
        return self.parts[0]

    def files(self, output: Path) -> list[tuple[Path, bytes]]:
        """What to write where."""
        paths = paths_beside(self.program, output)
        return list(zip([output, *paths], files_of(self.program, self.parts), strict=True))

    @property
    def lines(self) -> int:
        """Lines of all files of the program."""
        return self.program.raw.count(b"\n") + (not self.program.raw.endswith(b"\n"))

    @property
    def digests(self) -> tuple[str, str]:
        """SHA-256 of the program as it was and of the corrected file with the motions."""
        return hashlib.sha256(self.program.raw).hexdigest(), hashlib.sha256(self.raw).hexdigest()

    def to_dict(self, summary: Callable[[Floats], dict[str, Any]] = summary_of) -> dict[str, Any]:
        """For `--json`; `summary` says what is told of values that every point has."""
        size = np.linalg.norm(self.correction_mm, axis=1)
        account, interval = self.account, self.account.interval
        return {
            "corrected_points": int(self.rows.size),
            "lines": self.lines,
            "correction_mm": summary(size),
            "uncompensated_mm": summary(self.before_mm),
            "one_shot_residual_mm": summary(self.one_shot_mm),
            "residual_mm": summary(self.after_mm),
            "percent_compensated": percent(self.before_mm, self.after_mm, self.quantum_mm),
            "model_sigma_mm": summary(self.sigma_mm),
            "residual_interval_mm": {
                "level": LEVEL,
                "low": summary(interval.low_mm),
                "high": summary(interval.high_mm),
                "sigma_parts_mm": {
                    "parameters": summary(interval.parameters_mm),
                    "force": summary(interval.force_mm),
                    "model_form": summary(interval.form_mm),
                    "backlash_jumps": summary(interval.jump_mm),
                },
                "carries": list(interval.carries),
                "lacks": list(interval.lacks),
            },
            "joints_only_mm": {
                **summary(account.causes.joints_only_mm),
                "best_possible_rms": account.causes.best_joints_only_mm,
            },
            "causes": account.causes_list(),
            "turning_points": account.turning.to_list(self.line),
            "evenness": {**account.evenness.to_dict(self.line), **account.blending.to_dict()},
            "reserve": account.reserve.to_dict(),
            "controller": self.process.controller.model_dump(),
            "probe": None if self.learnt is None else self.learnt.to_dict(),
            "unsupported_share": float(self.unsupported.max(initial=0.0)),
            "iterations": self.steps,
            "largest_contraction": self.contraction,
            "half_printed_digit_mm": self.quantum_mm,
            "inverse_kinematics": self.method,
            "refused": [{"line": r.line, "reason": r.reason, "words": list(r.words)} for r in self.refusals],
            "inserted": [{"line": i.line, "words": list(i.words), "text": i.text} for i in self.insertions],
            "linearised": [
                {"line": r.line, "before": r.before, "new_line": r.new_line, "after": r.after.split("\n")}
                for r in self.program.replaced
            ],
            "spin": None if self.spin is None else self.spin.to_dict(),
            "notes": self.notes,
        }


def percent(before: Floats, after: Floats, quantum: float) -> float:
    """Percent of the mean deviation that is compensated; NaN where there was none that printing could show."""
    return float(100 * (1 - after.mean() / before.mean())) if before.size and before.mean() > quantum else float("nan")
