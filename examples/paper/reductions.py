"""M1, M2, M3 as printed, M3 in turn, and no reduction: truth, campaigns, fits, errors on postures that took no part, figure.

    python examples/paper/reductions.py [FOLDER]

writes `reductions.svg` and `reductions.md` (the tables of docs/paper_reductions.md) to FOLDER, `out/paper` unless given.
"""

from __future__ import annotations

import base64
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

EXAMPLES = Path(__file__).parents[1]
sys.path[:0] = [str(EXAMPLES), str(EXAMPLES / "kr270")]

from make_campaign import instruments, make_plan  # noqa: E402
from plants.campaign_maker import simulate, to_csv  # noqa: E402
from plants.segmented_arm import SegmentedArm  # noqa: E402

from drake_stiffness.files import write_whole  # noqa: E402
from drake_stiffness.reduction.comparison import METHODS, Comparison, compare_reductions  # noqa: E402
from drake_stiffness.report import figures as f  # noqa: E402
from drake_stiffness.report.page import number  # noqa: E402
from drake_stiffness.statistics import held_out_errors  # noqa: E402
from drake_stiffness.task import read_task  # noqa: E402

KR270 = EXAMPLES / "kr270"
HELD, SIGMA_M = 40, 14e-6


@dataclass(frozen=True)
class Setting:
    """An arm and a campaign: factors on the links' stiffness are drawn (lognormal, 0.8) unless `draw` is 0."""

    name: str
    postures: int
    draw: int = 0


SETTINGS = (
    Setting("the KR 270 of the examples, 30 postures", 30),
    Setting("the same with 15 postures", 15),
    Setting("links of random stiffness, 30 postures", 30, draw=1),
)


def campaign(setting: Setting, folder: Path, sigma_m: float = SIGMA_M) -> tuple[Path, Path]:
    """Two campaigns of the same arm and plan: as a tracker reads it, and without noise (to score against the truth)."""
    rng = np.random.default_rng(setting.draw)
    arm = SegmentedArm.from_files(KR270 / "kr270.urdf", KR270 / "true_arm.yaml")
    if setting.draw:
        arm = arm.with_values(link_factors=arm.link_factors * np.exp(rng.normal(0, 0.8, arm.link_factors.shape)))
    tools = instruments(sigma_m=0.0)
    plan = make_plan(arm.chain, tools.load_point, count=setting.postures + HELD, seed=setting.draw + 1)
    exact = simulate(arm, plan, tools, rng)
    held = [plan.names[i] for i in rng.permutation(setting.postures + HELD)[setting.postures :]]
    for name in ("kr270.urdf", "cell.yaml"):
        shutil.copy(KR270 / name, folder)
    for stem, p in (("read", exact + rng.normal(scale=sigma_m, size=exact.shape)), ("exact", exact)):
        (folder / f"{stem}.csv").write_text(to_csv(plan, arm.chain.joint_names, tuple(tools.points), p, "simulated"))
        (folder / f"{stem}.yaml").write_text(
            f"cell: cell.yaml\nmeasurements: {stem}.csv\nnoise: {{position_sigma_mm: {sigma_m * 1e3}}}\n"
            f"hold_out: {{experiments: [{', '.join(held)}]}}\n"
        )
    return folder / "read.yaml", folder / "exact.yaml"


def compare(setting: Setting, methods: tuple[str, ...] = tuple(METHODS)) -> tuple[Comparison, dict[str, np.ndarray]]:
    """The comparison on readings, and each model's errors (um) against the truth at the held-out postures."""
    with tempfile.TemporaryDirectory() as folder:
        read, exact = campaign(setting, Path(folder))
        result = compare_reductions(read_task(read), methods)
        truth = read_task(exact).held_out()
    return result, {
        row.method: 1e6 * np.linalg.norm(held_out_errors(row.model, truth, True), axis=0)
        for row in result.rows
        if row.model is not None
    }


def table(setting: Setting, result: Comparison, errors: dict[str, np.ndarray]) -> str:
    """Markdown: errors against the truth, then what the held-out readings themselves say."""
    whole = result.rows[0].displacement_mm.mean()
    lines = [f"### {setting.name}: mean displacement {whole:.2f} mm", ""]
    header = (
        "method",
        "free",
        "mean, um",
        "p95, um",
        "max, um",
        "compensated, %",
        "read: mean, um",
        "variance, um",
        "bias, um",
    )
    lines += ["| " + " | ".join(header) + " |", "|---" * len(header) + "|"]
    for row in result.rows:
        e = errors[row.method]
        share = f"{100 * (1 - e.mean() / (1e3 * whole)):.3f}"
        own = [number(v, 3) for v in (e.mean(), np.quantile(e, 0.95), e.max())]
        read = [number(1e3 * v, 3) for v in (row.mean_mm, row.deviation_mm, row.bias_mm)]
        lines.append("| " + " | ".join((row.label, str(row.parameters), *own, share, *read)) + " |")
    tied = ", ".join(result.tied)
    return "\n".join([*lines, "", f"Recommended: {result.recommended}; within noise of the best: {tied}.", ""])


def figure(found: list[tuple[Setting, Comparison, dict[str, np.ndarray]]]) -> str:
    """Mean to 95 % of the error against the truth, by method, a panel a setting."""
    made, axes = f.new(3.6, 1, len(found), width=12.0, sharex=True, sharey=True)
    for ax, (setting, result, errors) in zip(np.atleast_1d(axes), found, strict=True):
        rows = result.rows[::-1]
        for y, row in enumerate(rows):
            e, colour = errors[row.method], f.ORANGE if row.method == "m3" else f.BLUE
            ax.plot([e.mean(), np.quantile(e, 0.95)], [y, y], color=colour, linewidth=3)
            ax.plot(e.mean(), y, "o", color=colour)
            ax.annotate(
                f"{row.parameters}", (e.mean(), y), (-6, 0), textcoords="offset points", ha="right", va="center"
            )
        ax.set_xscale("log")
        ax.set_xlim(left=2.0)
        f.log_axis(ax.xaxis)
        ax.set_yticks(range(len(rows)), [row.method for row in rows])
        ax.set_title(setting.name)
        ax.set_xlabel("error at new postures, um")
    return f.uri(made)


def main(folder: Path) -> None:
    """All settings, and the files."""
    found = [(setting, *compare(setting)) for setting in SETTINGS]
    text = "\n".join(table(*one) for one in found)
    print(text)
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "reductions.md", text)
    write_whole(folder / "reductions.svg", base64.b64decode(figure(found).split(",", 1)[1]))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out/paper"))
