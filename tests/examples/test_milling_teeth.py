"""docs/milling.md says what the example gives."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_every_row_that_the_example_makes_stands_on_the_page(tmp_path):
    words = [sys.executable, str(ROOT / "examples" / "milling" / "teeth.py"), str(tmp_path)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    ours = [line for line in (tmp_path / "milling.md").read_text().splitlines() if line.startswith("|")]
    page = (ROOT / "docs" / "milling.md").read_text()
    assert len(ours) == 7
    for row in ours:
        assert row in page
    assert (tmp_path / "milling.svg").read_bytes() == (ROOT / "docs" / "milling.svg").read_bytes()
