"""What a report says besides its subject: warnings with their meaning, and where everything came from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drake_stiffness.report import page as h

if TYPE_CHECKING:
    from drake_stiffness.jobs import Identified

# First word of a warning (see `statistics.warnings_of`) -> what it means to somebody who did not write it.
_MEANING = {
    "NOT TRUSTWORTHY": "A small standard deviation is no proof: it holds only if the model has all that bends the arm. Do not use this "
    "value; find what is missing.",
    "COLLINEAR": "The readings see the combination, and hardly its members. Postures or loads that tell them apart would help.",
    "HIDDEN": "It is left where it was, and no prediction of loads like these depends on it.",
    "SINGLE POSTURE": "Measure other postures.",
    "NEVER MOVED": "Postures in which these joints differ would tell the springs apart.",
    "ONE LOAD DIRECTION": "Predictions for loads in other directions are not supported.",
    "FEW READINGS": "More postures, loads or points are needed.",
    "NOT SEEN": "Its value in the model is a convention. Loads, postures or points that move it would reveal it.",
    "NOT REVEALED": "The joint may be stiff, or the loads hardly turn it; the campaign cannot say which.",
    "MERGED": "Whatever the fit, these loads and points show sums only. Do not quote a merged value as the stiffness of that part; "
    "predictions for similar loads and points do not suffer.",
    "BOUNDED": "The best fit without the constraint would be slightly non-physical there (a compliance below zero in some direction, "
    "usually because the part is stiffer than the noise resolves); the value was held at the edge of what a passive spring can do.",
    "NOISE REJECTED": "Either a physical effect is missing in the model or the readings are noisier than stated. All intervals below "
    "were widened accordingly.",
    "NOISE TOO LARGE": "State a smaller noise in campaign.yaml if that is what the tracker really has.",
    "NOT PHYSICAL": "A passive structure cannot have it. Method sdp excludes it.",
    "NO CHECK": "With as many unknowns as readings every model fits; nothing here is confirmed.",
}


def warnings(result: Identified) -> h.Markup:
    """Call-outs, those of one kind together."""
    kinds: dict[str, list[str]] = {}
    for line in result.warnings:
        head, colon, text = line.partition(": ")
        kinds.setdefault(head if colon and head.isupper() else "", []).append(
            text if colon and head.isupper() else line
        )
    found = []
    for head, texts in kinds.items():
        texts = [text if set("_.=") & set(text.split(" ")[0]) else text[:1].upper() + text[1:] for text in texts]
        said: object = texts[0] if len(texts) == 1 else h.bullets(texts)
        found.append(h.callout(f"{head}." if head else "", said, _MEANING.get(head, "")))
    return h.join(*found)


def provenance(found: dict[str, Any], fit: dict[str, Any], level: int) -> h.Markup:
    """Versions, input files with their SHA-256, seed, time."""
    rows: list[tuple[object, object, object]] = [
        (
            what,
            entry.get("file", ""),
            h.join(h.Markup('<span class="mono">'), entry.get("sha256", ""), h.Markup("</span>")),
        )
        for what, entry in found.get("inputs", {}).items()
    ]
    seed = found.get("seed")
    text = f"{found.get('program', 'unknown program')}; seed of the hold-out {seed if seed is not None else 'none'}; {found.get('time', '')}"
    return h.section("Provenance", h.paragraph(text), h.table(("input", "file", "SHA-256"), rows), level=level)
