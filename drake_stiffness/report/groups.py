"""The report of `groups`: how many combinations are determined, which they are, and how well each is known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from drake_stiffness.base_parameters import relation
from drake_stiffness.groups_text import gap_line
from drake_stiffness.report import figures as f
from drake_stiffness.report import page as h

if TYPE_CHECKING:
    from drake_stiffness.groups import Groups
    from drake_stiffness.jobs import Identified

# Singular values on either side of the cut that the table shows.
_BESIDE = 4
# Below this nothing is drawn: rounding of sixteen digits.
_ROUNDING = 1e-18


def groups_report(result: Identified, groups: Groups) -> str:
    """The page of `groups --report`.

    Parameters
    ----------
    result : Identified
    groups : Groups
        Of the same, with eigen-directions in the units that were asked for.
    """
    from drake_stiffness.report.notes import provenance, warnings

    n = len(groups.names)
    return h.page(
        f"Groups of {result.campaign.measurements}",
        f"{n} parameters of cell {result.campaign.cell}: what these readings determine.",
        h.verdict(answer(groups)),
        warnings(result),
        h.section("How many combinations the readings determine", gap_line(groups), *gap_parts(groups)),
        h.section("What is not seen (G2)", _unseen(groups)),
        h.section("What merges (G3)", *relation_parts(groups)),
        h.section("Base parameters", base_table(groups)),
        h.section("Eigen-directions", *_direction_parts(groups)),
        h.section("Pairs that are hardly told apart", *_pair_parts(groups)),
        provenance(result.model.provenance, result.model.fit, level=2),
        footer=f"Made by {result.model.provenance.get('program', 'drake-stiffness')}.",
    )


def answer(groups: Groups) -> str:
    """The verdict in plain sentences."""
    rank, n = groups.view.algebraic_rank, len(groups.names)
    count = {name: groups.group.count(name) for name in ("G1+", "G1~", "G1-")}
    blind, merged = len(groups.unseen), n - len(groups.unseen) - rank
    rest = [f"{blind} parameters are not seen at all" if blind else "", f"{merged} merge into others" if merged else ""]
    left = " and ".join(part for part in rest if part)
    return (
        f"Of {n} parameters {rank} combinations are determined by the loads, postures and points of this campaign. With its noise {count['G1+']} of them "
        f"are known well (ratio above {groups.upper:g}), {count['G1~']} barely (between {groups.lower:g} and {groups.upper:g}), {count['G1-']} not (below). "
        f"{left[:1].upper()}{left[1:]}{'.' if left else ''}"
    ).strip()


def gap_parts(groups: Groups) -> list[h.Markup]:
    """The singular values as a picture and, near the cut, as a table."""
    s, rank = groups.view.singular, groups.view.algebraic_rank
    if not s.size:
        return []
    caption = (
        "Singular values of the observation matrix, its columns brought to unit length. What stands left of the cut is determined; what stands "
        "right of it is rounding of zero."
    )
    rows = [
        (str(k + 1), f"{s[k]:.3e}", "determined" if k < rank else "zero but for rounding")
        for k in range(max(rank - _BESIDE, 0), min(rank + _BESIDE, s.size))
    ]
    picture = h.figure(singular_figure(s, rank), caption, "Singular values with the cut", width=80)
    return [picture, h.table(("number", "singular value", ""), rows, align="rrl")]


def singular_figure(singular: np.ndarray, rank: int) -> str:
    """Singular values on a logarithmic axis with the cut, as a data URI."""
    made, ax = f.new(3.4, width=8.0)
    number = np.arange(1, singular.size + 1)
    values = np.maximum(singular, _ROUNDING)
    ax.semilogy(number[:rank], values[:rank], "o", color=f.BLUE, markersize=4.5, label="determined")
    if rank < singular.size:
        ax.semilogy(number[rank:], values[rank:], "s", color=f.GREY, markersize=4, label="zero but for rounding")
        ax.axvline(rank + 0.5, color=f.ORANGE, linewidth=1.3)
    ax.set_xlabel("number")
    ax.set_ylabel("singular value of unit columns")
    f.legend(ax)
    return f.uri(made)


def _unseen(groups: Groups) -> h.Markup:
    if not groups.unseen:
        return h.paragraph("Every parameter moves some reading.")
    return h.paragraph("No reading depends on ", ", ".join(groups.unseen), ".")


def relation_parts(groups: Groups) -> list[h.Markup]:
    """Every subgroup as the sum that is determined."""
    rows = [(groups.names[i], combination) for i, combination in groups.sums()]
    if not rows:
        return [h.paragraph("Nothing merges: every parameter that is seen is determined by itself.")]
    caption = "The readings determine each sum, not its members: one of them can be known if the rest are given. Coefficients in SI."
    return [h.table(("base parameter", "merges into the sum"), rows, caption=caption)]


def base_table(groups: Groups, *, relations: bool = False) -> h.Markup:
    """Base parameters with value, sigma, ratio, bar and group; with their sums where those stand nowhere else."""
    v, L, rows = groups.values, groups.matrix, []
    for k, i in enumerate(groups.found.base.tolist()):
        name = relation(groups.names, L[k], i, most=5) if relations else groups.names[i]
        cells = (
            h.number(v.least_squares[k]), h.number(v.model[k]), h.number(v.sigma[k], 2), groups.units[i], h.number(groups.ratio[k], 2),
        )  # fmt: skip
        group = f"{groups.group[k]}, hidden by noise" if v.hidden[k] else groups.group[k]
        rows.append((name, *cells, h.bar(groups.ratio[k] / 20), group))
    caption = (
        "A base parameter stands for its whole sum. Value and sigma by least squares without constraint; beside it the value in the model. "
        f"Ratio = |value| / sigma: G1+ above {groups.upper:g}, G1- below {groups.lower:g}. The bar is full at 20."
    )
    header = ("base parameter", "value", "in the model", "sigma", "unit", "ratio", "", "group")
    return h.table(header, rows, caption=caption, align="lrrrlrll")


def _direction_parts(groups: Groups) -> list[h.Markup]:
    d = groups.directions
    rows = [
        (
            h.number(d.ratio[k], 2),
            d.group[k],
            ", ".join(f"{c:+.2f} {name}" for name, c in d.named(k, groups.base_names).items()),
        )
        for k in range(d.ratio.size)
    ]
    text = (
        "Combinations of base parameters that are estimated independently of each other, best known first. Ratios of single parameters "
        "hide that a sum may be known well though its members are not; these do not. Parts below 0.2 are left out."
    )
    return [h.paragraph(text), h.table(("ratio", "group", "parts"), rows, align="rll")]


def _pair_parts(groups: Groups) -> list[h.Markup]:
    meaning = {
        "sum known": "known together only",
        "cancelling": "undo each other: doubtful",
        "correlated": "",
    }
    if not groups.pairs:
        return [h.paragraph("No two estimates correlate by more than 0.9.")]
    rows = [
        (
            f"{groups.base_names[p.first]}, {groups.base_names[p.second]}", f"{p.correlation:.3f}", f"{p.ratios[0]:.2g}, {p.ratios[1]:.2g}",
            groups.combination(p), h.number(p.known_ratio, 2), meaning[p.says],
        )
        for p in groups.pairs
    ]  # fmt: skip
    header = ("pair", "correlation", "ratios", "best known combination", "its ratio", "")
    return [h.table(header, rows, align="lrrlrl")]
