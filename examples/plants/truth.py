"""The truth behind a simulated campaign, as a file people can read: springs of joints, sections of links, the tool."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from .beams import Array, HollowBox


@dataclass(frozen=True)
class LinkTruth:
    """A link as a hollow-box beam: its section at the root and the factor on width and height at the tip."""

    section: HollowBox
    taper: float = 1.0


@dataclass(frozen=True)
class Tool:
    """What the flange carries: mass (kg) and centre of mass (flange frame, m)."""

    mass: float
    center_of_mass: Array


@dataclass(frozen=True)
class Truth:
    """All that the URDF does not say of the plant.

    Attributes
    ----------
    flange
        Name of the link or frame that carries the tool.
    joint_compliance
        Per joint, rad/(N m) or, for a prismatic joint, m/N.
    links
        Per link (base included) its beam.
    tool, gravity
        The tool and the acceleration of gravity in world axes, m/s^2.
    segments
        Into how many beam elements every link is cut.
    shear
        Whether the elements give in shear.
    """

    flange: str
    joint_compliance: Mapping[str, float]
    links: Mapping[str, LinkTruth]
    tool: Tool
    gravity: Array
    segments: int = 3
    shear: bool = True


def load_truth(path: str | Path) -> Truth:
    """Read a truth file (see `examples/kr270/true_arm.yaml` for its keys).

    Raises
    ------
    KeyError
        If a key is missing.
    ValueError
        If a section is impossible.
    """
    data = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    tool = data.get("tool") or {"mass_kg": 0.0, "center_of_mass_m": [0.0, 0.0, 0.0]}
    return Truth(
        flange=str(data["flange"]),
        joint_compliance={str(name): float(value) for name, value in data["joint_compliance"].items()},
        links={str(name): _link(entry) for name, entry in data["links"].items()},
        tool=Tool(float(tool["mass_kg"]), np.array(tool["center_of_mass_m"], dtype=float)),
        gravity=np.array(data["gravity_m_per_s2"], dtype=float),
        segments=int(data.get("segments", 3)),
        shear=bool(data.get("shear", True)),
    )


def _link(entry: Mapping[str, Any]) -> LinkTruth:
    section = HollowBox(
        width=float(entry["width_mm"]) * 1e-3,
        height=float(entry["height_mm"]) * 1e-3,
        wall=float(entry["wall_mm"]) * 1e-3,
        youngs_modulus=float(entry["E_GPa"]) * 1e9,
        shear_modulus=float(entry["G_GPa"]) * 1e9,
    )
    return LinkTruth(section, float(entry.get("taper", 1.0)))
