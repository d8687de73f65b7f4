"""Puts the examples on the import path, as their own scripts do."""

import sys
from pathlib import Path

EXAMPLES = Path(__file__).parents[2] / "examples"
for folder in (EXAMPLES, EXAMPLES / "kr270"):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
