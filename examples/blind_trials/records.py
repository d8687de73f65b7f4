"""Trials that were run, read back: what was hidden, what was said, and how the two compare."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

#: Parameters of each kind that a test must fit: what an oracle that knows the kind's regressors pays for.
PARAMETERS = {
    "joint_mesh_stiffness": 2,
    "joint_periodic_error": 2,
    "gravity_compensator": 2,
    "force_sensor_bias": 3,
    "force_sensor_misalignment": 3,
    "tracker_drift": 3,
    "reflector_offset": 3,
    "payload": 4,
    "link_geometry": 5,
    "tracker_frame": 3,
    "link_compliance": 6,
    "base_compliance": 6,
    "outliers": 9,
}
#: Two effects are one class when their left-overs correlate by more than this; or when one shows less than so many sigma that the other does not.
SAME_ABOVE, WITHIN_NOISE = 0.95, 2.33


@dataclass(frozen=True)
class Truth:
    """A hidden effect as the record keeps it (see generator.truth_of)."""

    kind: str
    where: str
    known: bool
    sigma: float
    sigma_kept: float
    alone: float
    z: float
    z_kept: float

    @property
    def name(self) -> str:
        return f"{self.kind} at {self.where}"

    @property
    def parameters(self) -> int:
        return PARAMETERS.get(self.kind, 1)


@dataclass(frozen=True)
class Record:
    """One trial.

    Attributes
    ----------
    said
        Per named effect everything it may be, its own name first.
    warned
        Per named effect whether the answer says that something outside the catalogue would do about as well.
    likenesses
        Of hidden effects that were named or that the catalogue lacks: how like they are to every suspect, where it was computed.
    """

    seed: int
    plan: str
    arm: str
    quantity: str
    links: bool
    hidden: tuple[Truth, ...]
    verdict: str
    said: tuple[tuple[str, ...], ...]
    warned: tuple[bool, ...]
    untestable: frozenset[str]
    level: float
    p_after: float | None
    seconds: float
    likenesses: dict[str, dict[str, float]]

    def entry_of(self, truth: Truth) -> tuple[str, ...] | None:
        """The answer's entry that an effect is in, or nothing."""
        return next((entry for entry in self.said if truth.name in entry or self._outlier(truth, entry)), None)

    def _outlier(self, truth: Truth, entry: tuple[str, ...]) -> bool:
        """An outlying step may be named by its whole experiment and the other way round."""
        if truth.kind != "outliers":
            return False
        return any(name.split(":")[0] == truth.name.split(":")[0] for name in entry)

    @property
    def wrong(self) -> tuple[tuple[str, ...], ...]:
        """Entries that hold nothing that is true."""
        true = [self.entry_of(t) for t in self.hidden]
        return tuple(entry for entry in self.said if entry not in true)

    def outside(self, truth: Truth) -> float:
        """Sigma of an unknown effect that no suspect carries; all of it where that was not computed."""
        share = max(self.likenesses.get(truth.name, {}).values(), default=0.0)
        return truth.sigma * float(max(1.0 - share**2, 0.0)) ** 0.5

    def class_of(self, truth: Truth, noise: bool) -> set[str]:
        """The oracle's class: suspects that correlate above 0.95 with a hidden effect, and with `noise` those that would fit within it.

        What such a suspect cannot show of the effect is less than the sigma that one fit excludes another by, once in a hundred.
        """
        like = self.likenesses[truth.name]
        hidden = {name: truth.sigma_kept * max(1.0 - share**2, 0.0) ** 0.5 for name, share in like.items()}
        return {name for name in like if like[name] > SAME_ABOVE or (noise and hidden[name] < WITHIN_NOISE)}

    def outcome(self, truth: Truth) -> str:
        """What became of a hidden effect: found, kind (right kind, wrong place), wrong, abstained or missed."""
        if self.entry_of(truth) is not None:
            return "found"
        if any(name.startswith(f"{truth.kind} at") for entry in self.said for name in entry):
            return "kind"
        if self.wrong:
            return "wrong"
        return "abstained" if self.verdict in ("unexplained", "partly_explained") else "missed"


def read_records(folder: Path) -> list[Record]:
    """All trials of a folder."""
    return [_record(json.loads(path.read_text(encoding="utf-8"))) for path in sorted(folder.glob("*.json"))]


def read_failures(folder: Path) -> list[tuple[str, str]]:
    """Trials that gave no answer, and the last line of why."""
    return [(p.stem, p.read_text(encoding="utf-8").strip().splitlines()[-1]) for p in sorted(folder.glob("*.failed"))]


def _record(data: dict[str, Any]) -> Record:
    t, d = data["truth"], data["document"]
    hidden = tuple(
        Truth(
            h["kind"],
            h["where"],
            h["known"],
            h["sigma"],
            h["sigma_kept"],
            h["sigma_alone"],
            h["oracle_z"],
            h["oracle_z_kept"],
        )
        for h in t["hidden"]
    )
    said = tuple(
        tuple(dict.fromkeys(f"{m['kind']} at {m['where']}" for m in [e, *e["confounded_with"]])) for e in d["effects"]
    )
    return Record(
        t["seed"],
        t["plan"],
        t["arm"],
        t["quantity"],
        t["links"],
        hidden,
        d["verdict"],
        said,
        tuple(bool(e.get("outside_the_catalogue_as_good")) for e in d["effects"]),
        frozenset(f"{u['kind']} at {u['where']}" for u in d["untestable"]),
        data["level"],
        d["gap"]["held_out_p_value_after"],
        data["seconds"],
        data.get("likenesses", {}),
    )
