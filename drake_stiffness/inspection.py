"""What a cell is before anything is measured: its chain, its springs with their frames, counts and ranks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drake_stiffness.arm import Arm
from drake_stiffness.assembly import default_beam_axis, joint_spring, link_spring, make_model, spring_effects
from drake_stiffness.cell import Cell
from drake_stiffness.effects import Cases, Effect
from drake_stiffness.effects.compliance import LinkCompliance, Spring
from drake_stiffness.identifiability import numerical_rank
from drake_stiffness.rotations import Array
from drake_stiffness.sensitivity import sensitivity
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
        Ranks by template and load; empty unless asked for.
    """

    arm: Arm
    joints: list[dict[str, Any]]
    springs: list[dict[str, Any]]
    counts: dict[str, int]
    identifiable: list[dict[str, Any]]

    def to_dict(self) -> dict[str, Any]:
        """For `--json`."""
        content: dict[str, Any] = {
            "counts": self.counts,
            "joints": self.joints,
            "links": list(self.arm.link_names),
            "springs": self.springs,
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
    return Inspection(arm, joints, springs, parameter_counts(arm.num_joints), ranks)


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
    rng = np.random.default_rng(seed)
    N = RANDOM_POSTURES
    q = random_postures(arm, N, rng)
    force, moment = rng.normal(size=(3, N)), rng.normal(size=(3, N))
    weightless = replace(arm, gravity=np.zeros(3))
    names = np.array(list(cell.reference_points_m))
    point, case = np.tile(names, N), np.repeat(np.arange(N), names.size)
    entries = []
    for template in TEMPLATES:
        model = make_model(cell, weightless, complete_effects(cell, arm, template))
        for load in ("wrench", "force"):
            wrench = np.concatenate([force, moment if load == "wrench" else 0 * moment])
            cases = Cases(q, wrench, model.load_point)
            A = sensitivity(model, cases, case, point)[:, :3].reshape(-1, model.x.size)
            length = np.linalg.norm(A, axis=0)
            live = length > 1e-12 * length.max()
            singular = np.linalg.svd(A[:, live] / length[live], compute_uv=False)
            rank, gap = numerical_rank(singular, coarse=False)
            entries.append(
                {
                    "template": template,
                    "load": load,
                    "parameters": int(model.x.size),
                    "rank": rank,
                    "singular_gap": gap if np.isfinite(gap) else None,
                }
            )
    return entries
