"""What a user can say of the sections of links without measuring: `sections.yaml`, with defaults that cover common castings.

None of it is identified. It only says between which limits the section of a link lies anywhere along its length; the
inequalities of `beam_mechanics` turn that into intervals of compliances.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from drake_stiffness.arm import Arm
from drake_stiffness.errors import InputError
from drake_stiffness.files import Document, read_yaml

# What is assumed where nothing is stated (docs/restoration.md says which sections that covers).
ELASTIC_RATIO = (
    2.3,
    2.8,
)  # E/G = 2 (1 + Poisson): 0.15 .. 0.40, all cast irons, steels, aluminium and magnesium alloys
SHEAR_FACTOR = (0.15, 1.0)  # webs of an I-section .. the energy bound
TORSION_FACTOR = (0.002, 1.0)  # thin open sections .. the ellipse
HALF_WIDTH_SHARE = 0.5  # of the arm's mean link length
RADIUS_SHARE = 0.2  # of a stated half width: thin I-sections about their weak axis, tapered to one half
RADIUS_SHARE_UNSTATED = 0.1  # of a half width that nobody stated

Positive = Annotated[float, Field(gt=0.0)]


def _ordered(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError(f"expected [low, high] with low <= high, found [{pair[0]:g}, {pair[1]:g}]")
    return pair


Range = Annotated[tuple[Positive, Positive], AfterValidator(_ordered)]


class Section(Document):
    """Limits of the section of a link, anywhere along its length; y and z are the axes that follow the long axis cyclically.

    Attributes
    ----------
    half_width_y_m, half_width_z_m
        How far material reaches from the straight line through the spring along the link, at most.
    radius_y_m, radius_z_m
        Radius of gyration, sqrt(integral of y^2 dA / A), at least.
    elastic_ratio
        E/G, [low, high].
    shear_factor
        Share of the area that carries shear, [low, high].
    torsion_factor
        Torsion constant over that of the ellipse with the same second moments, [low, high], at most 1.
    length_m
        Length that bends, if it is not the distance from the link's own joint to its spring.
    youngs_modulus_GPa, area_m2
        [low, high]; stated together they bound compliances in absolute terms.
    """

    half_width_y_m: Positive | None = None
    half_width_z_m: Positive | None = None
    radius_y_m: Positive | None = None
    radius_z_m: Positive | None = None
    elastic_ratio: Range | None = None
    shear_factor: Range | None = None
    torsion_factor: Range | None = None
    length_m: Positive | None = None
    youngs_modulus_GPa: Range | None = None
    area_m2: Range | None = None

    @model_validator(mode="after")
    def _possible(self) -> Section:
        for axis, width, radius in (
            ("y", self.half_width_y_m, self.radius_y_m),
            ("z", self.half_width_z_m, self.radius_z_m),
        ):
            if width is not None and radius is not None and radius > width:
                raise ValueError(
                    f"radius_{axis}_m is {radius:g} m, more than half_width_{axis}_m {width:g} m; no section has a radius of gyration "
                    "beyond its material"
                )
        for name, pair in (("shear_factor", self.shear_factor), ("torsion_factor", self.torsion_factor)):
            if pair is not None and pair[1] > 1.0:
                raise ValueError(f"{name} reaches {pair[1]:g}; no section exceeds 1")
        if (self.youngs_modulus_GPa is None) != (self.area_m2 is None):
            raise ValueError("youngs_modulus_GPa and area_m2 bound the stiffness E A together; state both or neither")
        return self


class Sections(Document):
    """The content of `sections.yaml`: limits for all links, and for single links what differs."""

    default: Section = Section()
    links: dict[str, Section] = Field(default_factory=dict)


@dataclass(frozen=True)
class SectionLimits:
    """The limits of one link with every default filled in, SI; pairs are (low, high)."""

    length_m: float
    half_width_m: tuple[float, float]
    radius_m: tuple[float, float]
    elastic_ratio: tuple[float, float]
    shear_factor: tuple[float, float]
    torsion_factor: tuple[float, float]
    axial_stiffness_N: tuple[float, float] | None


def read_sections(path: Path | str) -> Sections:
    """Read and validate a `sections.yaml`.

    Raises
    ------
    InputError
        With file, key path, value found, what was expected and how to mend it.
    """
    return read_yaml(Path(path), Sections, "limits of link sections (sections.yaml)")


def check_links(sections: Sections, arm: Arm) -> None:
    """Raise InputError if a link is named that the arm does not have."""
    for name in sections.links:
        if name not in arm.link_names:
            raise InputError(f"sections: links: no link '{name}'; the arm has {', '.join(arm.link_names)}.")


def limits_of(sections: Sections, link: str, reach_m: float, scale_m: float) -> SectionLimits:
    """What holds for one link: its own entry, else `default`, else what is assumed of castings.

    Parameters
    ----------
    reach_m : float
        Distance from the link's own joint to its spring, m.
    scale_m : float
        Mean link length of the arm, m: the size that unstated half widths are a share of.

    Raises
    ------
    InputError
        If the link has no length and none is stated, or a radius of gyration exceeds a half width.
    """
    stated = _merged(sections.default, sections.links.get(link, Section()))
    length = reach_m if stated.length_m is None else stated.length_m
    if length <= 1e-9:
        raise InputError(
            f"link '{link}' has no length between its own joint and its spring, so beam mechanics says nothing of it; state "
            f"links.{link}.length_m in the sections file (metres of material that bends)."
        )
    modulus, area = stated.youngs_modulus_GPa, stated.area_m2
    y = _width_and_radius(link, "y", stated.half_width_y_m, stated.radius_y_m, scale_m)
    z = _width_and_radius(link, "z", stated.half_width_z_m, stated.radius_z_m, scale_m)
    return SectionLimits(
        length_m=length,
        half_width_m=(y[0], z[0]),
        radius_m=(y[1], z[1]),
        elastic_ratio=stated.elastic_ratio or ELASTIC_RATIO,
        shear_factor=stated.shear_factor or SHEAR_FACTOR,
        torsion_factor=stated.torsion_factor or TORSION_FACTOR,
        axial_stiffness_N=(modulus[0] * area[0] * 1e9, modulus[1] * area[1] * 1e9) if modulus and area else None,
    )


def _merged(default: Section, own: Section) -> Section:
    """What is stated for a link, and where that is silent, for all."""
    return default.model_copy(update=own.model_dump(exclude_none=True))


def _width_and_radius(
    link: str, axis: str, width: float | None, radius: float | None, scale_m: float
) -> tuple[float, float]:
    """Half width and smallest radius of gyration along one axis, m."""
    share = RADIUS_SHARE_UNSTATED if width is None else RADIUS_SHARE
    width = HALF_WIDTH_SHARE * scale_m if width is None else width
    radius = share * width if radius is None else radius
    if radius > width:
        raise InputError(
            f"link '{link}': radius_{axis}_m is {radius:g} m, more than the half width {width:g} m that holds for it; state "
            f"half_width_{axis}_m too."
        )
    return width, radius
