"""A model: an arm, reference points, and a list of effects with values and statistics; `model.json`.

A stored model is self-contained: it carries the constants read from Drake, so that it predicts and compensates where
neither Drake nor cvxpy is installed.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm
from drake_stiffness.cell import Cell
from drake_stiffness.effects import Effect, Parameter, make_effect
from drake_stiffness.effects.compliance import JointCompliance, LinkCompliance, Spring
from drake_stiffness.errors import InputError
from drake_stiffness.files import json_text, read_bytes, write_whole
from drake_stiffness.rotations import Array
from drake_stiffness.structure import Structure, build_structure

FORMAT = "drake-stiffness-model/1"


@dataclass(frozen=True, eq=False)
class Statistics:
    """How well the parameters of a model are known.

    Attributes
    ----------
    sigma : (n,)
        Standard deviation, NaN where a parameter by itself is not determined.
    group : tuple of n of G1+ G1~ G1- G2 G3
    merged_with : tuple of n tuples of names
        For G3: the parameters that it cannot be told from.
    covariance : (n, n)
        Of the identifiable combinations (pseudo-inverse of the information), SI.
    null_space : (n, n - rank)
        Directions the data do not see, orthonormal in units of the parameters' scales.
    shift : (n,) or None
        Least squares without constraints minus the model, along what is fitted, SI; zero where no constraint is active. None in
        models of versions that did not store it.
    """

    sigma: Array
    group: tuple[str, ...]
    merged_with: tuple[tuple[str, ...], ...]
    covariance: Array
    null_space: Array
    shift: Array | None = None


@dataclass(frozen=True, eq=False)
class Model:
    """An arm with effects.

    Attributes
    ----------
    cell : dict
        The content of the cell.yaml it was made from.
    arm : Arm
        Nominal constants.
    points : dict of name to (3,)
        Reference points in the flange frame, m.
    load_point : (3,)
    effects : tuple of Effect
    x : (n,)
        Values of all parameters, SI; effects own their slices.
    statistics : Statistics or None
    fit, provenance : dict
        As they stand in `model.json`.
    restored : tuple of dict
        What `restoration` filled in, as it stands in `model.json`; never evidence.
    """

    cell: dict[str, Any]
    arm: Arm
    points: dict[str, Array]
    load_point: Array
    effects: tuple[Effect, ...]
    x: Array
    statistics: Statistics | None = None
    fit: dict[str, Any] = field(default_factory=dict)
    provenance: dict[str, Any] = field(default_factory=dict)
    restored: tuple[dict[str, Any], ...] = ()

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Every effect's own part of the parameter vector."""
        ends = np.cumsum([0, *(len(effect.parameters) for effect in self.effects)]).tolist()
        return tuple(slice(a, b) for a, b in pairwise(ends))

    @property
    def values(self) -> list[Array]:
        """Values effect by effect."""
        return [self.x[own] for own in self.slices]

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(parameter for effect in self.effects for parameter in effect.parameters)

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(name for effect in self.effects for name in effect.names)

    @cached_property
    def scales(self) -> Array:
        return np.array([parameter.scale for parameter in self.parameters])

    @cached_property
    def structure(self) -> Structure:
        """The arm with its springs."""
        return build_structure(self.arm, self.effects, self.values)

    @cached_property
    def tcp(self) -> tuple[Array, Array]:
        """Rotation (3, 3) and position (3,) of the tool centre point in the flange frame."""
        from drake_stiffness.rotations import rpy_rotation

        tcp = self.cell["tool"]["tcp"]
        return rpy_rotation(np.radians(tcp["rpy_deg"])), np.array(tcp["position_m"], dtype=float)

    def point_positions(self, names: NDArray[np.str_]) -> Array:
        """(3, M) flange coordinates of named points."""
        unique, inverse = np.unique(names, return_inverse=True)
        return np.stack([self.points[str(name)] for name in unique], axis=1)[:, inverse.reshape(-1)]

    def with_x(self, x: Array) -> Model:
        """The same model with other values (statistics do not carry over)."""
        return replace(self, x=np.asarray(x, dtype=float), statistics=None, restored=())

    @property
    def without_links(self) -> Model:
        """The same model with rigid links: what a joints-only model would say, for comparison."""
        keep = [not isinstance(effect, LinkCompliance) for effect in self.effects]
        return self.subset(keep)

    def subset(self, keep: Sequence[bool]) -> Model:
        """The model with some of its effects only."""
        effects = tuple(effect for effect, k in zip(self.effects, keep, strict=True) if k)
        values = [x for x, k in zip(self.values, keep, strict=True) if k]
        x = np.concatenate([np.zeros(0), *values])
        return replace(self, effects=effects, x=x, statistics=None, restored=())

    # -- model.json ---------------------------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """The content of `model.json` (FORMATS: model.json)."""
        content: dict[str, Any] = {
            "format": FORMAT,
            "cell": self.cell,
            "arm": self.arm.to_dict(),
            "springs": [self._spring_entry(i) for i, e in enumerate(self.effects) if isinstance(e, Spring)],
            "parameters": [self._parameter_entry(i) for i in range(self.x.size)],
            "effects": [self._effect_entry(i) for i in range(len(self.effects))],
        }
        if self.statistics is not None:
            seen = [i for i, g in enumerate(self.statistics.group) if g != "G2"]
            content["covariance"] = {
                "parameters": [self.names[i] for i in seen],
                "matrix": self.statistics.covariance[np.ix_(seen, seen)],
            }
            content["not_identified"] = {
                "scales": self.scales,
                "directions": self.statistics.null_space.T,
            }
            if self.statistics.shift is not None:
                content["least_squares_shift"] = self.statistics.shift
        if self.restored:
            content["restored"] = list(self.restored)
        content["fit"] = self.fit
        content["provenance"] = self.provenance
        return content

    def _spring_entry(self, number: int) -> dict[str, Any]:
        effect = self.effects[number]
        assert isinstance(effect, Spring)
        joint = isinstance(effect, JointCompliance)
        name = effect.link_name() if isinstance(effect, LinkCompliance) else effect.where
        entry = {"name": name, "kind": "joint" if joint else "link", "compliance": effect.matrix(self.values[number])}
        if isinstance(effect, LinkCompliance):
            entry |= {"template": effect.template_name, "beam_axis": effect.beam_axis}
        return entry

    def _parameter_entry(self, i: int) -> dict[str, Any]:
        s = self.statistics
        sigma = float(s.sigma[i]) if s is not None else float("nan")
        known = np.isfinite(sigma)
        return {
            "name": self.names[i],
            "value": self.x[i],
            "unit": self.parameters[i].unit,
            "sigma": sigma if known else None,
            "ratio": abs(self.x[i]) / sigma if known and sigma > 0 else None,
            "group": s.group[i] if s is not None else None,
            "merged_with": list(s.merged_with[i]) if s is not None else [],
        }

    def _effect_entry(self, number: int) -> dict[str, Any]:
        effect, own = self.effects[number], self.slices[number]
        sigma = self.statistics.sigma[own] if self.statistics is not None else np.full(len(effect.parameters), np.nan)
        return {
            "kind": effect.kind,
            "where": effect.where,
            "settings": effect.settings(),
            "parameters": {
                p.name: {"value": v, "unit": p.unit, "sigma": s}
                for p, v, s in zip(effect.parameters, self.values[number], sigma, strict=True)
            },
            "evidence": {},
            "confounded_with": [],
        }

    def doubts(self) -> list[str]:
        """What identification already said against this model: a prediction repeats it."""
        grave = ("NOT TRUSTWORTHY", "NOT PHYSICAL", "NOISE REJECTED", "NOTHING SEEN")
        return [line for line in self.fit.get("warnings", []) if line.startswith(grave)]

    def impossible(self) -> str | None:
        """Why nothing must be machined by this model, or None: springs that push back, or none at all."""
        s = self.statistics
        for i, parameter in enumerate(self.parameters):
            sure = s is not None and s.group[i].startswith("G1") and self.x[i] < -3 * s.sigma[i]
            if parameter.lower == 0.0 and sure:
                return f"{self.names[i]} = {self.x[i]:.3g} {parameter.unit} is negative beyond doubt; no spring gives way against its load"
        springs = np.array([isinstance(e, Spring) for e in self.effects for _ in e.parameters], dtype=bool)
        if springs.any() and np.abs(self.x[springs] / self.scales[springs]).max() < 1e-6:
            return "all its compliances are zero: its campaign contradicts every spring, or loaded none"
        return None

    def save(self, path: Path | str) -> None:
        """Write `model.json`, whole or not at all."""
        write_whole(Path(path), json_text(self.to_dict()))


def load_model(path: Path | str) -> Model:
    """Read a `model.json`.

    Raises
    ------
    InputError
        If the file is missing, empty, truncated, or not a model of this format.
    """
    path = Path(path)
    data = read_bytes(path, "a model (model.json, written by `identify`)")
    try:
        content = json.loads(data)
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        place = f" at line {error.lineno}, column {error.colno}" if isinstance(error, json.JSONDecodeError) else ""
        raise InputError(
            f"{path}: not a whole JSON file{place} (truncated?); run `identify` again to make it."
        ) from None
    found = content.get("format") if isinstance(content, dict) else None
    if found != FORMAT:
        raise InputError(f"{path}: format is {found!r}; expected '{FORMAT}'. Is this a file that `identify` wrote?")
    try:
        return _from_dict(content)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise InputError(
            f"{path}: a part of the model is missing or malformed ({error}); run `identify` again."
        ) from None


def _from_dict(content: dict[str, Any]) -> Model:
    cell = Cell.model_validate(content["cell"]).model_dump(mode="json")
    effects, values = [], []
    for entry in content["effects"]:
        effect = make_effect(entry["kind"], entry["where"], entry.get("settings"))
        effects.append(effect)
        own = [entry["parameters"][p.name]["value"] for p in effect.parameters]
        if not all(isinstance(value, int | float) for value in own):
            raise ValueError(f"a value of {entry['kind']} at '{entry['where']}' is no number")
        values.append(np.array(own, dtype=float))
    model = Model(
        cell=cell,
        arm=Arm.from_dict(content["arm"]),
        points={name: np.array(p, dtype=float) for name, p in cell["reference_points_m"].items()},
        load_point=np.array(cell["load_point_m"], dtype=float),
        effects=tuple(effects),
        x=np.concatenate([np.zeros(0), *values]),
        fit=content["fit"],
        provenance=content["provenance"],
        restored=tuple(dict(entry) for entry in content.get("restored", [])),
    )
    if not np.isfinite(model.x).all():
        raise ValueError("effects: a parameter has no value")
    if not isinstance(model.fit, dict) or not isinstance(model.provenance, dict):
        raise ValueError("fit and provenance must be keys with values")
    for effect in model.effects:
        effect.check(model.arm, model.points)
    _check_blocks(content, model)
    if "covariance" not in content:
        return model
    n = model.x.size
    place = {name: i for i, name in enumerate(model.names)}
    covariance = np.zeros((n, n))
    seen = [place[name] for name in content["covariance"]["parameters"]]
    covariance[np.ix_(seen, seen)] = np.array(content["covariance"]["matrix"], dtype=float).reshape(
        len(seen), len(seen)
    )
    entries = content["parameters"]
    if not all(isinstance(entry["group"], str) for entry in entries):
        raise ValueError("parameters: a group is missing though there is a covariance")
    statistics = Statistics(
        sigma=np.array([np.nan if e["sigma"] is None else e["sigma"] for e in entries], dtype=float),
        group=tuple(e["group"] for e in entries),
        merged_with=tuple(tuple(e["merged_with"]) for e in entries),
        covariance=covariance,
        null_space=np.array(content["not_identified"]["directions"], dtype=float).reshape(-1, n).T,
        shift=_shift(content, n),
    )
    return replace(model, statistics=statistics)


def _shift(content: dict[str, Any], n: int) -> Array | None:
    """Least squares minus model; absent in files of earlier versions."""
    shift = np.array(content.get("least_squares_shift", []), dtype=float)
    if shift.shape not in ((0,), (n,)) or not np.isfinite(shift).all():
        raise ValueError("least_squares_shift must hold a number for every parameter")
    return shift if shift.size else None


def _check_blocks(content: dict[str, Any], model: Model) -> None:
    """Raise ValueError unless `springs` and `parameters` say the same as `effects`, from which values are taken."""
    mine = model.to_dict()
    for block, key in (("springs", "compliance"), ("parameters", "value")):
        if [entry["name"] for entry in content[block]] != [entry["name"] for entry in mine[block]]:
            raise ValueError(f"{block} does not list what effects has")
        for theirs, own in zip(content[block], mine[block], strict=True):
            if not np.allclose(np.array(theirs[key], dtype=float), own[key], rtol=1e-9, atol=1e-30):
                raise ValueError(f"{block}: '{own['name']}' has another {key} than effects; edit neither by hand")
