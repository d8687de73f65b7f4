"""Blind campaigns: none, one or two effects of random kind, place and size are hidden, or one that nobody's catalogue has.

A trial's number is its seed. Files for the program on trial: campaign.yaml, cell.yaml, the robot, measurements.csv. The truth
stays outside that folder.
"""

from __future__ import annotations

import csv
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from blind_trials.hidden import Hidden, Rng
from blind_trials.hidden_around import BY_LOAD, BY_POSITION, DRAWS, NEVER_SEEN, UNKNOWN, UNKNOWN_BY_POSITION, places
from blind_trials.oracle import Oracle, spring_columns
from blind_trials.setting import Quantity, Setting, make_setting
from blind_trials.stands import SIGMA_M, STANDS, Array, stand

POSTURES = 32
#: Experiments (postures, directions, order) per arm and base model.
DESIGNS = 12
HOLD_OUT = 0.25
#: A little of everything else: so many effects of this visible size each.
FLOOR_EFFECTS, FLOOR_SIGMA = 4, 0.25
WEAK, STRONG = (1.0, 20.0), (20.0, 200.0)
#: A physically absurd effect is drawn anew.
LARGEST_SIZE = 60.0
_ATTEMPTS = 20
PLANS = ("none", "one", "two", "unknown", "strong")


@dataclass(frozen=True)
class Placed:
    """An effect with its size and what of it shows.

    Attributes
    ----------
    sigma, sigma_kept
        Visible size over all experiments, and over those not held out.
    alone
        The same as `sigma` when the other hidden effect is projected out too.
    left
        Its left-over, (rows,), over all experiments.
    """

    hidden: Hidden
    size: float
    sigma: float
    sigma_kept: float
    alone: float
    left: Array


@dataclass(frozen=True)
class Trial:
    """A campaign and its truth."""

    seed: int
    plan: str
    setting: Setting
    oracle: Oracle
    oracle_kept: Oracle
    placed: tuple[Placed, ...]
    floor: tuple[tuple[Hidden, float], ...]
    readings: Array
    held: Array


def make_trial(
    seed: int,
    plan: str,
    *,
    arm: str | None = None,
    kind: str | None = None,
    sigma: float | None = None,
    postures: int = POSTURES,
    designs: Path | None = None,
) -> Trial:
    """Draw everything of one trial.

    Parameters
    ----------
    plan
        One of `PLANS`.
    arm, kind, sigma
        Fixed instead of drawn.
    designs
        Folder that keeps what the experiments' base models can absorb.
    """
    rng = np.random.default_rng([seed, 2024])
    for _ in range(_ATTEMPTS):
        kinds = _kinds(plan, kind, rng)
        setting = _setting(arm or str(rng.choice(STANDS)), kinds, postures, rng)
        held = np.zeros(postures, dtype=bool)
        held[rng.permutation(postures)[: int(HOLD_OUT * postures)]] = True
        springs = spring_columns(setting, designs)
        oracle, kept = Oracle(setting, np.ones(postures, dtype=bool), springs), Oracle(setting, ~held, springs)
        wanted = [sigma or float(np.exp(rng.uniform(*np.log(STRONG if plan == "strong" else WEAK)))) for _ in kinds]
        placed = _place_all(oracle, kept, kinds, wanted, rng)
        if placed is not None:
            break
    else:
        raise ValueError(f"trial {plan} {seed}: nothing can be hidden at the wanted size")
    floor = _floor(oracle, {p.hidden.kind for p in placed}, rng)
    world = setting.world
    for p in placed:
        world = p.hidden.change(world, p.size)
    for hidden, size in floor:
        world = hidden.change(world, size)
    exact = setting.read(world, exact=True)
    noise = rng.normal(scale=SIGMA_M, size=exact.shape)
    return Trial(seed, plan, setting, oracle, kept, placed, floor, exact + noise, held)


def _kinds(plan: str, kind: str | None, rng: Rng) -> list[str]:
    known = [*BY_LOAD, *BY_POSITION]
    if plan == "none":
        return [str(rng.choice(list(NEVER_SEEN)))] if rng.random() < 0.1 else []
    if plan == "unknown":
        return [kind or str(rng.choice([*UNKNOWN, *UNKNOWN_BY_POSITION]))]
    first = kind or str(rng.choice(known))
    return [first, str(rng.choice(known))] if plan == "two" else [first]


def _setting(arm: str, kinds: list[str], postures: int, rng: Rng) -> Setting:
    """A base model in which the kinds are missing, and the quantity that shows them."""
    positions = {*BY_POSITION, *UNKNOWN_BY_POSITION} & {*kinds}
    quantity: Quantity = "position" if positions or rng.random() < 0.15 else "displacement"
    if {*NEVER_SEEN} & {*kinds}:
        quantity = "displacement"  # positions show a scale: weight does not scale with the force sensor
    # Absolute positions show how a link bends under its own weight, which no spring at its end does.
    links = quantity == "displacement" and rng.random() < 0.6
    if {"link_compliance", "base_compliance", "joint_compliance"} & {*kinds}:
        links = False  # a link's spring stands in for that of the joint it ends at
    if {"uneven_link", "warm_link"} & {*kinds}:
        links, quantity = True, "displacement"
    joints = stand(arm).chain.joint_names
    rigid = str(rng.choice(joints)) if "joint_compliance" in kinds else None
    return make_setting(arm, quantity, links, postures, int(rng.integers(DESIGNS)), rigid)


def _place_all(
    oracle: Oracle, kept: Oracle, kinds: list[str], wanted: list[float], rng: Rng
) -> tuple[Placed, ...] | None:
    """Every kind at its size, or nothing if one cannot be seen so large."""
    chosen: list[Placed] = []
    for kind, size in zip(kinds, wanted, strict=True):
        placed = _place(oracle, kept, kind, size, {p.hidden.name for p in chosen}, rng)
        if placed is None:
            return None
        chosen.append(placed)
    return tuple(_alone(p, chosen) for p in chosen)


def _place(oracle: Oracle, kept: Oracle, kind: str, wanted: float, taken: set[str], rng: Rng) -> Placed | None:
    """Draw places and constants until the effect can be seen at the wanted size without being absurd."""
    s = oracle.setting
    for _ in range(_ATTEMPTS):
        hidden = DRAWS[kind](s, str(rng.choice(places(s, kind))), rng)
        if hidden.name in taken:
            continue
        if kind in NEVER_SEEN:
            size, left = 1.0, oracle.signature(hidden)
        else:
            shown = float(np.linalg.norm(oracle.signature(hidden)))
            size = wanted / max(shown, 1e-9)
            if size > LARGEST_SIZE:
                continue
            size *= wanted / float(np.linalg.norm(oracle.signature(hidden, size)))
            left = oracle.signature(hidden, size)
        sigma = float(np.linalg.norm(left))
        return Placed(hidden, size, sigma, float(np.linalg.norm(kept.signature(hidden, size))), sigma, left)
    return None


def _alone(p: Placed, everything: list[Placed]) -> Placed:
    left = p.left
    for other in everything:
        if other is not p:
            direction = other.left / np.linalg.norm(other.left)
            left = left - direction * (direction @ left)
    return replace(p, alone=float(np.linalg.norm(left)))


def _floor(oracle: Oracle, taken: set[str], rng: Rng) -> tuple[tuple[Hidden, float], ...]:
    s, out = oracle.setting, []
    able = [k for k in ("joint_backlash", "joint_hysteresis", "joint_mesh_stiffness", "tracker_drift", "creep")]
    for kind in rng.choice([k for k in able if k not in taken], size=FLOOR_EFFECTS):
        hidden = DRAWS[kind](s, str(rng.choice(places(s, kind))), rng)
        shown = float(np.linalg.norm(oracle.signature(hidden)))
        if shown > 0.05:
            out.append((hidden, FLOOR_SIGMA / shown))
    return tuple(out)


def write_files(trial: Trial, folder: Path) -> Path:
    """The files that the program on trial sees; returns campaign.yaml."""
    s, e = trial.setting, trial.setting.experiment
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(s.stand.model, folder / s.stand.model.name)
    joints = [name for name in s.joint_names if name != s.rigid_joint]
    cell = s.stand.cell(joints, list(s.stand.chain.link_names) if s.links else [])
    (folder / "cell.yaml").write_text(yaml.safe_dump(cell, sort_keys=False), encoding="utf-8")
    campaign: dict[str, Any] = {
        "cell": "cell.yaml",
        "measurements": "measurements.csv",
        "noise": {"position_sigma_mm": SIGMA_M * 1e3},
        "hold_out": {"experiments": [f"E{k:02d}" for k in np.flatnonzero(trial.held)]},
        "quantity": s.quantity,
    }
    (folder / "campaign.yaml").write_text(yaml.safe_dump(campaign, sort_keys=False), encoding="utf-8")
    units = ["mm" if slides else "deg" for slides in s.stand.chain.prismatic]
    head = ["experiment", "step", "point", "time_s", *(f"{n}_{u}" for n, u in zip(s.joint_names, units, strict=True))]
    head += ["fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm", "x_mm", "y_mm", "z_mm"]
    with (folder / "measurements.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(head)
        for k in range(len(e.q)):
            start = [f"E{e.course.experiment[k]:02d}", e.course.step[k]]
            middle = [*(f"{v:.4f}" for v in e.q_printed[k]), *(f"{v + 0.0:.3f}" for v in e.wrench[k])]
            for p, name in enumerate(s.stand.points):
                position = [f"{v:.5f}" for v in trial.readings[k, p] * 1e3]
                table.writerow([*start, name, f"{e.course.time_s[k]:.0f}", *middle, *position])
    return folder / "campaign.yaml"


def truth_of(trial: Trial) -> dict[str, Any]:
    """The truth as it is kept."""
    s = trial.setting
    data = trial.oracle.left(trial.readings - trial.oracle.clean)
    data_kept = trial.oracle_kept.left(trial.readings - trial.oracle.clean)
    hidden = []
    for p in trial.placed:
        kept = trial.oracle_kept.signature(p.hidden, p.size)
        hidden.append(
            {
                "kind": p.hidden.kind,
                "where": p.hidden.where,
                "known": p.hidden.known,
                "constants": p.hidden.constants,
                "size": p.size,
                "sigma": p.sigma,
                "sigma_kept": p.sigma_kept,
                "sigma_alone": p.alone,
                "oracle_z": float(p.left @ data / max(np.linalg.norm(p.left), 1e-300)),
                "oracle_z_kept": float(kept @ data_kept / max(np.linalg.norm(kept), 1e-300)),
            }
        )
    return {
        "seed": trial.seed,
        "plan": trial.plan,
        "arm": s.stand.name,
        "quantity": s.quantity,
        "links": s.links,
        "rigid_joint": s.rigid_joint,
        "hidden": hidden,
        "floor": [{"name": h.name, "size": size} for h, size in trial.floor],
        "left_over_chi2": float(data @ data),
        "left_over_dof": int(data.size - trial.oracle.basis.shape[1] - references(trial)),
    }


def references(trial: Trial) -> int:
    """Unloaded coordinates that are unknowns of their own."""
    points = len(trial.setting.stand.points)
    return 3 * points * trial.held.size if trial.setting.quantity == "displacement" else 0
