"""What an engineer does after a recheck, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drake_stiffness.diagnosis.recheck import ENOUGH_POSTURES, FEWEST_TO_LEAVE_OUT
from drake_stiffness.report import page as h

# Of untestable kinds so many are named.
_NAMED = 4


def next_steps(document: Mapping[str, Any]) -> list[str]:
    """Steps for the verdict, then what this campaign leaves open.

    Parameters
    ----------
    document : dict
        From `drake_stiffness.diagnosis.recheck_job.recheck_document`.
    """
    steps = {
        "consistent": [_keep(document)],
        "explained": _changed(document),
        "partly_explained": [*_changed(document), _whole("names what is left")],
        "unexplained": [
            "Look first at what was set up: load, load point, tracker, reflectors, the zero position of the joints, the log book.",
            "Do not predict or compensate with the stored model where its errors matter.",
            _whole("can name what a few postures cannot"),
        ],
    }[document["verdict"]]
    return [*steps, *_open(document)]


def _keep(document: Mapping[str, Any]) -> str:
    limits = [limit["rms_um"] for limit in document["not_detectable_above"]]
    least = (
        f" A change that moves these readings by less than {h.number(min(limits), 2)} to {h.number(max(limits), 2)} µm rms, by its kind (see Ruled out), would not have been seen."
        if limits
        else ""
    )
    return f"Go on with the stored model, and ask again after the next month, crash or repair.{least}"


def _changed(document: Mapping[str, Any]) -> list[str]:
    out = [
        "The model that option -o writes has the values of now. It predicts and compensates like any other; go on with it until the machine is mended."
    ]
    several = [e for e in document["effects"] if e["confounded_with"]]
    if several:
        names = "; ".join(f"{e['kind']} at {e['where']}" for e in several)
        out.append(
            f"{names}: one of a class. Before anything is taken apart, measure postures and loads that tell its members apart "
            "(drake-stiffness design --criterion ds --suspect KIND:WHERE); predictions for loads like these do not depend on which it is."
        )
    places = ", ".join(dict.fromkeys(e["where"] for e in document["effects"] if not e["confounded_with"]))
    if places:
        out.append(f"Look at {places}: what was repaired, bumped, worn or changed there since the model was made.")
    return out


def _whole(why: str) -> str:
    return f"Measure a whole campaign (20 postures, loaded and unloaded) and run drake-stiffness diagnose without --fixed: it {why}."


def _open(document: Mapping[str, Any]) -> list[str]:
    out, number = [], document["recheck"]["postures"]
    if number < FEWEST_TO_LEAVE_OUT:
        out.append(f"Measure at least {FEWEST_TO_LEAVE_OUT} postures, so that each can be predicted by the others.")
    elif number < ENOUGH_POSTURES and document["effects"]:
        out.append(
            f"With {ENOUGH_POSTURES} postures or more the choice of what changed would rest on postures that a fit did not see, and not on "
            "p-values alone."
        )
    kinds = list(dict.fromkeys(u["kind"].replace("_", " ") for u in document["untestable"]))
    if kinds:
        more = f" and {len(kinds) - _NAMED} more" if len(kinds) > _NAMED else ""
        out.append(
            f"Not answered here: {', '.join(kinds[:_NAMED])}{more}. So few postures, or such loads, cannot show them (see Untestable for what "
            "it would take); whoever suspects one of them measures that."
        )
    return out
