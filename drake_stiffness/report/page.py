"""One self-contained HTML page: skeleton, sections, tables, call-outs, figures. Everything that is no `Markup` is escaped."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

UNKNOWN = "–"

_STYLE = """
:root { --ink: #1b1f24; --soft: #59636e; --line: #d5dbe1; --tint: #f4f6f8; --accent: #0b5c94; --warn: #b54708; }
* { box-sizing: border-box; }
body { margin: 0; background: #fff; color: var(--ink); font: 16px/1.5 system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial,
  sans-serif; }
main { max-width: 1080px; margin: 0 auto; padding: 28px 24px 60px; }
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0 0 2px; overflow-wrap: anywhere; }
h2 { font-size: 1.3rem; margin: 44px 0 8px; padding-top: 12px; border-top: 2px solid var(--line); }
h3 { font-size: 1.08rem; margin: 28px 0 6px; }
h4 { font-size: 1rem; margin: 22px 0 4px; }
p, ul { max-width: 78ch; margin: 8px 0; }
.subtitle { color: var(--soft); margin: 0 0 14px; overflow-wrap: anywhere; }
.verdict { font-size: 1.12rem; line-height: 1.5; background: var(--tint); border-left: 5px solid var(--accent); padding: 12px 18px;
  margin: 14px 0; max-width: none; }
.callout { border-left: 5px solid var(--warn); background: #fff6ec; padding: 9px 16px; margin: 10px 0; max-width: none;
  overflow-wrap: anywhere; }
.callout strong { color: var(--warn); }
.callout small { display: block; color: var(--soft); font-size: .86rem; margin-top: 3px; }
.tiles { display: flex; flex-wrap: wrap; gap: 10px; margin: 16px 0; }
.tile { flex: 1 1 150px; border: 1px solid var(--line); border-radius: 6px; padding: 9px 13px; }
.tile b { display: block; font-size: 1.38rem; line-height: 1.25; font-variant-numeric: tabular-nums; }
.tile span { color: var(--soft); font-size: .86rem; }
figure { margin: 16px 0; }
figure img { display: block; width: 100%; height: auto; }
figcaption { color: var(--soft); font-size: .93rem; max-width: 92ch; margin-top: 4px; }
.scroll { overflow-x: auto; margin: 10px 0 4px; }
table { border-collapse: collapse; font-size: .92rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; color: var(--soft); padding: 4px 0; caption-side: top; font-size: .93rem; }
th, td { padding: 3px 11px; border-bottom: 1px solid var(--line); vertical-align: top; text-align: left; white-space: nowrap; }
td:last-child { white-space: normal; overflow-wrap: anywhere; min-width: 9ch; }
th { background: var(--tint); font-weight: 600; vertical-align: bottom; }
.right { text-align: right; } .center { text-align: center; } .soft { color: var(--soft); }
.bar { display: inline-block; width: 92px; height: 11px; background: #e7ebef; vertical-align: middle; }
.bar i { display: block; height: 11px; background: var(--accent); }
.matrices td { white-space: nowrap; min-width: 0; } .matrices { display: flex; flex-wrap: wrap; gap: 8px 26px; }
.matrices table { font-size: .8rem; } .matrices td, .matrices th { padding: 2px 6px; }
.mono { font-family: ui-monospace, Menlo, Consolas, monospace; font-size: .85em; overflow-wrap: anywhere; }
footer { margin-top: 44px; border-top: 1px solid var(--line); padding-top: 8px; color: var(--soft); font-size: .86rem; }
@media print {
  body { font-size: 10.5pt; } main { max-width: none; padding: 0; }
  figure, .tile, .callout, .verdict, tr { break-inside: avoid; } h2, h3, h4 { break-after: avoid; }
  .bar, .bar i, td, th, .callout, .verdict { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
"""


class Markup(str):
    """Text that is HTML already; plain `str` is escaped wherever it enters a page."""

    __slots__ = ()


def html(text: object) -> Markup:
    """HTML of a text: itself if it is `Markup`, else escaped."""
    return text if isinstance(text, Markup) else Markup(escape(str(text)))


def join(*parts: object) -> Markup:
    """Parts one after another."""
    return Markup("".join(html(part) for part in parts))


def number(value: float | None, digits: int = 3) -> str:
    """A number with so many significant digits; a dash where there is none.

    Parameters
    ----------
    value : float or None
        NaN and infinities count as none.
    digits : int
        Significant digits.
    """
    if value is None or not math.isfinite(value):
        return UNKNOWN
    if value == 0:
        return "0"
    rounded = float(f"{value:.{digits - 1}e}")
    exponent = math.floor(math.log10(abs(rounded)))
    if exponent < -4 or exponent > 6:
        mantissa, power = f"{rounded:.{digits - 1}e}".split("e")
        return f"{mantissa}e{int(power)}"
    return f"{rounded:.{max(digits - 1 - exponent, 0)}f}"


def length(mm: float | None, digits: int = 3) -> str:
    """A length for a sentence: millimetres, below a hundredth of one micrometres."""
    if mm is None or not math.isfinite(mm):
        return "not known"
    if mm == 0 or abs(mm) >= 0.01:
        return f"{number(mm, digits)} mm"
    return f"{number(1e3 * mm, min(digits, 2))} µm"


def paragraph(*text: object) -> Markup:
    """A paragraph."""
    return join(Markup("<p>"), *text, Markup("</p>"))


def bullets(items: Iterable[object]) -> Markup:
    """A list."""
    return join(Markup("<ul>"), *(join(Markup("<li>"), item, Markup("</li>")) for item in items), Markup("</ul>"))


def verdict(text: object) -> Markup:
    """The answer, before everything else."""
    return join(Markup('<p class="verdict">'), text, Markup("</p>"))


def callout(head: object, text: object, what_it_means: object = "") -> Markup:
    """Something that must not be overlooked, and a smaller line on what it means."""
    small = join(Markup("<small>"), what_it_means, Markup("</small>")) if what_it_means else Markup("")
    return join(Markup('<div class="callout"><strong>'), head, Markup("</strong> "), text, small, Markup("</div>"))


def tiles(pairs: Iterable[tuple[object, object]]) -> Markup:
    """Key figures side by side: (figure with its unit, what it is)."""
    cells = (
        join(Markup('<div class="tile"><b>'), b, Markup("</b><span>"), s, Markup("</span></div>")) for b, s in pairs
    )
    return join(Markup('<div class="tiles">'), *cells, Markup("</div>"))


def table(
    header: Sequence[object],
    rows: Iterable[Sequence[object]],
    *,
    caption: object = "",
    align: str = "",
) -> Markup:
    """A table.

    Parameters
    ----------
    header : sequence of cells
    rows : iterable of sequences of cells
    caption : text
    align : a letter for every column: l(eft), r(ight) or c(entre); default left
    """
    align = align or "l" * len(header)

    def row(tag: str, cells: Sequence[object]) -> Markup:
        parts = []
        for cell, side in zip(cells, align, strict=True):
            mark = {"l": "", "r": ' class="right"', "c": ' class="center"'}[side]
            parts.append(join(Markup(f"<{tag}{mark}>"), cell, Markup(f"</{tag}>")))
        return join(Markup("<tr>"), *parts, Markup("</tr>\n"))

    title = join(Markup("<caption>"), caption, Markup("</caption>")) if caption else Markup("")
    return join(
        Markup('<div class="scroll"><table>'),
        title,
        Markup("<thead>"),
        row("th", header),
        Markup("</thead><tbody>"),
        *(row("td", cells) for cells in rows),
        Markup("</tbody></table></div>"),
    )


def bar(share: float) -> Markup:
    """A small horizontal bar filled to a share of 0 .. 1."""
    filled = 100 * min(max(share, 0.0), 1.0) if math.isfinite(share) else 0.0
    return Markup(f'<span class="bar"><i style="width:{filled:.0f}%"></i></span>')


def figure(source: str, caption: object, alt: str, *, width: int = 100) -> Markup:
    """A picture from a data URI, with a caption that says what to see; width in percent of the page."""
    size = "" if width == 100 else f' style="width:{width}%"'
    head = Markup(f'<figure><img src="{escape(source)}" alt="{escape(alt)}"{size}>')
    return join(head, Markup("<figcaption>"), caption, Markup("</figcaption></figure>\n"))


def section(title: object, *content: object, level: int = 2) -> Markup:
    """A heading and what stands under it."""
    level = min(max(level, 2), 4)
    return join(Markup(f"<section><h{level}>"), title, Markup(f"</h{level}>\n"), *content, Markup("</section>\n"))


def page(title: str, subtitle: object, *content: object, footer: object = "") -> str:
    """The whole page as text; it asks nothing of any other file or server.

    Parameters
    ----------
    title : str
    subtitle : text under the title
    content : sections
    footer : text
    """
    head = (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>\n<body><main>\n"
    )
    return join(
        Markup(head),
        Markup("<h1>"), title, Markup('</h1>\n<p class="subtitle">'), subtitle, Markup("</p>\n"),
        *content,
        Markup("<footer>"), footer, Markup("</footer>\n</main></body></html>\n"),
    )  # fmt: skip
