"""The list of kinds. Users add theirs in a file (`register`, option --kinds) or as entry points of the group `drake_stiffness.effects`."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import TypeVar, get_args
from zlib import crc32

from drake_stiffness.effects.compliance import BaseCompliance, JointCompliance, LinkCompliance
from drake_stiffness.effects.drift import TrackerDrift
from drake_stiffness.effects.effect import Effect, Need, Station
from drake_stiffness.effects.force_sensor import ForceSensorBias, ForceSensorMisalignment, Scale
from drake_stiffness.effects.geometry import JointZeroOffset, LinkGeometry, Payload
from drake_stiffness.effects.gravity_compensator import GravityCompensator
from drake_stiffness.effects.hardening import JointHardening
from drake_stiffness.effects.harmonics import JointMeshStiffness, JointPeriodicError
from drake_stiffness.effects.hysteresis import JointHysteresis
from drake_stiffness.effects.instruments import ReflectorOffset, TrackerFrame
from drake_stiffness.effects.transmission import JointBacklash, JointCoupling
from drake_stiffness.errors import InputError

_BUILT_IN: tuple[type[Effect], ...] = (
    JointCompliance,
    LinkCompliance,
    BaseCompliance,
    GravityCompensator,
    JointBacklash,
    JointHysteresis,
    JointHardening,
    JointMeshStiffness,
    JointPeriodicError,
    JointCoupling,
    JointZeroOffset,
    LinkGeometry,
    Payload,
    ForceSensorBias,
    ForceSensorMisalignment,
    Scale,
    TrackerFrame,
    TrackerDrift,
    ReflectorOffset,
)


_registered: dict[str, type[Effect]] = {}
E = TypeVar("E", bound=type[Effect])


def register(cls: E) -> E:
    """Add a kind; as a decorator: `@register` above the class.

    Raises
    ------
    InputError
        If it is no Effect class, lacks what every kind states, or takes the name of another.
    """
    kind = _checked(cls, f"register({getattr(cls, '__name__', cls)})")
    before = _registered.get(kind)
    # The same file read again makes the same class anew; that is no second kind.
    same = before is not None and (before.__module__, before.__qualname__) == (cls.__module__, cls.__qualname__)
    if kind in {built.kind for built in _BUILT_IN} or (before is not None and not same):
        raise InputError(f"register({cls.__name__}): the kind '{kind}' exists already; choose another name.")
    _registered[kind] = cls
    effect_kinds.cache_clear()
    return cls


def load_kinds(path: Path | str) -> tuple[str, ...]:
    """Run a Python file that registers kinds; returns their names. It runs whatever the file says, as `python FILE` would.

    Raises
    ------
    InputError
        If there is no such file, it fails, or it registers nothing.
    """
    path = Path(path).resolve()
    if path.suffix != ".py" or not path.is_file():
        raise InputError(f"--kinds: found {path}; expected a Python file (.py) that registers kinds of effects.")
    name = f"{path.stem}_{crc32(str(path).encode()):08x}"  # two files may have one name
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except Exception as error:
        # The file is anybody's code, and whatever is wrong with it is the user's to mend.
        raise InputError(f"{path}{_line(error, path)}: the file fails with {type(error).__name__}: {error}.") from None
    found = tuple(kind for kind, cls in _registered.items() if cls.__module__ == name)
    if not found:
        raise InputError(
            f"{path}: registers no kind of effect; write `from drake_stiffness.effects import register` and put @register above "
            "the class (docs/effects.md shows one)."
        )
    return found


@contextmanager
def kinds_forgotten() -> Iterator[None]:
    """What is registered within is forgotten afterwards: one process may do jobs with kinds of their own."""
    before = dict(_registered)
    try:
        yield
    finally:
        _registered.clear()
        _registered.update(before)
        effect_kinds.cache_clear()


def _line(error: Exception, path: Path) -> str:
    """Where in the file it failed, as ", line 12"."""
    if isinstance(error, SyntaxError):
        return f", line {error.lineno}"
    trace, line = error.__traceback__, None
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(path):
            line = trace.tb_lineno
        trace = trace.tb_next
    return "" if line is None else f", line {line}"


def _checked(cls: object, who: str) -> str:
    """The kind's name, if the class states what every kind must."""
    if not (isinstance(cls, type) and issubclass(cls, Effect)):
        raise InputError(f"{who}: {cls!r} is not an Effect class.")
    for attribute, known in (("kind", None), ("station", get_args(Station))):
        value = getattr(cls, attribute, None)
        if not isinstance(value, str) or (known and value not in known):
            expected = " or ".join(f'"{k}"' for k in known) if known else "a name of its own"
            raise InputError(f"{who}: found {attribute} = {value!r}; expected {expected}.")
    wrong = [need for need in cls.needs if need not in get_args(Need)]
    if wrong:
        raise InputError(f"{who}: found needs {wrong}; expected some of {', '.join(get_args(Need))}.")
    return cls.kind


@lru_cache
def effect_kinds() -> dict[str, type[Effect]]:
    """All kinds by name: the built-in ones, those of files, and those that installed packages register.

    Raises
    ------
    InputError
        If a registered class is not an Effect or takes the name of another.
    """
    kinds = {cls.kind: cls for cls in _BUILT_IN} | _registered
    for point in entry_points(group="drake_stiffness.effects"):
        cls = point.load()
        kind = _checked(cls, f"entry point '{point.name}' of drake_stiffness.effects")
        if kind in kinds:
            raise InputError(f"entry point '{point.name}': the kind '{kind}' exists already; choose another name.")
        kinds[kind] = cls
    return kinds


def make_effect(kind: str, where: str, settings: dict[str, object] | None = None) -> Effect:
    """An effect by kind, place and settings.

    Raises
    ------
    InputError
        If the kind is unknown or the settings do not fit it.
    """
    kinds = effect_kinds()
    if kind not in kinds:
        raise InputError(
            f"unknown kind of effect '{kind}'; known kinds: {', '.join(sorted(kinds))}. Name the file that defines a kind of your own "
            "with --kinds FILE.py."
        )
    try:
        return kinds[kind](where, **(settings or {}))
    except TypeError as error:
        raise InputError(f"{kind} at '{where}': settings {settings} do not fit ({error}).") from None
