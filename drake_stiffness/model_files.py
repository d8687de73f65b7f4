"""Robot descriptions as Drake's parser takes them: packages beside the file, model directives with relative paths."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any


def add_models(parser: Any, path: Path) -> None:
    """Let Drake's parser read the model; packages beside it and in ROS_PACKAGE_PATH are known.

    Model directives may name files relative to themselves, as everything in this project does; Drake wants a URI there.
    """
    packages = parser.package_map()
    packages.PopulateFromRosPackagePath()
    for folder in path.resolve().parents[:4]:
        if (folder / "package.xml").is_file():
            packages.PopulateFromFolder(str(folder))
            break
    if path.suffix not in (".yaml", ".yml"):
        parser.AddModels(str(path))
        return
    packages.PopulateFromFolder(str(path.resolve().parent))
    text = path.read_text(encoding="utf-8")
    folder = path.resolve().parent
    relative = r"""(\bfile:\s+)(['"]?)(?![a-z]+://)([^'"\s,}]+)\2"""
    absolute = re.sub(relative, lambda m: f"{m[1]}{m[2]}file://{(folder / m[3]).resolve()}{m[2]}", text)
    parser.AddModelsFromString(absolute, "dmd.yaml")
