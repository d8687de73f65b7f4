"""Which files a job depends on: those it is given and those that they name, with their SHA-256."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from drake_stiffness.files import sha256
from drake_stiffness.studies.job import Job

#: Files that belong to a robot program though nothing in it names them.
_BESIDE = {".src": (".dat", ".DAT"), ".pgx": (".dtx",)}
# Where a listing of modules stands beside one, they all may belong together.
_BESIDE |= {".mod": (".pgf",), ".prg": (".pgf",), ".pgf": (".mod", ".prg")}
_LONGEST_PATH = 1000


class Hashes:
    """SHA-256 of every file, computed once however many jobs read it."""

    def __init__(self) -> None:
        self._of: dict[Path, str] = {}
        self._named: dict[Path, tuple[Path, ...]] = {}

    def of(self, job: Job) -> dict[str, str]:
        """SHA-256 of a job's files by their path relative to the study file; one that is gone has none."""
        out: dict[str, str] = {}
        left = job.input_files()
        while left:
            path = left.pop()
            name = Path(os.path.relpath(path, job.base)).as_posix()
            if name not in out and path.is_file():
                out[name] = self._hash(path)
                left += self._files_in(path)
        return dict(sorted(out.items()))

    def _hash(self, path: Path) -> str:
        if path not in self._of:
            self._of[path] = sha256(path)
        return self._of[path]

    def _files_in(self, path: Path) -> tuple[Path, ...]:
        if path not in self._named:
            self._named[path] = tuple(named_files(path))
        return self._named[path]


def named_files(path: Path) -> Iterator[Path]:
    """Files that a file names: every text of a YAML file that is the path of a file, relative to it; a program's data files."""
    suffix = path.suffix.lower()
    if suffix in _BESIDE:
        yield from (other for end in _BESIDE[suffix] for other in path.parent.glob(f"*{end}"))
    if suffix not in (".yaml", ".yml"):
        return
    try:
        content = yaml.safe_load(path.read_bytes())
    except (yaml.YAMLError, ValueError, RecursionError):
        return  # what is wrong with it the job says
    for text in _texts(content):
        if 0 < len(text) < _LONGEST_PATH and text.isprintable() and (path.parent / text).is_file():
            yield path.parent / text


def _texts(content: Any) -> Iterator[str]:
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict):
        for value in content.values():
            yield from _texts(value)
    elif isinstance(content, list):
        for value in content:
            yield from _texts(value)
