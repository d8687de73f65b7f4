"""What the KR 270 campaign determines: rank and gap, what merges, base parameters, eigen-directions, and a check against a known arm.

    python examples/paper/groups.py [FOLDER]

writes `groups.md` and `groups.svg` (tables and figure of docs/paper_groups.md) to FOLDER, `out/paper` unless given.
"""

from __future__ import annotations

import base64
import shutil
import sys
from pathlib import Path

import numpy as np

from drake_stiffness.files import write_whole
from drake_stiffness.groups import Groups
from drake_stiffness.jobs import identify_campaign
from drake_stiffness.report import figures as f

KR270 = Path(__file__).parents[1] / "kr270"
sys.path[:0] = [str(KR270), str(KR270.parent)]

from make_campaign import instruments, make_table  # noqa: E402
from plants.segmented_arm import SegmentedArm  # noqa: E402


def markdown(header: tuple[str, ...], rows: list[tuple[object, ...]]) -> str:
    """A table."""
    return "".join("| " + " | ".join(map(str, row)) + " |\n" for row in (header, ("---",) * len(header), *rows))


def known_arm(folder: Path) -> tuple[Groups, np.ndarray]:
    """Groups from readings of an arm whose links are rigid: joints alone give way, and the sums are the joints' compliances."""
    arm = SegmentedArm.from_files(KR270 / "kr270.urdf", KR270 / "true_arm.yaml").with_link_stiffness(1e6)
    bench = folder / "rigid_links"
    bench.mkdir(parents=True, exist_ok=True)
    for name in ("cell.yaml", "campaign.yaml", "kr270.urdf"):
        shutil.copy(KR270 / name, bench)
    (bench / "measurements.csv").write_text(make_table(arm, instruments()))
    return identify_campaign(bench / "campaign.yaml", "least-squares").groups, arm.joint_compliance


def tables(groups: Groups, known: Groups, truth: np.ndarray) -> str:
    """Counts, what merges into the joints, and the known arm."""
    view, v = groups.view, groups.values
    counts: list[tuple[object, ...]] = [
        ("parameters", len(groups.names)),
        ("base parameters (rank)", view.algebraic_rank),
        ("last singular value, next", f"{view.singular[view.algebraic_rank - 1]:.1e}, below 1e-14"),
    ]
    for name, all_of in (
        ("of base parameters", groups.group),
        ("of directions, per value", groups.directions.group),
        ("of directions, per scale", groups.per("scale").directions.group),
    ):
        counts.append((f"G1+, G1~, G1- {name}", ", ".join(str(all_of.count(g)) for g in ("G1+", "G1~", "G1-"))))
    relations: list[tuple[object, ...]] = [
        (text, f"{1e6 * v.least_squares[k]:.3f} +- {1e6 * v.sigma[k]:.3f}", f"{groups.ratio[k]:.0f}")
        for k, (_, text) in enumerate(groups.sums()[:6])
    ]
    z = (known.values.least_squares - np.append(truth, np.zeros(len(known.group) - 6))) / known.values.sigma
    checks: list[tuple[object, ...]] = [
        (name, f"{1e6 * k:.3f}", f"{1e6 * x:.3f} +- {1e6 * s:.3f}")
        for name, k, x, s in zip(
            known.base_names[:6], truth, known.values.least_squares, known.values.sigma, strict=False
        )
    ]
    checks.append(("root mean square of all 32 z-scores", "1", f"{np.sqrt((z**2).mean()):.2f}"))
    return "\n".join(
        [
            markdown(("KR 270 example campaign", ""), counts),
            markdown(("sum, SI", "value, 1e-6 rad/(N m)", "ratio"), relations),
            markdown(("base parameter, rigid links", "true", "found, 1e-6 rad/(N m)"), checks),
        ]
    )


def figure(groups: Groups) -> str:
    """Singular values with the gap; ratios of base parameters and of eigen-directions, in order of size. A data URI."""
    made, (left, right) = f.new(3.8, 1, 2, width=10.5)
    s, r = groups.view.singular, groups.view.algebraic_rank
    number = np.arange(1, s.size + 1)
    left.semilogy(number[:r], s[:r], "o", ms=4, color=f.BLUE, label="determined")
    left.semilogy(number[r:], np.maximum(s[r:], 1e-18), "s", ms=3.5, color=f.GREY, label="zero but for rounding")
    left.axvline(r + 0.5, color=f.ORANGE)
    left.set_xlabel("number of the singular value")
    left.set_ylabel("singular value")
    f.legend(left)
    place = np.arange(1, groups.ratio.size + 1)
    for ratio, colour, mark, label in (
        (groups.ratio, f.BLUE, "o", "base parameters"),
        (groups.directions.ratio, f.ORANGE, "D", "eigen-directions"),
    ):
        right.semilogy(place, np.sort(ratio)[::-1], mark, ms=4, color=colour, label=label)
    for threshold in (groups.upper, groups.lower):
        right.axhline(threshold, color=f.INK, linewidth=0.9, linestyle="--")
    right.set_ylim(0.01, 2e4)
    right.set_xlabel("in order of size")
    right.set_ylabel("ratio |value| / sigma")
    f.legend(right)
    return f.uri(made)


def main(folder: Path) -> None:
    """The tables, on the screen and in a file, and the figure."""
    groups = identify_campaign(KR270 / "campaign.yaml").groups
    text = tables(groups, *known_arm(folder))
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "groups.md", text)
    write_whole(folder / "groups.svg", base64.b64decode(figure(groups).split(",", 1)[1]))
    print(text)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out/paper"))
