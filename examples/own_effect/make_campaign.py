"""Writes measurements.csv: 12 postures on an arm whose joint 2 creeps. Same seed, same bytes.

The truth is examples/plants/creep.py, which knows nothing of joint_creep.py beside this file.

Run: python examples/own_effect/make_campaign.py
"""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from kr270_hidden.make_campaign import make_table as campaign_of  # noqa: E402
from plants.creep import Creep  # noqa: E402

SEED = 272
POSTURES = 12
# Joint 2: beside its 0.302 urad/(N m) another 0.06 that come late, with 80 s.
HIDDEN = Creep(joint=1, compliance=0.06e-6, relaxation_s=80.0)


def make_table() -> str:
    """The campaign as the text of measurements.csv."""
    return campaign_of((HIDDEN,), POSTURES, SEED, cell_file=HERE / "cell.yaml", rigid_links=True)


def main() -> None:
    """Write measurements.csv beside this file."""
    table = make_table()
    (HERE / "measurements.csv").write_text(table, encoding="utf-8", newline="")
    print(f"measurements.csv: {len(table.splitlines()) - 1} readings (simulated)")


if __name__ == "__main__":
    main()
