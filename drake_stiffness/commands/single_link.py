"""`drake-stiffness single-link`: the source paper's example, our numbers beside the printed ones."""

from __future__ import annotations

from typing import Annotated

import typer

from drake_stiffness.commands.console import JsonOption, ReportOption, check_outputs, console, json_of, working, write
from drake_stiffness.errors import InputError


def single_link(
    noise: Annotated[
        str, typer.Option(help="printed (what the printed ratios need) or stated (in the text)")
    ] = "printed",
    seeds: Annotated[int, typer.Option(min=1, max=100_000, help="How many draws of noise")] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="The first of them")] = 0,
    json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Repeat the source paper's single-link example (3.2): six unit loads, 36 compliances, noise."""
    from rich.table import Table

    from drake_stiffness.report.single_link_tables import all_tables
    from drake_stiffness.single_link.example import noise_setting, single_link
    from drake_stiffness.single_link.study import study_single_link

    if noise not in ("printed", "stated"):
        raise InputError(f"--noise: found '{noise}'; expected printed or stated.")
    check_outputs(json, report)
    with working() as progress:
        progress(f"{seeds} seeds, noise as printed")
        printed = study_single_link(single_link(noise_setting("printed")), seeds, seed)
        progress(f"{seeds} seeds, noise as stated")
        stated = study_single_link(single_link(noise_setting("stated")), seeds, seed)
    shown = printed if noise == "printed" else stated
    tables = all_tables(shown, printed, stated)
    page = None
    if report is not None:
        from drake_stiffness.report.single_link import single_link_report

        page = single_link_report(shown, tables)
    write((json, json_of(shown.to_dict())), (report, page))
    out = console()
    for content in tables:
        table = Table(*content.header, title=content.title)
        for row in content.rows:
            table.add_row(*row)
        out.print(table)
        out.print(content.note, markup=False)
