"""What `groups` prints, and the short part of it that `identify` prints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:
    from drake_stiffness.groups import Groups

# So many directions from the weak end are shown.
_DIRECTIONS = 12


def show_groups(console: Console, groups: Groups, warnings: list[str]) -> None:
    """Gap, what is not seen, relations, base parameters, the weakest directions, warnings."""
    console.print(gap_line(groups), markup=False)
    if groups.unseen:
        console.print(f"G2, no reading depends on: {', '.join(groups.unseen)}.", markup=False)
    relations = groups.relations()
    if relations:
        console.print(
            f"\nG3, {len(relations)} subgroups; each combination is determined, its members are not:", markup=False
        )
        for sentence, combination in relations:
            console.print(f"  {sentence}:\n    {combination}", markup=False)
    console.print(base_table(groups))
    table = Table(title="Eigen-directions of the information, the least known last")
    for name in ("ratio", "group", "parts"):
        table.add_column(name, justify="right" if name == "ratio" else "left")
    d = groups.directions
    for k in range(max(d.ratio.size - _DIRECTIONS, 0), d.ratio.size):
        parts = ", ".join(f"{c:+.2f} {name}" for name, c in d.named(k, groups.base_names).items())
        table.add_row(f"{d.ratio[k]:.2g}", d.group[k], parts)
    console.print(table)
    for line in warnings:
        console.print(f"! {line}", markup=False)


def gap_line(groups: Groups) -> str:
    """The rank and the drop behind it, in a sentence."""
    view = groups.view
    rank, n = view.algebraic_rank, len(groups.names)
    if not rank:
        return f"Rank 0 of {n}: no reading depends on any parameter."
    last = f"singular value {rank} of the unit columns is {view.singular[rank - 1]:.2e}"
    if rank >= view.singular.size:
        return f"Rank {rank} of {n} parameters, full for what is seen at all; {last}."
    return f"Rank {rank} of {n} parameters: {last}, the next {view.singular[rank]:.1e} (gap {view.gap:.1e})."


def base_table(groups: Groups, most: int | None = None) -> Table:
    """Base parameters with value, sigma, ratio and group; what merges into them is counted."""
    table = Table(
        title=f"{len(groups.group)} base parameters; (+n): n others merge into it (G1+ above ratio {groups.upper:g}, G1- below {groups.lower:g})"
    )
    for name in ("base parameter", "value", "sigma", "unit", "ratio", "group"):
        table.add_column(name, justify="right" if name in ("value", "sigma", "ratio") else "left")
    v, rows = groups.values, groups.matrix
    for k, i in list(enumerate(groups.found.base.tolist()))[:most]:
        partners = int(np.count_nonzero(rows[k])) - 1
        name = groups.names[i] + (f" (+{partners})" if partners else "")
        sigma = f"{v.sigma[k]:.2g}" if np.isfinite(v.sigma[k]) else "-"
        group = f"{groups.group[k]}{' (hidden)' if v.hidden[k] else ''}"
        table.add_row(name, f"{v.least_squares[k]:.4g}", sigma, groups.units[i], f"{groups.ratio[k]:.2g}", group)
    return table


def show_base(console: Console, groups: Groups, most: int) -> None:
    """The short form for `identify`: what parameters add up to where they cannot be told apart."""
    if not groups.relations():
        return
    console.print(base_table(groups, most))
    left = len(groups.group) - most
    more = f" ({left} more there)" if left > 0 else ""
    console.print(f"The sums behind them: `drake-stiffness groups`{more}.", markup=False)
