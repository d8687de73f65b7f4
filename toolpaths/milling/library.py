"""Published coefficients of linear-edge forces, by name; each names its source.

Sets for one alloy differ by a factor of two and more, because tool, edge and lubrication differ: a set from a book says the order of
a force, a cutting test says the force. `RELATIVE_SIGMA` is the spread that is assumed where nobody states one.
"""

from __future__ import annotations

from dataclasses import dataclass

# The forces that the three sets for Al 7075 give for one slot differ with this relative standard deviation, rounded (tests compute it).
RELATIVE_SIGMA = 0.3

_REVIEW = (
    "Milling Force Model for Aviation Aluminum Alloy: Academic Insight and Perspective Analysis, Chinese Journal of Mechanical "
    "Engineering 34 (2021), doi 10.1186/s10033-021-00536-9, table 5, its reference"
)


@dataclass(frozen=True)
class PublishedSet:
    """Attributes
    ----------
    cutting : K_tc, K_rc, K_ac in N/mm^2
    edge : K_te, K_re, K_ae in N/mm
    tool, source : what was cut with, and who says so
    """

    cutting: tuple[float, float, float]
    edge: tuple[float, float, float]
    tool: str
    source: str


LIBRARY = {
    "Al7075-T6": PublishedSet((767.01, 168.8, 222.0), (27.7, 26.6, 0.7), "carbide, dry", f"{_REVIEW} [190]"),
    "Al7075-HSS": PublishedSet(
        (951.365, 262.597, 323.33), (11.115, 11.314, 1.105), "high-speed steel, dry", f"{_REVIEW} [156]"
    ),
    "Al7075": PublishedSet((1319.41, 788.83, 48.75), (19.65, 26.77, 2.05), "carbide, dry", f"{_REVIEW} [47]"),
    "Al6082-T6": PublishedSet((631.0, 99.0, 273.0), (13.0, 10.0, 2.8), "carbide, dry", f"{_REVIEW} [189]"),
}
