"""What the commands take, read off the functions behind them: their arguments, options and the files they write."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints

#: Options that name what a command writes, and the name that a study gives it; `json` is always written.
WRITTEN = {
    "output": "",
    "json": "result.json",
    "report": "report.html",
    "scene": "scene.html",
    "points": "points.csv",
    "handover": "handover",
    "krl": "plan.src",
    "sheet": "sheet.html",
    "ordered": "ordered.csv",
}
#: What `-o` writes, by command; "." is the job's folder itself, nothing stands for the name of the input.
OUTPUTS = {
    "simulate": ".",
    "design": "plan.csv",
    "identify": "model.json",
    "reduce": "model.json",
    "restore": "restored.json",
    "diagnose": "model.json",
    "predict": "predicted.csv",
    "compensate": "",
    "map": "map.csv",
    "import": "measurements.csv",
}
_WORDS: dict[type, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a word",
    Path: "a file",
}


@dataclass(frozen=True)
class Parameter:
    """An argument or an option of a command.

    Attributes
    ----------
    name
        The word a study file uses: of an option the one after its dashes, with "_" for "-".
    flag
        How the option is written on the command line; nothing for an argument.
    kind
        bool, int, float, str or Path.
    many
        Whether it may be given several times.
    required
    low, high
        Limits of a number.
    """

    name: str
    flag: str
    kind: type
    many: bool
    required: bool
    low: float | None = None
    high: float | None = None

    @property
    def is_input(self) -> bool:
        """Whether it names a file that is read."""
        return self.kind is Path and self.name not in WRITTEN

    def fault(self, value: Any) -> str:
        """What is wrong with a value, "expected ..."; nothing if it fits."""
        if self.many and isinstance(value, list):
            return next((said for said in map(self._fault_of_one, value) if said), "")
        return self._fault_of_one(value)

    def _fault_of_one(self, value: Any) -> str:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        fits = {
            bool: isinstance(value, bool),
            int: number and float(value).is_integer(),
            float: number,
            str: number or isinstance(value, str),
            Path: isinstance(value, str) and value != "",
        }[self.kind]
        low, high = self.low, self.high
        if fits and (not number or ((low is None or value >= low) and (high is None or value <= high))):
            return ""
        limits = ("" if low is None else f", at least {low:g}") + ("" if high is None else f", at most {high:g}")
        return f"expected {_WORDS[self.kind]}{limits}" + (", or a list of such" if self.many else "")


@cache
def commands() -> dict[str, tuple[Parameter, ...]]:
    """Every command that can be a job, with its arguments and options in order."""
    from drake_stiffness.cli import app

    found = {}
    for entry in app.registered_commands:
        if entry.name not in (None, "study") and entry.callback is not None:
            hints = get_type_hints(entry.callback, include_extras=True)
            signature = inspect.signature(entry.callback).parameters
            found[str(entry.name)] = tuple(
                _parameter(name, hints[name], signature[name].default is inspect.Parameter.empty) for name in signature
            )
    return found


def _parameter(name: str, hint: Any, required: bool) -> Parameter:
    from typer.models import OptionInfo

    annotation, info = get_args(hint)[:2]
    kinds = [part for part in (get_args(annotation) or (annotation,)) if part is not NoneType]
    if get_origin(annotation) is not list and kinds and get_origin(kinds[0]) is list:
        annotation, kinds = kinds[0], list(get_args(kinds[0]))
    many = get_origin(annotation) is list
    if not isinstance(info, OptionInfo):
        return Parameter(name, "", kinds[0], many, required)
    # In an annotation the first word of an option stands where its default would.
    words = [str(word) for word in (info.default, *(info.param_decls or ())) if str(word).startswith("--")]
    flag = words[0] if words else "--" + name.replace("_", "-")
    return Parameter(flag[2:].replace("-", "_"), flag, kinds[0], many, required, info.min, info.max)
