"""Reading what people write and writing what programs read: YAML with teaching errors, whole files, JSON without NaN."""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator

from drake_stiffness.errors import InputError


class Document(BaseModel):
    """Base of everything users write in YAML: unknown keys are errors, values are not changed afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _yes_is_no_number(cls, value: Any, info: ValidationInfo) -> Any:
        """YAML reads `yes` as a truth value, which pydantic would read as 1.0."""
        field = cls.model_fields[info.field_name] if info.field_name else None
        if isinstance(value, bool) and field is not None and field.annotation not in (bool, bool | None):
            raise ValueError(
                "expected another kind of value than a truth value (YAML reads yes and no, on and off as such)"
            )
        return value


D = TypeVar("D", bound=Document)


class _Loader(yaml.SafeLoader):
    """SafeLoader that reads `2.5e6` as a number (YAML 1.1 does not) and refuses a key written twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key_node, _ in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                mark = key_node.start_mark
                raise InputError(f"{mark.name}, line {mark.line + 1}: a key must be a word, not a list or a table.")
            if key_node.value in seen:
                mark = key_node.start_mark
                raise InputError(
                    f"{mark.name}, line {mark.line + 1}: the key '{key_node.value}' is written twice; keep one of them."
                )
            seen.add(key_node.value)
        return super().construct_mapping(node, deep=deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\d[\d_]*\.?[\d_]*|\.\d[\d_]*)([eE][-+]?\d+)?$|^[-+]?\.(inf|Inf|INF)$|^\.(nan|NaN|NAN)$"),
    list("-+0123456789."),
)


def read_bytes(path: Path, what: str) -> bytes:
    """The bytes of a file that must exist and not be empty.

    Raises
    ------
    InputError
        If there is no such file, it cannot be read, or it holds nothing.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; expected {what}. Check the path.") from None
    except IsADirectoryError:
        raise InputError(f"{path}: this is a folder; expected {what}.") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected {what}.") from None
    if not data.strip(b"\x00 \t\r\n"):
        raise InputError(f"{path}: the file is empty; expected {what}.")
    return data


def read_yaml(path: Path, document: type[D], what: str) -> D:
    """A YAML file as a validated document.

    Raises
    ------
    InputError
        If the file is missing, empty, not YAML, or does not fit; the message names file, key path, value and remedy.
    """
    data = read_bytes(path, what)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8; save the file as UTF-8 text.") from None
    loader = None
    try:
        loader = _Loader(text)  # refuses characters that no text holds
        loader.name = str(path)
        content = loader.get_single_data()
    except InputError:
        raise
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        place = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        problem = getattr(error, "problem", None) or " ".join(str(error).split())
        raise InputError(f"{path}{place}: not valid YAML ({problem}); expected {what}.") from None
    finally:
        if loader is not None:
            loader.dispose()
    if not isinstance(content, dict):
        raise InputError(f"{path}: found {short(content)}; expected {what}, that is keys with values.")
    try:
        return document.model_validate(content, context={"folder": path.parent})
    except ValidationError as error:
        raise InputError(_teach(path, error, document)) from None


def _teach(path: Path, error: ValidationError, document: type[Document]) -> str:
    """All of pydantic's findings, a line each: key path, value found, what was expected."""
    lines, findings = [], error.errors()
    for finding in findings:
        place = finding["loc"]
        if finding["type"] == "too_short" and any(
            other["loc"][: len(place)] == place for other in findings if other is not finding
        ):
            continue  # a list counts as short of the entries that are wrong, and those are said already
        keys = ".".join(str(part) for part in finding["loc"]) or "(top level)"
        if finding["type"] == "extra_forbidden":
            known = _known_keys(document, finding["loc"][:-1])
            lines.append(
                f"{path}: {keys}: unknown key (value {short(finding['input'])}).{did_you_mean(str(finding['loc'][-1]), known)} "
                f"Known keys: {', '.join(known)}."
            )
        elif finding["type"] == "missing":
            lines.append(f"{path}: {keys}: missing; add the key '{finding['loc'][-1]}'{_unit(finding['loc'])}.")
        else:
            message = (
                finding["msg"]
                .removeprefix("Value error, ")
                .replace("Input should be", "expected")
                .replace("input should be", "expected")
            )
            lines.append(
                f"{path}: {keys}: found {short(finding['input'])}; {message[0].lower() + message[1:]}{_unit(finding['loc'])}. Mend this value."
            )
    return "\n".join(lines)


def _unit(location: tuple[int | str, ...]) -> str:
    """The unit that a key carries in its name, for a message."""
    words = [str(part) for part in location if isinstance(part, str)]
    for name in reversed(words):
        found = re.search(r"_(mm|m|um|deg|rad|mrad|N|kN|Nm|kg|m_per_s2)$", name)
        if found:
            return f" (in {found[1].replace('_per_s2', '/s^2')})"
    return ""


def _known_keys(document: type[Document], location: tuple[int | str, ...]) -> list[str]:
    """The keys a document knows at a place, for the hint of an error."""
    here: Any = document
    for part in location:
        if isinstance(part, int):  # a place in a list of documents
            continue
        field = getattr(here, "model_fields", {}).get(part)
        if field is None:
            return []
        candidates = [field.annotation, *getattr(field.annotation, "__args__", ())]
        here = next((c for c in candidates if isinstance(c, type) and issubclass(c, Document)), None)
    return [field.alias or name for name, field in getattr(here, "model_fields", {}).items()]


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """A question for the known word most like this one, a wrong unit suffix included (`mass_g` for `mass_kg`), or nothing."""
    import difflib

    found = difflib.get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f" Did you mean '{found[0]}'?" if found else ""


def short(value: object) -> str:
    """A value as it was found, not too long for a message."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def write_whole(path: Path, data: bytes | str) -> None:
    """Write a file so that it appears whole or not at all (a temporary file beside it, then a rename).

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written.
    """
    write_together([(path, data)])


def write_together(outputs: list[tuple[Path, bytes | str | Path]]) -> None:
    """Write several files so that all appear whole, or none; a path stands for a finished file beside it that is renamed.

    Raises
    ------
    InputError
        If a folder does not exist or cannot be written.
    """
    staged: list[tuple[str, Path]] = []
    path = Path()
    try:
        for path, data in outputs:
            if isinstance(data, Path):
                staged.append((str(data), path))
                continue
            with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as stream:
                staged.append((stream.name, path))
                stream.write(data.encode() if isinstance(data, str) else data)
        # NamedTemporaryFile makes files private; an output has the permissions any new file would have.
        umask = os.umask(0)
        os.umask(umask)
        for name, path in staged:
            os.chmod(name, 0o666 & ~umask)
            os.replace(name, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); check that the folder exists.") from None
    finally:
        for name, _ in staged:
            if os.path.exists(name):
                os.unlink(name)


def json_text(content: object) -> str:
    """JSON of nested dicts, lists, arrays and numbers; NaN and infinities become null."""
    return json.dumps(_plain(content), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def sha256(path: Path) -> str:
    """SHA-256 of a file, for the provenance of a result."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
