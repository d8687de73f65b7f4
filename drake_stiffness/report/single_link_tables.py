"""The single-link example as tables: our number beside the printed one, for terminal, page and docs alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_stiffness.report.page import number
from drake_stiffness.single_link.example import LOAD, UNKNOWNS, SingleLink
from drake_stiffness.single_link.prints import (
    NONZERO,
    PRINTED_17,
    PRINTED_18,
    PRINTED_25,
    ROTATION_ROW,
    names_of,
    reconstruct,
)
from drake_stiffness.single_link.study import METHODS, SingleLinkStudy


@dataclass(frozen=True)
class Table:
    """A table of text.

    Attributes
    ----------
    title : str
    header : tuple of str
    rows : tuple of tuple of str
    note : str
        What to read in it.
    """

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str

    def markdown(self) -> str:
        """The table as the docs have it (title and note are the page's own words there)."""
        lines = [self.header, ("---",) * len(self.header), *self.rows]
        return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def _sci(value: float) -> str:
    return f"{value:.2e}" if value else "0"


def _signed(value: float) -> str:
    return f"{np.round(value, 1) + 0.0:+.1f}"


def _percent(share: float) -> str:
    return f"{number(100 * share)} %"


def _below_zero(ratio: float) -> float:
    """Probability that a normal estimate of that ratio of value to standard deviation is negative."""
    return 0.5 * math.erfc(ratio / math.sqrt(2.0))


def reconstruction_table() -> Table:
    """Every nonzero entry of (15): which print it comes from, and how far rounding leaves it open."""
    found = reconstruct()
    rows = []
    for name, source, (i, j) in zip(names_of(NONZERO), found.source, np.argwhere(NONZERO).tolist(), strict=True):
        row = int(ROTATION_ROW[i])
        own = f"{found.low[i, j]:.3e} .. {found.high[i, j]:.3e}"
        ratio = f"{PRINTED_18.value[i, j]:g}"
        rows.append((name, ratio, _sci(found.sigma[row]), own, _sci(found.compliance[i, j]), source))
    low, high = found.sigma_low, found.sigma_high
    return Table(
        "Matrix (15) rebuilt from print (SI)",
        ("entry", "ratio (18)", "sigma of its row", "size by its own print", "value used", "from"),
        tuple(rows),
        "The standard deviation of an entry is (25) over (17): the rounding of all these prints together leaves "
        f"{low[0]:.3e} to {high[0]:.3e} in rows 1 to 3 and {low[1]:.3e} to {high[1]:.3e} in rows 4 to 6. Signs off the diagonal are those of (25).",
    )


def ratio_table(printed: SingleLink, stated: SingleLink, seed: int) -> Table:
    """(17) and (18) beside ours at both noises."""
    ours = np.abs(printed.fits[0].matrices(printed.readings(seed))) / printed.fits[0].sigma
    draw = np.where(PRINTED_25.value * printed.truth < 0, -1, 1) * np.abs(PRINTED_17.value) - printed.exact_ratio
    rows = tuple(
        (
            name,
            f"{PRINTED_18.value[i, j]:g}",
            number(printed.exact_ratio[i, j], 4),
            number(stated.exact_ratio[i, j], 4),
            f"{PRINTED_17.value[i, j]:g}",
            number(ours[i, j], 4),
            _signed(draw[i, j]),
        )
        for name, (i, j) in zip(names_of(NONZERO), np.argwhere(NONZERO).tolist(), strict=True)
    )
    return Table(
        "Ratio of an entry to its standard deviation, 36 unknowns",
        (
            "entry",
            "(18) printed",
            "(18) ours, noise as printed",
            "(18) ours, noise as stated",
            "(17) printed",
            f"(17) ours, seed {seed}",
            "(17) printed - (18)",
        ),
        rows,
        "(18) agrees in every printed digit at the noise as printed, because (15) was rebuilt from it: a consistency check (only k53 and k62 "
        "test anything, against their twins), no proof. (17) holds one draw of noise that cannot be repeated, so only its size can agree: "
        "the last column should be draws of a normal distribution of width 1, and its sum of squares is "
        f"{float((draw[NONZERO] ** 2).sum()):.1f} of {draw[NONZERO].size} +- {np.sqrt(2 * draw[NONZERO].size):.1f}. 684 and 68.4, 1592 and 159 are no "
        "misprints although k35 = k53 and k26 = k62: rows 1 to 3 are read in metres, rows 4 to 6 in radians, with ten times the "
        "standard deviation. The minus of -67.3 is one: (17) is a table of absolute values, and k35 is negative too.",
    )


def estimate_table(link: SingleLink, seed: int) -> Table:
    """(25) beside ours after M1 and M2."""
    fit = link.fits[2]
    ours = fit.matrices(link.readings(seed))
    upper = NONZERO & np.triu(np.ones((6, 6), dtype=bool))
    places = np.argwhere(upper).tolist()
    draw = (PRINTED_25.value - link.truth) / np.where(upper, fit.sigma, 1)
    # Where a printed digit is coarser than the noise it hides the draw.
    sharp = upper & (PRINTED_25.half_digit < fit.sigma / 2)
    rows = tuple(
        (
            f"k{i + 1}{j + 1}",
            _sci(link.truth[i, j]),
            _sci(PRINTED_25.value[i, j]),
            _sci(ours[i, j]),
            _sci(fit.sigma[i, j]),
            _signed(draw[i, j]),
        )
        for i, j in places
    )
    return Table(
        f"Estimate after M1 and M2, noise as {link.noise.name} (SI)",
        ("entry", "(15)", "(25) printed", f"ours, seed {seed}", "sigma", "((25) - (15)) / sigma"),
        rows,
        "The paper's draw cannot be repeated: agreement means a last column of the size of 1 where the three printed digits are finer than "
        f"the noise ({', '.join(names_of(sharp))}: sum of squares {number(float((draw[sharp] ** 2).sum()), 2)} of {int(sharp.sum())}). Its k11 is "
        f"negative, which happens in {_percent(_below_zero(link.exact_ratio[0, 0]))} of all draws.",
    )


def error_table(study: SingleLinkStudy) -> Table:
    """Relative errors per entry for all ways to estimate."""
    sigma = study.link.relative_sigma()
    rows = tuple(
        (name, _percent(sigma[0, i]), *(_percent(study.rms_relative_error[m, i]) for m in range(len(METHODS))))
        for i, name in enumerate(names_of(NONZERO))
    )
    return Table(
        f"Relative error of an entry, root mean square over {study.seeds} seeds, noise as {study.link.noise.name}",
        ("entry", "sigma by (14), 36 unknowns", *METHODS),
        rows,
        "M1 helps k53 and k62 alone: it puts the reading in metres, which is ten times better, in place of the reading in radians "
        "(k35 and k26 gain half a percent of their error). It does nothing for any other entry, k11 included, and M2 adds nothing for the "
        "entries it keeps: the six unit loads make them independent. The semidefinite constraint moves k11 and next to nothing else.",
    )


def physics_table(studies: Sequence[SingleLinkStudy]) -> Table:
    """How often the estimate is no compliance matrix, per way to estimate."""
    rows = []
    for i, method in enumerate(METHODS):
        words = "never; on the border {}" if i >= len(UNKNOWNS) else "{}"
        rows.append((method, *(words.format(number(study.not_definite[i])) for study in studies)))
    exact = " and ".join(number(_below_zero(study.link.exact_ratio[0, 0])) for study in studies)
    error = max(math.sqrt(p * (1 - p) / study.seeds) for study in studies for p in study.not_definite)
    return Table(
        f"Share of {studies[0].seeds} seeds in which the estimate is not positive definite",
        ("estimate", *(f"noise as {study.link.noise.name}" for study in studies)),
        tuple(rows),
        f"Standard error of a share: {number(error, 2)} or less. The normal distribution alone puts k11 below zero in {exact} of all draws. On the "
        "border of the cone an eigenvalue is zero: the sign is repaired, but such a compliance has no stiffness matrix.",
    )


def k11_table(study: SingleLinkStudy) -> Table:
    """What becomes of the one entry that noise hides."""
    rows = tuple(
        (
            method,
            number(study.k11_negative[i]),
            number(study.k11_nothing[i]),
            number(study.k11_mean[i]),
            _percent(study.rms_relative_error[i, 0]),
        )
        for i, method in enumerate(METHODS)
    )
    return Table(
        f"k11 over {study.seeds} seeds, noise as {study.link.noise.name}",
        ("estimate", "share negative", "share zero", "mean / truth", "rms error"),
        rows,
        "The semidefinite constraint repairs the sign, not the value: k11 is cut off at zero or held just above it, is too large on "
        "average, and stays wrong by several times its size. Leaving it out altogether (M3) would be wrong by 100 %.",
    )


def claims_table(printed: SingleLinkStudy, stated: SingleLinkStudy) -> Table:
    """Single numbers of section 3.2 and of (25)."""
    both = (printed, stated)
    nine = printed.link.identifiable
    z = PRINTED_17.value[~NONZERO]

    def spread(unknowns: int) -> list[str]:
        found = [s.link.relative_sigma()[unknowns][nine[NONZERO]] for s in both]
        return [f"{_percent(r.min())} to {_percent(r.max())}" for r in found]

    rows: list[tuple[str, ...]] = [
        ("rank of the observation matrix", "36", *(str(s.link.rank) for s in both)),
        ("its condition number, plain SI", "1.00", *(f"{s.link.condition:.2f}" for s in both)),
        ("its condition number, weighted as in (12)", "-", *(f"{s.link.condition_weighted:.2f}" for s in both)),
        ("entries with ratio (18) above 5", "9", *(str(int(s.link.identifiable.sum())) for s in both)),
        ("least ratio of the nine", "more than 50", *(number(s.link.exact_ratio[nine].min()) for s in both)),
        ("seeds with the split 9 / 27 at ratio 5", "-", *(_percent(s.split_holds) for s in both)),
        ("seeds with all nine above 50", "-", *(_percent(s.paper_claim_holds) for s in both)),
        ("zero entries with ratio above 2", str(int((z > 2).sum())), *(number(s.zeros_above.mean()) for s in both)),
        ("errors of the nine, 36 unknowns", "0.01 % to 1.67 %", *(f"sigma {text}" for text in spread(0))),
        ("errors of the nine, M1 and M2", "most below 0.4 %", *(f"sigma {text}" for text in spread(2))),
        ("those above 0.4 % in one sigma", "-", *(_worse_than(s, 0.004) for s in both)),
        (
            "ratio of k11 at a hundredth of the noise",
            "no problem left",
            *(number(100 * s.link.exact_ratio[0, 0]) for s in both),
        ),
    ]
    return Table(
        "The text's numbers",
        ("what", "printed", "ours, noise as printed", "ours, noise as stated"),
        tuple(rows),
        f"Loads are {LOAD:g} N and {LOAD:g} N m. The noise as printed is {1e6 * printed.link.noise.position_m:g} um and "
        f"{1e3 * printed.link.noise.rotation_rad:g} mrad; as stated it is {1e6 * stated.link.noise.position_m:g} um and "
        f"{1e3 * stated.link.noise.rotation_rad:g} mrad. Sum of squares of the 26 zero entries of (17): {float(z @ z):.1f}, where pure noise "
        f"of width 1 gives {z.size} +- {np.sqrt(2 * z.size):.1f}.",
    )


def _worse_than(study: SingleLinkStudy, limit: float) -> str:
    """Which of the eight unknowns after M1 and M2, k11 aside, have a relative standard deviation above a limit."""
    upper = NONZERO & np.triu(np.ones((6, 6), dtype=bool))
    sigma = np.zeros((6, 6))
    sigma[NONZERO] = study.link.relative_sigma()[2]
    return ", ".join(name for name in names_of(upper & (sigma > limit)) if name != "k11") or "none"


def all_tables(shown: SingleLinkStudy, printed: SingleLinkStudy, stated: SingleLinkStudy) -> tuple[Table, ...]:
    """Every table; errors and the seed's own estimate are those of the noise that is shown."""
    return (
        ratio_table(printed.link, stated.link, shown.seed),
        estimate_table(shown.link, shown.seed),
        claims_table(printed, stated),
        physics_table((printed, stated)),
        k11_table(shown),
        error_table(shown),
        reconstruction_table(),
    )
