"""The report of `single-link`: the paper's example (3.2), our numbers beside the printed ones."""

from __future__ import annotations

import numpy as np

import drake_stiffness
from drake_stiffness.report import figures as f
from drake_stiffness.report import page as h
from drake_stiffness.report.single_link_tables import Table
from drake_stiffness.single_link.prints import NONZERO, names_of
from drake_stiffness.single_link.study import METHODS, SingleLinkStudy
from drake_stiffness.thresholds import UPPER_RATIO


def single_link_report(study: SingleLinkStudy, tables: tuple[Table, ...]) -> str:
    """The page of `single-link --report`: a self-contained HTML page.

    Parameters
    ----------
    study : SingleLinkStudy
        Under the noise that is shown.
    tables : tuple of Table
        From `single_link_tables.all_tables`.
    """
    link = study.link
    nine = ", ".join(names_of(link.identifiable))
    answer = (
        f"With noise as {link.noise.name} ({1e6 * link.noise.position_m:g} um, {1e3 * link.noise.rotation_rad:g} mrad) {link.identifiable.sum()} of 36 "
        f"entries have a ratio of value to standard deviation above {UPPER_RATIO:g} ({nine}). k11 has not: it comes out negative in "
        f"{100 * study.k11_negative[0]:.0f} % of {study.seeds} seeds. The estimate is not positive definite in {100 * study.not_definite[0]:.0f} % of them with "
        f"36 unknowns, and still in {100 * study.not_definite[2]:.0f} % after M1 and M2."
    )
    return h.page(
        "The single-link example",
        "Section 3.2 of Klimchik, Caro, Pashkevich (IMECE 2013): six unit loads on one link, 36 compliances.",
        h.verdict(answer),
        h.section("Errors", h.figure(single_link_figure(study), caption(study), "Errors by entry; estimates of k11")),
        *(
            h.section(t.title, h.table(t.header, t.rows, align="l" * len(t.header)), h.paragraph(t.note))
            for t in tables
        ),
        footer=f"Made by drake-stiffness {drake_stiffness.__version__}; seeds {study.seed} to {study.seed + study.seeds - 1}.",
    )


def caption(study: SingleLinkStudy) -> str:
    """What to see in the figure."""
    return (
        f"Left: root mean square error of the ten nonzero entries over {study.seeds} seeds. M1 brings k53 and k62 down to their twins and "
        "changes nothing else; the semidefinite constraint changes k11 alone. Right: the estimates of k11, whose standard deviation is "
        f"{1 / study.link.exact_ratio[0, 0]:.1f} times its value. The constraint cuts off what is negative, and says nothing of the value."
    )


def single_link_figure(study: SingleLinkStudy) -> str:
    """Errors by entry and the estimates of k11, as a data URI."""
    made, (left, right) = f.new(4.0, 1, 2, width=10.5, width_ratios=[1.7, 1.0])
    names, x = names_of(NONZERO), np.arange(int(NONZERO.sum()))
    shown = ((0, f.GREY, "o", -0.15), (2, f.BLUE, "s", 0.0), (3, f.ORANGE, "D", 0.15))
    for method, colour, mark, shift in shown:
        error = 100 * study.rms_relative_error[method]
        left.scatter(x + shift, error, color=colour, marker=mark, s=34, label=METHODS[method], linewidths=0)
    left.set_yscale("log")
    f.log_axis(left.yaxis)
    left.set_xticks(x, names)
    left.set_ylabel("rms error of the entry, %")
    f.legend(left)
    least, constrained = 1e7 * study.matrices[2, :, 0, 0], 1e7 * study.matrices[3, :, 0, 0]
    reach = float(np.percentile(np.abs(least), 99.5))
    edges = np.linspace(-reach, reach, 41)
    for values, colour, label in ((least, f.BLUE, METHODS[2]), (constrained, f.ORANGE, METHODS[3])):
        count, _ = np.histogram(values, edges)
        right.stairs(
            count, edges, fill=colour == f.BLUE, color=colour, alpha=0.45 if colour == f.BLUE else 1.0, label=label
        )
    right.axvline(1e7 * study.link.truth[0, 0], color=f.INK, linewidth=1.3, linestyle="--", label="true value")
    right.set_xlabel("estimate of k11, 1e-7 m/N")
    right.set_ylabel("seeds")
    f.legend(right, ncols=1, loc="upper left", bbox_to_anchor=(0.0, 1.0), fontsize=8.5)
    return f.uri(made)
