"""What the user says of robot, tool and points: `cell.yaml`, validated."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr, field_validator, model_validator

from drake_stiffness.files import Document, read_yaml
from drake_stiffness.springs import Template, mask_entries, masked_template

Vector3 = Annotated[tuple[float, float, float], Field(description="three numbers")]
Selection = Literal["all", "none"] | tuple[str, ...]


class Pose(Document):
    """A pose as users write it: position in metres, roll, pitch, yaw in degrees (R = Rz(yaw) Ry(pitch) Rx(roll))."""

    position_m: Vector3 = (0.0, 0.0, 0.0)
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)


class Robot(Document):
    """The robot description and the part of it that is the arm."""

    model: str
    flange: str
    joints: tuple[str, ...] | None = None


class Tool(Document):
    """What the flange carries, in the flange frame."""

    mass_kg: float = Field(default=0.0, ge=0.0)
    center_of_mass_m: Vector3 = (0.0, 0.0, 0.0)
    tcp: Pose = Pose()


class Springs(Document):
    """The elastic elements the model has."""

    joints: Selection = "all"
    links: Selection = "none"
    template: Template = "beam"
    beam_axes: dict[str, Literal["x", "y", "z"]] = Field(default_factory=dict)
    masks: dict[str, tuple[str, ...]] = Field(default_factory=dict)

    @field_validator("masks")
    @classmethod
    def _masks_are_of_springs(cls, masks: dict[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
        """Entries exist, and a positive-semidefinite matrix can hold them."""
        sorted_masks = {}
        for link, names in masks.items():
            try:
                sorted_masks[link] = mask_entries(names)
            except ValueError as error:
                raise ValueError(f"{link}: {error}") from None
            lacking = masked_template(sorted_masks[link]).unsupported
            if lacking:
                raise ValueError(
                    f"{link}: found {', '.join(sorted_masks[link])} without {', '.join(lacking)}; a spring that has an entry off "
                    f"the diagonal has both its diagonal entries too. Add {', '.join(lacking)}"
                )
        return sorted_masks


class Hardware(Document):
    """A further effect that the arm has, a gravity compensator for one; its unknowns are identified along."""

    kind: str
    where: str
    settings: dict[str, Any] = Field(default_factory=dict)


class Cell(Document):
    """The content of `cell.yaml` (FORMATS: cell.yaml)."""

    robot: Robot
    gravity_m_per_s2: Vector3 = (0.0, 0.0, -9.81)
    tool: Tool = Tool()
    load_point_m: Vector3 = (0.0, 0.0, 0.0)
    reference_points_m: dict[str, Vector3] = Field(min_length=1)
    springs: Springs = Springs()
    effects: tuple[Hardware, ...] = ()

    _path: Path = PrivateAttr(default=Path("cell.yaml"))

    @field_validator("reference_points_m")
    @classmethod
    def _names_are_distinct(cls, points: dict[str, Vector3]) -> dict[str, Vector3]:
        folded: dict[str, str] = {}
        for name in points:
            twin = folded.setdefault(name.casefold(), name)
            if twin != name:
                raise ValueError(f"the points '{twin}' and '{name}' differ only in upper and lower case; rename one")
        return points

    @model_validator(mode="after")
    def _gravity_is_plausible(self) -> Cell:
        size = sum(component**2 for component in self.gravity_m_per_s2) ** 0.5
        if size > 100.0:
            raise ValueError(
                f"gravity_m_per_s2 has a length of {size:g} m/s^2; expected about 9.81 (was it written in mm/s^2?)"
            )
        return self

    @property
    def robot_path(self) -> Path:
        """The robot description; a path inside a file is relative to that file."""
        return self._path.parent / self.robot.model

    @property
    def path(self) -> Path:
        """The file it was read from."""
        return self._path


def read_cell(path: Path | str) -> Cell:
    """Read and validate a `cell.yaml`.

    Raises
    ------
    InputError
        With file, key path, value found, what was expected and how to mend it.
    """
    path = Path(path)
    cell = read_yaml(path, Cell, "a cell description (cell.yaml)")
    cell._path = path
    return cell
