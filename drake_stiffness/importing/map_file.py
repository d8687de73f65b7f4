"""MAP.yaml: what the columns of other programs' files mean - a tracker's export, a force log, a robot log."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, PrivateAttr, field_validator, model_validator

from drake_stiffness.cell import Vector3
from drake_stiffness.files import Document, read_yaml

LENGTHS = {"mm": 1e-3, "m": 1.0, "um": 1e-6, "inch": 0.0254}
FORCES = {"N": 1.0, "kN": 1e3, "kgf": 9.80665, "lbf": 4.4482216152605}  # and kg, by the cell's gravity
MOMENTS = {"Nm": 1.0, "kNm": 1e3, "Nmm": 1e-3, "lbf_ft": 1.3558179483314, "lbf_in": 0.11298482902762}
ANGLES = {"deg": 0.017453292519943295, "rad": 1.0}


class Drop(Document):
    """Rows that are left out: those whose cell is one of `values`, or is none of `keep`."""

    column: str
    values: tuple[str, ...] | None = None
    keep: tuple[str, ...] | None = None

    @field_validator("values", "keep", mode="before")
    @classmethod
    def _as_text(cls, value: Any) -> Any:
        """A flag may be written 0, 1, yes or no in YAML; cells are text."""
        if isinstance(value, list) and any(isinstance(v, bool) for v in value):
            raise ValueError(
                "a word like yes, no, on, off or true needs quotes here, because YAML reads it as a truth value"
            )
        return [str(v) for v in value] if isinstance(value, list) else value

    @model_validator(mode="after")
    def _one_way(self) -> Drop:
        if (self.values is None) == (self.keep is None):
            raise ValueError("give either values (of rows to leave out) or keep (of rows to take)")
        return self


class Time(Document):
    """The column that says when, and how it is written: seconds, ISO dates, clock times, or a strptime pattern."""

    column: str
    format: str = "seconds"
    offset_s: float = 0.0

    @field_validator("format")
    @classmethod
    def _known(cls, text: str) -> str:
        if text not in ("seconds", "iso", "clock") and "%" not in text:
            raise ValueError("expected seconds, iso, clock (HH:MM:SS), or a pattern like '%d.%m.%Y %H:%M:%S'")
        return text


class Match(Document):
    """How rows find their step of an experiment."""

    by: Literal["columns", "order", "time"] = "columns"
    experiment: str = "experiment"
    step: str = "step"
    samples: int = Field(default=1, ge=1)
    how: Literal["nearest", "since", "average"] = "nearest"
    window_s: float | None = Field(default=None, gt=0.0)

    @model_validator(mode="after")
    def _complete(self) -> Match:
        if self.by == "time" and self.window_s is None:
            raise ValueError(
                "matching by time needs window_s, the largest difference in time that counts as a match, s"
            )
        return self


class TextFile(Document):
    """A table as another program wrote it."""

    file: str
    delimiter: Literal[",", ";", "tab", "space"] = ","
    decimal: Literal[".", ","] = "."
    encoding: str = "utf-8"
    comment: str | None = Field(default=None, min_length=1)
    skip_lines: int = Field(default=0, ge=0)
    header: tuple[str, ...] | None = None
    skip_after_header: int = Field(default=0, ge=0)
    drop: tuple[Drop, ...] = ()
    time: Time | None = None
    match: Match = Match()

    @model_validator(mode="after")
    def _is_readable(self) -> TextFile:
        if self.delimiter == "," and self.decimal == ",":
            raise ValueError("the comma cannot both separate cells and stand for the decimal point; set delimiter")
        if self.match.by == "time" and self.time is None:
            raise ValueError("matching by time needs the key time: {column: ...}")
        return self


class Axes(Document):
    """The columns of one point."""

    x: str
    y: str
    z: str


class Readings(TextFile):
    """A tracker's file."""

    quantity: Literal["position", "displacement"] = "position"
    unit: Literal["mm", "m", "um", "inch"]
    columns: Axes | None = None
    point: str | None = None
    point_column: str | None = None
    rename: dict[str, str] = Field(default_factory=dict)
    points: dict[str, Axes] | None = None
    temperature_degC: str | None = None

    @model_validator(mode="after")
    def _one_layout(self) -> Readings:
        if (self.columns is None) == (self.points is None):
            raise ValueError(
                "give either columns: {x, y, z} (a row per point) or points: {P1: {x, y, z}, ...} (all points in one "
                "row)"
            )
        if self.columns is not None and (self.point is None) == (self.point_column is None):
            raise ValueError("with columns, give point_column (it names the point) or point (all rows are of this one)")
        if self.points is not None and (self.point or self.point_column or self.rename):
            raise ValueError("with points, the names stand there; leave out point, point_column and rename")
        if self.match.how == "average":
            raise ValueError("match.how: average is for force logs; readings take nearest or since")
        return self


class Forces(TextFile):
    """A force sensor's log."""

    columns: dict[Literal["fx", "fy", "fz", "mx", "my", "mz"], str] = Field(default_factory=dict)
    column: str | None = None
    along: Literal["x", "y", "z", "+x", "+y", "+z", "-x", "-y", "-z"] | None = None
    unit: Literal["N", "kN", "kgf", "kg", "lbf"]
    moment_unit: Literal["Nm", "kNm", "Nmm", "lbf_ft", "lbf_in"] = "Nm"
    sign: Literal[1, -1] = 1
    frame: Literal["world", "flange", "tool"] = "world"
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)
    moments_at_m: Vector3 | None = None
    tare: bool = False
    zero_below_N: float | None = Field(default=None, ge=0.0)

    @model_validator(mode="after")
    def _says_what_it_reads(self) -> Forces:
        if bool(self.columns) == (self.column is not None):
            raise ValueError("give either columns: {fx: ..., fy: ..., fz: ...} or column with along (one axis)")
        if (self.column is None) != (self.along is None):
            raise ValueError("column and along belong together: column: F, along: -z")
        return self

    @model_validator(mode="after")
    def _how_of_a_log(self) -> Forces:
        _refuse_since(self.match)
        return self


class Joints(TextFile):
    """A robot's log of joint positions."""

    columns: dict[str, str] = Field(min_length=1)
    unit: Literal["deg", "rad"] = "deg"
    length_unit: Literal["mm", "m"] = "mm"
    same_within_deg: float = Field(default=0.02, gt=0.0)

    @model_validator(mode="after")
    def _how_of_a_log(self) -> Joints:
        _refuse_since(self.match)
        return self


def _refuse_since(match: Match) -> None:
    """A log runs on beside the readings: its rows do not begin with a step."""
    if match.how == "since":
        raise ValueError("match.how: since is for readings; logs take nearest or average")


class ImportMap(Document):
    """The content of MAP.yaml."""

    cell: str
    plan: str | None = None
    start: str | None = None
    readings: tuple[Readings, ...] = Field(min_length=1)
    forces: Forces | None = None
    joints: Joints | None = None
    samples: Literal["one", "mean", "keep"] = "one"
    unmatched: Literal["refuse", "list"] = "refuse"

    _path: Path = PrivateAttr(default=Path("MAP.yaml"))

    @field_validator("readings", mode="before")
    @classmethod
    def _one_or_many(cls, value: Any) -> Any:
        """A single file needs no list."""
        return [value] if isinstance(value, dict) else value

    @model_validator(mode="after")
    def _enough(self) -> ImportMap:
        if self.plan is None and (self.joints is None or self.forces is None):
            raise ValueError("without plan (PLAN.csv: postures and loads), both joints and forces must come from logs")
        for entry in self.readings:
            if self.plan is None and entry.match.by != "columns":
                raise ValueError(f"matching by {entry.match.by} needs a plan, which says the steps")
        if len({entry.quantity for entry in self.readings}) > 1:
            raise ValueError("all readings must be of one quantity, position or displacement")
        if self.forces is not None and self.forces.tare and self.plan is None:
            raise ValueError("forces.tare needs a plan, which says the unloaded steps")
        return self

    @property
    def path(self) -> Path:
        """The file it was read from."""
        return self._path

    @property
    def folder(self) -> Path:
        """Paths inside are relative to it."""
        return self._path.parent


def read_import_map(path: Path | str) -> ImportMap:
    """Read and validate a MAP.yaml; InputError names file, key, value and remedy."""
    path = Path(path)
    content = read_yaml(path, ImportMap, "a description of exported files (MAP.yaml)")
    content._path = path
    return content
