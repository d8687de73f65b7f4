"""Groups G1, G2, G3 of a campaign, for people and for programs: gap, relations, base parameters, eigen-directions (seed 4.1)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drake_stiffness.base_parameters import BaseMap, BaseValues, base_of, base_values, merges, relation
from drake_stiffness.eigen_directions import CollinearPair, EigenDirections, Per, collinear_pairs, eigen_directions
from drake_stiffness.identifiability import Identifiability, by_ratio, ratios
from drake_stiffness.identification import Solution
from drake_stiffness.model import Model, Statistics
from drake_stiffness.rotations import Array
from drake_stiffness.thresholds import LOWER_RATIO, UPPER_RATIO

# More pairs than this are not listed among the warnings.
_MOST_PAIRS = 3


@dataclass(frozen=True, eq=False)
class Groups:
    """What a campaign determines, and how well.

    Attributes
    ----------
    names, units : tuple of n
        Of all parameters.
    scales : (n,)
        Typical size of each, SI.
    view : Identifiability
    found : BaseMap
    values : BaseValues
    ratio : (r,)
        Seed eq. (20) of the base parameters.
    group : tuple of r of G1+ G1~ G1-
    directions : EigenDirections
    pairs : list of CollinearPair
    upper, lower : float
        Thresholds.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    scales: Array
    view: Identifiability
    found: BaseMap
    values: BaseValues
    ratio: Array
    group: tuple[str, ...]
    directions: EigenDirections
    pairs: list[CollinearPair]
    upper: float
    lower: float

    @property
    def matrix(self) -> Array:
        """The map from all parameters to the base ones, (r, n), SI."""
        return self.found.si(self.scales)

    @property
    def base_names(self) -> tuple[str, ...]:
        return tuple(self.names[i] for i in self.found.base)

    @property
    def unseen(self) -> tuple[str, ...]:
        """G2: no reading depends on these."""
        return tuple(name for name, zero in zip(self.names, self.view.zero, strict=True) if zero)

    def per(self, per: Per) -> Groups:
        """The same with eigen-directions in other units (see `eigen_directions`)."""
        v, unit = self.values, self.scales[self.found.base]
        directions = eigen_directions(
            v.least_squares, v.covariance, unit, per, usable=np.isfinite(v.sigma), upper=self.upper, lower=self.lower
        )
        return replace(self, directions=directions)

    def sums(self) -> list[tuple[int, str]]:
        """Every subgroup of G3: the base parameter and the combination that is determined, in words."""
        rows = zip(self.found.base.tolist(), self.matrix, strict=True)
        return [(i, relation(self.names, row, i)) for i, row in rows if np.count_nonzero(row) > 1]

    def relations(self) -> list[tuple[str, str]]:
        """The same with a sentence: `joint_2 merges with link_1.k55 and link_2.k55` and the combination."""
        row = dict(zip(self.found.base.tolist(), self.matrix, strict=True))
        return [(merges(self.names, row[i], i), combination) for i, combination in self.sums()]

    def hidden_directions(self) -> list[dict[str, float]]:
        """Directions that the noise hides, by the parameters that take part (units of scale)."""
        return [_parts(v, self.names) for v in np.hstack([self.view.hidden, self.view.faint]).T]

    def combination(self, pair: CollinearPair) -> str:
        """What is known best of two base parameters, in SI: `joint_4 + 1.02 joint_6`."""
        a, b = int(self.found.base[pair.first]), int(self.found.base[pair.second])
        c = pair.known_parts[1] / self.scales[b] / (pair.known_parts[0] / self.scales[a])
        return f"{self.names[a]} {'-' if c < 0 else '+'} {abs(c):.3g} {self.names[b]}"

    def warnings(self) -> list[str]:
        """Pairs that marginal ratios mislead about, and what the noise hides."""
        lines = []
        for pair in self.pairs:
            a, b = self.base_names[pair.first], self.base_names[pair.second]
            r, s = pair.ratios
            if pair.says == "sum known":
                lines.append(
                    f"COLLINEAR: estimates of {a} and {b} are hardly told apart (correlation {pair.correlation:.3f}): their ratios are {r:.2g} and {s:.2g}, "
                    f"that of {self.combination(pair)} is {pair.known_ratio:.3g}."
                )
            elif pair.says == "cancelling":
                lines.append(
                    f"COLLINEAR: estimates of {a} and {b} undo each other (correlation {pair.correlation:.3f}): their ratios are {r:.2g} and {s:.2g}, but "
                    f"{self.combination(pair)}, which the readings see best, has only {pair.known_ratio:.2g}."
                )
        if len(lines) > _MOST_PAIRS:
            lines[_MOST_PAIRS:] = [
                f"COLLINEAR: {len(lines) - _MOST_PAIRS} more pairs are like that; the command `groups` lists them."
            ]
        hidden = [" with ".join(parts) for parts in self.hidden_directions()]
        if hidden:
            lines.append(
                f"HIDDEN: the noise hides {', '.join(hidden)}: not even twenty times a typical size would show; what stands there is no "
                "estimate."
            )
        return lines

    def to_dict(self) -> dict[str, Any]:
        """The content of `groups --json`."""
        L = self.matrix
        return {
            "rank": self.view.algebraic_rank,
            "unknowns": len(self.names),
            "singular_values": self.view.singular,
            "singular_gap": self.view.gap if np.isfinite(self.view.gap) else None,
            "thresholds": {"upper": self.upper, "lower": self.lower},
            "G2": list(self.unseen),
            "subgroups": [
                {
                    "base": self.names[i],
                    "members": [self.names[i], *(self.names[j] for j in np.flatnonzero(row) if j != i)],
                    "relation": relation(self.names, row, i),
                    "sentence": merges(self.names, row, i),
                }
                for i, row in zip(self.found.base.tolist(), L, strict=True)
                if np.count_nonzero(row) > 1
            ],
            "base": [self._base_entry(k, row) for k, row in enumerate(L)],
            "map": {"base": list(self.base_names), "parameters": list(self.names), "matrix": L},
            "eigen_directions": [
                {
                    "ratio": self.directions.ratio[k],
                    "group": self.directions.group[k],
                    "parts": self.directions.named(k, self.base_names),
                }
                for k in range(self.directions.ratio.size)
            ],
            "collinear": [self._pair_entry(pair) for pair in self.pairs],
            "hidden_by_noise": self.hidden_directions(),
        }

    def _base_entry(self, k: int, row: Array) -> dict[str, Any]:
        i, v = int(self.found.base[k]), self.values
        known = bool(np.isfinite(v.sigma[k]))
        return {
            "name": self.names[i],
            "combination": {self.names[j]: row[j] for j in np.flatnonzero(row).tolist()},
            "value": v.least_squares[k],
            "model_value": v.model[k],
            "unit": self.units[i],
            "sigma": v.sigma[k] if known else None,
            "ratio": self.ratio[k] if known else None,
            "group": self.group[k],
            "hidden_by_noise": bool(v.hidden[k]),
        }

    def _pair_entry(self, pair: CollinearPair) -> dict[str, Any]:
        names = [self.base_names[pair.first], self.base_names[pair.second]]
        return {
            "parameters": names,
            "correlation": pair.correlation,
            "ratios": list(pair.ratios),
            "combination": dict(zip(names, pair.known_parts, strict=True)),
            "combination_ratio": pair.known_ratio,
            "other_ratio": pair.other_ratio,
            "says": pair.says,
        }


def find_groups(
    solution: Solution, statistics: Statistics, *, upper: float = UPPER_RATIO, lower: float = LOWER_RATIO
) -> Groups:
    """Groups of what was identified, from its observation matrix and covariance.

    Parameters
    ----------
    upper, lower : float
        Thresholds of the ratio (20).
    """
    model: Model = solution.model
    view = solution.identifiability
    found = base_of(view, model)
    values = base_values(solution, found, statistics.covariance)
    x, cov, unit = values.least_squares, values.covariance, model.scales[found.base]
    group = np.where(values.hidden, "G1-", by_ratio(x, values.sigma, upper=upper, lower=lower))
    return Groups(
        names=model.names,
        units=tuple(parameter.unit for parameter in model.parameters),
        scales=model.scales,
        view=view,
        found=found,
        values=values,
        ratio=ratios(x, values.sigma),
        group=tuple(str(g) for g in group),
        directions=eigen_directions(x, cov, unit, usable=np.isfinite(values.sigma), upper=upper, lower=lower),
        pairs=collinear_pairs(x, cov, unit, values.hidden, upper=upper, lower=lower),
        upper=upper,
        lower=lower,
    )


def _parts(direction: Array, names: tuple[str, ...]) -> dict[str, float]:
    """The larger parts of a direction, largest first."""
    order = np.argsort(-np.abs(direction), kind="stable")
    return {names[i]: float(direction[i]) for i in order.tolist() if abs(direction[i]) > 0.2}
