"""What a cell is before anything is measured: its chain, its springs with their frames, counts and ranks."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from drake_stiffness.arm import Arm
from drake_stiffness.assembly import joint_spring, link_spring, make_model, spring_effects
from drake_stiffness.cell import Cell
from drake_stiffness.effects import Cases, Effect
from drake_stiffness.effects.compliance import LinkCompliance, Spring, default_beam_axis
from drake_stiffness.hardware import hardware_entries
from drake_stiffness.identifiability import numerical_rank
from drake_stiffness.invariants import algebraic_rank, blind_to_forces
from drake_stiffness.rotations import Array
from drake_stiffness.sensitivity import sensitivity
from drake_stiffness.special_points import why_lower
from drake_stiffness.springs import TEMPLATES, Template, parameter_counts

CONVENTIONS = (
    "a joint spring acts about (revolute) or along (prismatic) its joint's axis",
    "a link's 6x6 spring sits at the end of the link: in the parent-side frame of the next joint, for the last link in the "
    "flange frame, for the base link in the parent-side frame of the first joint",
    "components (dx, dy, dz, rx, ry, rz) in metres and radians: a translation, then a rotation vector, in the frame's axes",
    "links welded together are one link, named after the first; joints outside the arm are locked",
    "the beam template is written for a long axis x and permuted cyclically to the link's beam axis",
    "springs carry the whole torque or wrench, weight included",
)

RANDOM_POSTURES = 200


@dataclass(frozen=True, eq=False)
class Inspection:
    """Attributes
    ----------
    arm : Arm
    joints : list of dict
        name, type, axis (in its parent-side frame), limits, position of its frame in the world at zero.
    springs : list of dict
        name, kind, frame, template, beam_axis, unknowns of the springs that the cell keeps.
    counts : dict
        complete, symmetric, beam: for all links and joints, whatever the cell keeps.
    identifiable : list of dict
        Ranks by template and load, beside the rank that algebra gives for full wrenches (`invariants`) and a sentence where the
        cell's points show less than others would; empty unless asked for.
    effects : list of dict
        Hardware besides springs: kind, where, settings, unknowns.
    """

    arm: Arm
    joints: list[dict[str, Any]]
    springs: list[dict[str, Any]]
    counts: dict[str, int]
    identifiable: list[dict[str, Any]]
    effects: list[dict[str, Any]] = field(default_factory=list)

    @property
    def parameters_total(self) -> int:
        """Unknowns of the complete model of joints and links, and of the hardware."""
        return int(self.counts["complete"] + sum(e["unknowns"] for e in self.effects))

    def to_dict(self) -> dict[str, Any]:
        """For `--json`."""
        content: dict[str, Any] = {
            "counts": self.counts,
            "joints": self.joints,
            "links": list(self.arm.link_names),
            "springs": self.springs,
            "effects": self.effects,
            "parameters_total": self.parameters_total,
            "conventions": list(CONVENTIONS),
        }
        if self.identifiable:
            content["identifiable"] = self.identifiable
        return content


def inspect_cell(cell: Cell, arm: Arm, *, identifiability: bool = False, seed: int = 0) -> Inspection:
    """Describe a cell.

    Parameters
    ----------
    identifiability : bool
        Compute ranks over random postures inside the limits, at the cell's load and reference points.
    """
    from drake_stiffness.arm import forward

    poses = forward(arm, np.zeros((arm.num_joints, 1)))
    joints = []
    for i, name in enumerate(arm.joint_names):
        factor = 1e3 if arm.prismatic[i] else 180 / np.pi
        joints.append(
            {
                "name": name,
                "type": "prismatic" if arm.prismatic[i] else "revolute",
                "axis": arm.axis_F[i],
                "lower": arm.lower[i] * factor,
                "upper": arm.upper[i] * factor,
                "unit": "mm" if arm.prismatic[i] else "deg",
                "position_at_zero_m": poses.p_F[i][:, 0],
            }
        )
    springs = [_spring_entry(e, arm) for e in spring_effects(cell, arm) if isinstance(e, Spring)]
    ranks = _ranks(cell, arm, seed) if identifiability else []
    return Inspection(arm, joints, springs, parameter_counts(arm.num_joints), ranks, hardware_entries(cell, arm))


def _spring_entry(effect: Spring, arm: Arm) -> dict[str, Any]:
    place, number = effect.site(arm)
    if place == "joint":
        axis = f"axis of joint '{effect.where}'"
        return {"name": effect.where, "kind": "joint", "frame": axis, "unknowns": 1, "parameters": list(effect.names)}
    assert isinstance(effect, LinkCompliance)
    last = number == arm.num_joints
    frame = "flange" if last else f"parent-side frame of joint '{arm.joint_names[number]}'"
    return {
        "name": effect.link_name(),
        "kind": "link",
        "frame": frame,
        "template": effect.template_name,
        "beam_axis": effect.beam_axis if effect.template_name == "beam" else None,
        "unknowns": len(effect.parameters),
        "parameters": list(effect.names),
    }


def complete_effects(cell: Cell, arm: Arm, template: Template) -> list[Effect]:
    """Springs in every joint and every link, whatever the cell keeps."""
    effects: list[Effect] = [joint_spring(arm, name) for name in arm.joint_names]
    for link in arm.link_names:
        axis = cell.springs.beam_axes.get(link) or default_beam_axis(arm, link) or "x"
        effects.append(link_spring(arm, link, template, axis))
    return effects


def random_postures(arm: Arm, number: int, rng: np.random.Generator) -> Array:
    """Postures (n, N) uniform inside the limits; a revolute joint without limits turns once, a slide moves by a metre."""
    span = np.where(arm.prismatic, 0.5, np.pi)
    lower = np.where(np.isfinite(arm.lower), arm.lower, -span)
    upper = np.where(np.isfinite(arm.upper), arm.upper, span)
    return rng.uniform(lower[:, None], upper[:, None], (arm.num_joints, number))


def _ranks(cell: Cell, arm: Arm, seed: int) -> list[dict[str, Any]]:
    """Rank of the observation matrix for every template under full wrenches and under pure forces."""
    entries = []
    for template in TEMPLATES:
        parameters = parameter_counts(arm.num_joints)[{"full": "complete"}.get(template, template)]
        for load in ("wrench", "force"):
            rank, gap = numerical_rank(singular_values(cell, arm, template, load, seed), coarse=False)
            entries.append(
                {
                    "template": template,
                    "load": load,
                    "parameters": parameters,
                    "rank": rank,
                    "singular_gap": gap if np.isfinite(gap) else None,
                    "algebraic_rank": algebraic_rank(arm.prismatic, template) if load == "wrench" else None,
                    "special_points": _special(cell, arm, template, load, rank),
                }
            )
    return entries


def singular_values(cell: Cell, arm: Arm, template: Template, load: str, seed: int = 0) -> Array:
    """Singular values of the complete model's observation matrix, columns of unit length, largest first.

    Over random postures inside the limits and random loads at the cell's load point, read at the cell's reference points.

    Parameters
    ----------
    load : 'wrench' or 'force'
    """
    rng = np.random.default_rng(seed)
    N = RANDOM_POSTURES
    q = random_postures(arm, N, rng)
    force, moment = rng.normal(size=(3, N)), rng.normal(size=(3, N))
    weightless = replace(arm, gravity=np.zeros(3))
    names = np.array(list(cell.reference_points_m))
    point, case = np.tile(names, N), np.repeat(np.arange(N), names.size)
    model = make_model(cell, weightless, complete_effects(cell, arm, template))
    cases = Cases(q, np.concatenate([force, moment if load == "wrench" else 0 * moment]), model.load_point)
    A = sensitivity(model, cases, case, point)[:, :3].reshape(-1, model.x.size)
    length = np.linalg.norm(A, axis=0)
    live = length > 1e-12 * length.max()
    return np.linalg.svd(np.linalg.qr(A[:, live] / length[live], mode="r"), compute_uv=False)


def _special(cell: Cell, arm: Arm, template: Template, load: str, rank: int) -> str | None:
    """Why the rank is below that of points in general position; None where it is not, or where algebra has no number."""
    generic = algebraic_rank(arm.prismatic, template)
    if generic is None:
        return None
    moments = load == "wrench"
    if rank >= generic - (0 if moments else blind_to_forces(template)):
        return None
    points = np.array(list(cell.reference_points_m.values()))
    return why_lower(arm, np.array(cell.load_point_m), points, moments=moments)
