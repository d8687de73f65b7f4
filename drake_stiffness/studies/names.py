"""Files that a pattern matches, and names for them: what differs in their paths."""

from __future__ import annotations

import glob
import re
from collections.abc import Sequence
from pathlib import Path, PurePath


def files_of(pattern: str, base: Path) -> list[str]:
    """Files that a pattern (`*`, `?`, `[..]`, `**`) matches, as it writes them, sorted; a plain path matches itself."""
    if glob.has_magic(pattern) and not (base / pattern).is_file():
        found = sorted(glob.glob(pattern, root_dir=base, recursive=True))
    else:
        found = [pattern]
    return [text for text in found if (base / text).is_file()]


def names_of(files: Sequence[str], patterns: Sequence[str]) -> list[str]:
    """A name for every file: its path without the parts with which all paths and patterns begin and end.

    Patterns count as paths, so that a file keeps its name when others come or go: `campaigns/*/campaign.yaml` names
    campaigns/E1/campaign.yaml "E1", alone or not.

    Parameters
    ----------
    files, patterns
        Relative to one folder.
    """
    paths = [PurePath(text).parts for text in dict.fromkeys([*files, *patterns])]
    whole = min(map(len, paths))
    begin = next((k for k in range(whole) if len({path[k] for path in paths}) > 1), whole)
    end = next((k for k in range(whole - begin) if len({path[-1 - k] for path in paths}) > 1), whole - begin)
    names = []
    for text in files:
        parts = PurePath(text).parts
        left = parts[begin : len(parts) - end]
        if end == 0 and left:  # the file's own name is part of the name, but not what kind of file it is
            left = (*left[:-1], PurePath(left[-1]).stem)
        names.append(label("-".join(left) or PurePath(text).stem))
    return names


def label(text: str) -> str:
    """A word as a part of a folder's name."""
    return re.sub(r"[^\w.+-]+", "-", text).strip("-.") or "_"
