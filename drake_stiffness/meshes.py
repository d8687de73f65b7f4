"""Meshes are never needed: a missing one is a warning."""

from __future__ import annotations

import logging
import re
from pathlib import Path

log = logging.getLogger("drake_stiffness")


def warn_of_missing_meshes(path: Path) -> None:
    """Say which meshes are not there; they are never needed."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return
    found = re.findall(r"""<mesh\b[^>]*\bfile(?:name)?\s*=\s*["']([^"']+)["']""", text)  # URDF, MJCF
    found += re.findall(r"<mesh>.*?<uri>\s*([^<]+?)\s*</uri>", text, re.DOTALL)  # SDF
    for name in sorted(set(found)):
        local = name.split("://", 1)[-1] if "://" in name else name
        if not any(candidate.exists() for candidate in (path.parent / local, path.parent / Path(local).name)):
            log.warning("%s: the mesh '%s' is not there; it is not needed, only pictures lack it.", path, name)
