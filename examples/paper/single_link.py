"""The source paper's single-link example (3.2): truth, six loads, fit, figure.

    python examples/paper/single_link.py [FOLDER]

writes `single_link.svg` and `single_link.md` (the tables of docs/paper_single_link.md) to FOLDER, `out/paper` unless given.
"""

from __future__ import annotations

import base64
import sys
from pathlib import Path

from drake_stiffness.files import write_whole
from drake_stiffness.report.single_link import single_link_figure
from drake_stiffness.report.single_link_tables import all_tables
from drake_stiffness.single_link.example import is_definite, noise_setting, single_link
from drake_stiffness.single_link.study import semidefinite_fits, study_single_link


def one_fit() -> None:
    """Truth, readings, estimate and what is wrong with it, for one seed."""
    link = single_link(noise_setting("printed"))
    readings = link.readings(seed=5)
    for name, fit in zip(("36 unknowns", "M1", "M1 and M2"), link.fits, strict=True):
        k = fit.matrices(readings)
        error = 100 * abs(k[4, 2] / link.truth[4, 2] - 1)
        print(
            f"{name:12} k11 {1e9 * k[0, 0]:+6.1f} nm/N, k53 off by {error:.2f} %, positive definite: {is_definite(k)}"
        )
    k = semidefinite_fits(link, "beam", readings[None])[0]
    print(f"semidefinite k11 {1e9 * k[0, 0]:+6.1f} nm/N; true {1e9 * link.truth[0, 0]:+.1f} nm/N")


def main(folder: Path) -> None:
    """One fit, then a thousand, and the files."""
    one_fit()
    printed, stated = (study_single_link(single_link(noise_setting(name))) for name in ("printed", "stated"))
    for study in (printed, stated):
        share = ", ".join(f"{value:.3f}" for value in study.not_definite[:3])
        error = 100 * study.rms_relative_error[0, 0]
        print(f"noise as {study.link.noise.name}: not positive definite in {share}; k11 wrong by {error:.0f} %")
    folder.mkdir(parents=True, exist_ok=True)
    tables = all_tables(printed, printed, stated)
    write_whole(folder / "single_link.md", "\n".join(f"### {t.title}\n\n{t.markdown()}\n{t.note}\n" for t in tables))
    write_whole(folder / "single_link.svg", base64.b64decode(single_link_figure(printed).split(",", 1)[1]))
    print(f"written: {folder / 'single_link.md'}, {folder / 'single_link.svg'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out/paper"))
