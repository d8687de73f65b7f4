"""The commands `shop` and `import` as users type them: what they write, and that nothing is left behind when they refuse."""

import json
import shutil
from pathlib import Path

import pytest
from command_line import call

ROOT = Path(__file__).parents[1]


def run(folder, *words):
    return call(*words, folder=folder)


@pytest.fixture
def shop(tmp_path):
    shutil.copytree(ROOT / "examples" / "shop", tmp_path / "shop")
    (tmp_path / "kr270").mkdir()
    shutil.copy(ROOT / "examples" / "kr270" / "kr270.urdf", tmp_path / "kr270")
    return tmp_path / "shop"


def test_shop_says_what_it_wrote_and_in_which_order(shop):
    done = run(
        shop, "shop", "PLAN.csv", "--cell", "cell.yaml", "--krl", "m.src", "--order", "short", "--json", "r.json"
    )
    assert done.code == 0, done.err
    found = json.loads((shop / "r.json").read_text())
    assert sorted(found["experiments"]) == [f"E{k:02d}" for k in range(1, 15)]
    assert found["words"] == {f"A{k}": f"joint_{k}" for k in range(1, 7)}
    assert found["steps"] == 70
    program = (shop / "m.src").read_text()
    assert program.index(f"experiment {found['experiments'][0]}") < program.index(
        f"experiment {found['experiments'][1]}"
    )
    assert "14 experiments, 70 steps" in done.err


def test_a_plan_whose_neighbours_share_a_posture_is_warned_of(shop):
    rows = (shop / "PLAN.csv").read_text().splitlines()
    again = [row for row in rows if row.startswith(("E01", "E13"))]
    (shop / "PLAN.csv").write_text("\n".join([rows[0], *again]) + "\n")
    done = run(shop, "shop", "PLAN.csv", "--cell", "cell.yaml", "--sheet", "s.html")
    assert done.code == 0
    assert "'E01' and 'E13' have the same posture and follow each other" in done.err
    done = run(shop, "shop", "PLAN.csv", "--cell", "cell.yaml", "--krl", "s.src", "--via-deg=0,-90,90,0,0,0")
    assert "same posture" not in done.err


REFUSED = {
    "nothing to write": ((), "nothing to write"),
    "a name no controller takes": (("--krl", "1.src"), "1 to 24 letters"),
    "another suffix": (("--krl", "m.txt"), "ends in .src"),
    "an unknown order": (("--sheet", "s.html", "--order", "fast"), "expected plan, short or random"),
    "over an input": (("--ordered", "PLAN.csv"), "this is an input"),
    "too fast": (("--krl", "m.src", "--speed-percent", "100"), "1 to 50 %"),
    "a safe posture of five joints": (("--krl", "m.src", "--via-deg", "0,0,0,0,0"), "found 5 numbers"),
    "a safe posture out of reach": (("--krl", "m.src", "--via-deg", "0,90,0,0,0,0"), "outside the limits of joint 'joint_2'"),
    "words for numbers": (("--krl", "m.src", "--via-deg", "a,b"), "expected numbers"),
}  # fmt: skip


@pytest.mark.parametrize("name", list(REFUSED))
def test_shop_refuses_and_leaves_nothing_behind(shop, name):
    words, said = REFUSED[name]
    before = {p.name: p.read_bytes() for p in shop.iterdir()}
    done = run(shop, "shop", "PLAN.csv", "--cell", "cell.yaml", *words)
    assert done.code == 2
    assert said in " ".join(done.err.split())
    assert {p.name: p.read_bytes() for p in shop.iterdir()} == before


def test_import_lists_what_it_leaves_out(shop):
    run(shop, "shop", "PLAN.csv", "--cell", "cell.yaml", "--ordered", "driven.csv", "--order", "random", "--seed", "7")
    text = (shop / "tracker.txt").read_text()
    (shop / "tracker.txt").write_text(text + "211;Nest;09:00:00;1,0;2,0;3,0\n")
    done = run(shop, "import", "MAP.yaml", "-o", "m.csv")
    assert done.code == 2
    assert "tracker.txt, line 213: the points 'Nest' are none of the cell's (P1, P2, P3)" in done.err
    assert not (shop / "m.csv").exists()
    (shop / "MAP.yaml").write_text((shop / "MAP.yaml").read_text() + "unmatched: list\n")
    done = run(shop, "import", "MAP.yaml", "-o", "m.csv")
    assert done.code == 0, done.err
    assert "left out, belongs nowhere: tracker.txt, line 213" in " ".join(done.out.split())
    assert "Noise of a coordinate seen from steps that repeat a load" in " ".join(done.out.split())


@pytest.mark.parametrize("output", ["tracker.txt", "force.log", "MAP.yaml", "cell.yaml"])
def test_import_does_not_overwrite_what_it_reads(shop, output):
    done = run(shop, "import", "MAP.yaml", "-o", output)
    assert done.code == 2
    assert "this is an input" in done.err
