"""The paper's open problem: restored intervals of compliances, and how often they hold the truth.

Links of families of sections (examples/plants), each measured as in `one_joint_campaign`; the limits know the outer half widths only, read
off a drawing with up to 30 % to spare.
Run: python examples/paper/restoration.py [links a family]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import beta

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

sys.path.insert(0, str(HERE))

from one_joint_campaign import BEAM, identified  # noqa: E402
from plants.section_families import BROKEN, SOUND, i_beam  # noqa: E402
from plants.sections import Cantilever  # noqa: E402

from drake_stiffness.errors import UntrustworthyError  # noqa: E402
from drake_stiffness.restoration.restoration import restore  # noqa: E402
from drake_stiffness.restoration.sections import Section, Sections  # noqa: E402

ENTRIES = ("joint_1", *BEAM.names)
CLOSED = {"torsion_factor": (0.3, 1.0)}  # what somebody states who takes the section for a closed one
CASES: dict[str, tuple[Callable[[np.random.Generator], Cantilever], dict]] = {
    **{name: (draw, {}) for name, draw in SOUND.items()},
    "goose neck (not straight)": (BROKEN["goose neck (not straight)"], {}),
    "I-section, stated as closed": (i_beam, CLOSED),
    "carbon fibre, stated as closed": (BROKEN["carbon fibre (E/G 8 to 20)"], CLOSED),
}


@dataclass(frozen=True)
class Coverage:
    """Of one family: links tried, refused as contradictory, with every interval right; per entry (restored, right, high / low)."""

    family: str
    tried: int
    refused: int
    right: int
    entries: dict[str, tuple[int, int, float]]

    @property
    def bounds(self) -> tuple[float, float]:
        """95 % limits (Clopper and Pearson) of the probability that all intervals of a link are right, if it is not refused."""
        n, k = self.tried - self.refused, self.right
        if not n:
            return float("nan"), float("nan")
        return (float(beta.ppf(0.025, k, n - k + 1)) if k else 0.0), (
            float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0
        )


def coverage(family: str, links: int, seed: int = 0) -> Coverage:
    """How often the intervals of random links of a family hold the truth."""
    draw, stated = CASES[family]
    rng = np.random.default_rng([seed, *family.encode()])
    refused, right, found = 0, 0, {name: [] for name in ENTRIES}
    for _ in range(links):
        link = draw(rng)
        model, truth = identified(link, rng)
        y, z = np.array(link.half_widths()) * rng.uniform(1.0, 1.3, 2)
        try:
            r = restore(model, Sections(default=Section(half_width_y_m=y, half_width_z_m=z, **stated)))
        except UntrustworthyError:
            refused += 1
            continue
        slack = 1e-6 * np.abs(truth[r.number])
        inside = (r.low - slack <= truth[r.number]) & (truth[r.number] <= r.high + slack)
        right += bool(inside.all())
        for i, ok, low, high in zip(r.number, inside, r.low, r.high, strict=True):
            found[ENTRIES[i]].append((ok, high / low if low > 0 else np.inf))
    entries = {n: (len(f), sum(ok for ok, _ in f), float(np.median([w for _, w in f]))) for n, f in found.items() if f}
    return Coverage(family, links, refused, right, entries)


def draw_figure(table: list[Coverage], path: Path) -> None:
    """Share of links of every family with all intervals right, refused, and with a wrong one."""
    from matplotlib import rc_context

    from drake_stiffness.report.figures import BLUE, GREY, ORANGE, legend, new

    figure, ax = new(0.4 * len(table) + 1.0)
    shares = np.array([[c.right, c.refused, c.tried - c.right - c.refused] for c in table]).T / [c.tried for c in table]
    names = [c.family for c in table]
    for share, left, colour, label in zip(
        shares, np.cumsum(shares, axis=0) - shares, (BLUE, GREY, ORANGE), ("all intervals right", "refused as contradictory",
        "an interval is wrong"), strict=True
    ):  # fmt: skip
        ax.barh(names, 100 * share, left=100 * left, color=colour, label=label)
    ax.invert_yaxis()
    ax.set_xlabel("% of links")
    legend(ax)
    with rc_context({"svg.hashsalt": "restoration"}):  # the same names in the file every time
        figure.savefig(path, metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))


if __name__ == "__main__":
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    table = []
    for family in CASES:
        table.append(coverage(family, number))
        c = table[-1]
        low, high = c.bounds
        cells = ", ".join(f"{n} {right}/{made} x{ratio:.3g}" for n, (made, right, ratio) in c.entries.items())
        print(f"| {family} | {c.tried} | {c.refused} | {c.right} | {low:.3f} .. {high:.3f} | {cells} |")
    draw_figure(table, HERE.parents[1] / "docs" / "restoration.svg")
