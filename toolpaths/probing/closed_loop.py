"""What a probe found on the cut part, taken apart: what the model explains, named causes, and the rest; and mirrored.

At place j, cut at the path's point p_j, the deviation along the measured direction n is

    y_j = n . [ m(p_j) + t + w x (p_j - c) + s d(p_j) ] + rest_j

with m what the model predicts for the program that was cut (its deflection, or what its correction leaves), t and w a shift and turn
of the workpiece, d the deflection by the process force and s the error of that force's size. t, w and s are fitted with loose priors;
where d looks like a shift of the part, as it does under a constant force over a small part, s and t cannot be told apart, and that is
said: their sum is what is corrected. The rest is noise, or systematic beyond it; a systematic rest that neighbours share is
corrected near the places it was seen at (`probe_rest`) and is a case for `diagnose` at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError
from toolpaths.history import begins
from toolpaths.loaded_path import LoadedPath
from toolpaths.probing.path_places import Places, places_on_path
from toolpaths.probing.probe import CutWith, Probe
from toolpaths.probing.probe_rest import fit, near_rest, nearest_other, neighbours_agree, noise_of
from toolpaths.process import Process
from toolpaths.program import Program

Floats = NDArray[np.float64]

# Places farther from the path than a large cutter's radius were not cut by it.
WITHIN_MM = 40.0
# Priors of shift (mm), turn (mrad) and, where process.yaml states none, the force's size.
_SHIFT, _TURN, _FORCE = 5.0, 20.0, 0.3
# The force's size counts as told apart when these places narrow its prior to this share.
_TOLD = 0.15
# Standard deviations of chi-square beyond which the rest is no noise.
_SYSTEMATIC = 3.0


@dataclass(frozen=True, eq=False)
class Learnt:
    """Attributes
    ----------
    aim : (3, N)
        Where the tool is to go instead, less where the program says, m, world.
    sigma : (N,)
        Standard deviation of a coordinate of what that leaves, m; NaN where no place is near.
    probe : Probe
        The places that were used.
    places : Places
    explained_mm, named_mm, rest_mm : (M, 3)
        Parts of each deviation: by the model, by named causes, left; program's base frame (along the normal only where the
        deviation is).
    shift_mm, turn_mrad : (3,), (3,)
        Of the workpiece, about the mean of the places.
    shift_sigma_mm, turn_sigma_mrad : (3,), (3,)
    force_error, force_error_sigma : float
        Relative error of the force's size.
    force_told_apart : bool
        Whether these places tell it from a shift.
    noise_mm : float
    systematic : bool
        Whether the rest is larger than noise.
    corrected_rest : bool
        Whether neighbours share it, so that it is corrected too.
    cut_with : what cut the part
    notes : list of str
    """

    aim: Floats
    sigma: Floats
    probe: Probe
    places: Places
    explained_mm: Floats
    named_mm: Floats
    rest_mm: Floats
    shift_mm: Floats
    turn_mrad: Floats
    shift_sigma_mm: Floats
    turn_sigma_mrad: Floats
    force_error: float
    force_error_sigma: float
    force_told_apart: bool
    noise_mm: float
    systematic: bool
    corrected_rest: bool
    cut_with: CutWith
    cut_at: Floats
    notes: list[str]

    @property
    def rigid_mm(self) -> Floats:
        """(M, 3) what the shift and turn of the workpiece do at the places, program's base frame."""
        lever = self.probe.nominal_mm - self.probe.nominal_mm.mean(axis=0)
        return np.asarray(self.shift_mm + np.cross(self.turn_mrad * 1e-3, lever))

    def to_dict(self) -> dict[str, Any]:
        """For `--json`."""
        return {
            "places": self.probe.size,
            "cut_with": self.cut_with,
            "noise_mm": self.noise_mm,
            "measured_rms_mm": _rms(self.probe.deviation_mm),
            "after_model_rms_mm": _rms(self.probe.deviation_mm - self.explained_mm),
            "rest_rms_mm": _rms(self.rest_mm),
            "workpiece": {
                "shift_mm": self.shift_mm,
                "shift_sigma_mm": self.shift_sigma_mm,
                "turn_mrad": self.turn_mrad,
                "turn_sigma_mrad": self.turn_sigma_mrad,
            },
            "force": {
                "relative_error": self.force_error,
                "sigma": self.force_error_sigma,
                "told_apart_from_a_shift": self.force_told_apart,
            },
            "rest_is_systematic": self.systematic,
            "rest_is_corrected": self.corrected_rest,
            "hand_to": "diagnose" if self.systematic else None,
        }


def learn(
    program: Program,
    process: Process,
    path: LoadedPath,
    probe: Probe,
    seen: Floats,
    by_force: Floats,
    cut_at: Floats,
    cut_with: CutWith,
) -> Learnt:
    """Take a probe's deviations apart and mirror what the model does not explain.

    Parameters
    ----------
    seen : (3, N)
        What the model predicts of the program that was cut, m, world.
    by_force : (3, N)
        Deflection by the process force, m, world.
    cut_at : (n, N)
        Joints that were commanded.

    Raises
    ------
    InputError
        If no place lies near the path.
    """
    R_WB, _ = process.base
    line = program.line[path.rows].astype(int)
    target = program.position_mm[path.rows]
    begin = begins(program, path.rows)
    probe, places, notes = _matched(program, probe, target, begin, line)
    m, d = places.at(seen.T @ R_WB * 1e3), places.at(by_force.T @ R_WB * 1e3)
    place, direction, value = _rows(probe, m)
    lever = probe.nominal_mm.mean(axis=0)
    A = _columns(direction, probe.nominal_mm[place] - lever, d[place])
    prior = np.array([_SHIFT] * 3 + [_TURN] * 3 + [process.force.relative_sigma or _FORCE])
    beside = nearest_other(places.at(target))
    noise = noise_of(probe, place, value, beside, A, prior)
    x, C = fit(A, value, noise, prior)
    left = value - A @ x
    chi2, freedom = float(((left / noise) ** 2).sum()), max(value.size - 7, 1)
    systematic = chi2 > freedom + _SYSTEMATIC * np.sqrt(2 * freedom)
    named = (A @ x)[:, None] * direction
    rest = left[:, None] * direction
    power = max(float((left**2).mean() - (noise**2).mean()), 0.0)
    shared = systematic and neighbours_agree(place, left, beside, probe)
    columns_N = _columns(
        np.tile(np.eye(3), (target.shape[0], 1)), np.repeat(target - lever, 3, axis=0), _thrice(by_force, R_WB)
    )
    aim_mm = (columns_N @ x).reshape(-1, 3)
    variance = np.einsum("ki,ij,kj->k", columns_N, C, columns_N, optimize=True).reshape(-1, 3).mean(axis=1)
    near, rest_there, rest_variance = near_rest(
        places.at(target), beside, place, direction, left, noise, target, power if shared else 0.0
    )
    told = bool(np.sqrt(C[6, 6]) < _TOLD * prior[6])
    learnt = Learnt(
        aim=-(R_WB @ (aim_mm + rest_there).T) * 1e-3,
        sigma=np.where(near, np.sqrt(variance + np.where(shared, rest_variance, power)), np.nan) * 1e-3,
        probe=probe,
        places=places,
        explained_mm=_collected(place, (direction * m[place]).sum(axis=1)[:, None] * direction, probe.size),
        named_mm=_collected(place, named, probe.size),
        rest_mm=_collected(place, rest, probe.size),
        shift_mm=x[:3],
        turn_mrad=x[3:6],
        shift_sigma_mm=np.sqrt(np.diag(C)[:3]),
        turn_sigma_mrad=np.sqrt(np.diag(C)[3:6]),
        force_error=float(x[6]),
        force_error_sigma=float(np.sqrt(C[6, 6])),
        force_told_apart=told,
        noise_mm=float(np.sqrt((noise**2).mean())),
        systematic=bool(systematic),
        corrected_rest=bool(shared),
        cut_with=cut_with,
        cut_at=cut_at,
        notes=notes,
    )
    notes += _said(learnt)
    return learnt


def _matched(
    program: Program, probe: Probe, target: Floats, begin: NDArray[np.bool_], line: NDArray[np.int_]
) -> tuple[Probe, Places, list[str]]:
    places = places_on_path(target, begin, line, probe.nominal_mm, probe.line)
    near = places.distance_mm <= WITHIN_MM
    if not near.any():
        nearest = float(places.distance_mm.min())
        raise InputError(
            f"{probe.path}: none of its {probe.size} places lies within {WITHIN_MM:g} mm of a corrected motion of {program.path} (the nearest "
            f"is {nearest:.4g} mm away). Are x_mm, y_mm, z_mm in the program's base frame, and `line` its lines?"
        )
    notes = []
    if not near.all():
        lines = ", ".join(map(str, probe.table_line[~near][:12].tolist()))
        notes.append(
            f"{int((~near).sum())} of {probe.size} probed places lie more than {WITHIN_MM:g} mm from the path and were not used (line {lines} "
            f"of {probe.path.name})"
        )
    kept = Places(places.before[near], places.after[near], places.t[near], places.distance_mm[near])
    return probe.take(near), kept, notes


def _rows(probe: Probe, m: Floats) -> tuple[NDArray[np.int_], Floats, Floats]:
    """Scalar readings: place, direction (K, 3), and what the model leaves of the deviation along it, mm."""
    one = np.flatnonzero(probe.along_normal)
    three = np.flatnonzero(~probe.along_normal)
    place = np.concatenate([one, np.repeat(three, 3)])
    direction = np.concatenate([probe.normal[one], np.tile(np.eye(3), (three.size, 1))])
    return place, direction, ((probe.deviation_mm - m)[place] * direction).sum(axis=1)


def _columns(direction: Floats, lever_mm: Floats, deflection_mm: Floats) -> Floats:
    """Columns (K, 7) of shift (mm), turn (mrad) and relative error of force, along directions (K, 3)."""
    turn = np.cross(lever_mm, direction) * 1e-3  # n . (w x r) = w . (r x n)
    return np.concatenate([direction, turn, (direction * deflection_mm).sum(axis=1)[:, None]], axis=1)


def _thrice(by_force: Floats, R_WB: Floats) -> Floats:
    return np.repeat(by_force.T @ R_WB * 1e3, 3, axis=0)


def _collected(place: NDArray[np.int_], parts: Floats, M: int) -> Floats:
    out = np.zeros((M, 3))
    np.add.at(out, place, parts)
    return out


def _rms(vectors: Floats) -> float:
    return float(np.sqrt((vectors**2).sum(axis=1).mean())) if vectors.size else float("nan")


def _said(learnt: Learnt) -> list[str]:
    d = learnt.to_dict()
    what = (
        "the program as given"
        if learnt.cut_with == "uncorrected"
        else "the program that this command makes without a probe"
    )
    notes = [
        f"probe: {d['places']} places of a part cut with {what}; {d['measured_rms_mm']:.3f} mm rms measured, {d['after_model_rms_mm']:.3f} mm "
        f"after what the model explains, {d['rest_rms_mm']:.3f} mm after named causes (noise {learnt.noise_mm:.3f} mm a coordinate)"
    ]
    size, turn = float(np.linalg.norm(learnt.shift_mm)), float(np.linalg.norm(learnt.turn_mrad))
    sure = size > 3 * float(np.linalg.norm(learnt.shift_sigma_mm)) or turn > 3 * float(
        np.linalg.norm(learnt.turn_sigma_mrad)
    )
    if learnt.force_told_apart:
        notes.append(
            f"probe: the force was {100 * learnt.force_error:+.1f} % +- {100 * learnt.force_error_sigma:.1f} % off what process.yaml says"
        )
    else:
        notes.append(
            "probe: an error of the force's size and a shift of the workpiece look alike at these places; their sum is corrected. Places where "
            "force or posture differ would tell them apart"
        )
    if sure:
        notes.append(
            f"probe: the workpiece seems shifted by {size:.3f} mm and turned by {turn:.2f} mrad; the correction includes it, so set its frame anew "
            "only together with a new correction"
        )
    if learnt.systematic:
        fate = (
            "it is corrected near the places it was seen at"
            if learnt.corrected_rest
            else "neighbours do not share it, so it is left alone"
        )
        notes.append(
            f"probe: the rest is larger than noise ({d['rest_rms_mm']:.3f} mm rms): something bends or shifts that the model does not have; "
            f"{fate}. Hand it to `diagnose` (--handover DIR writes the campaign; with --model and --fixed it asks what of the model is no longer true)"
        )
    return notes
