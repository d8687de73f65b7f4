"""Rules that the packages keep: solvers named, Drake in one file, nothing heavy where a shop-floor machine runs."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = sorted([*(ROOT / "drake_stiffness").rglob("*.py"), *(ROOT / "toolpaths").rglob("*.py")])


def test_there_are_files_to_look_at():
    assert len(FILES) > 25


def imports(path):
    """Modules that a file imports when it runs (what only the type checker reads is no dependence)."""
    tree = ast.parse(path.read_text())
    for_types = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if node in for_types:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_conic_program_names_its_solver(path):
    """Drake's wheel brings a MOSEK without licence, and cvxpy would pick it. Files without cvxpy cannot mean it: `cone_program` is
    Clarabel itself, and others call its `solve`."""
    if "cvxpy" not in {name.split(".")[0] for name in imports(path)}:
        return
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "solve":
            if isinstance(node.func.value, ast.Attribute) and node.func.value.attr == "linalg":
                continue  # numpy.linalg.solve, scipy.linalg.solve
            if isinstance(node.func.value, ast.Name) and node.func.value.id == "self":
                continue  # a method of the project's own
            named = [keyword.value for keyword in node.keywords if keyword.arg == "solver"]
            assert named, f"{path}:{node.lineno}: .solve() without a solver"
            assert "CLARABEL" in ast.unparse(named[0])


def test_only_plant_py_imports_drake_and_never_all_of_it():
    for path in FILES:
        drake = [name for name in imports(path) if name.split(".")[0] == "pydrake"]
        assert "pydrake.all" not in drake, path
        if path != ROOT / "drake_stiffness" / "plant.py":
            assert not drake, path


def test_drake_stiffness_does_not_know_toolpaths_but_for_its_commands():
    for path in FILES:
        if path.is_relative_to(ROOT / "drake_stiffness") and path.parent.name != "commands":
            assert not [name for name in imports(path) if name.split(".")[0] == "toolpaths"], path


BLOCK = """
import sys
class Block:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("pydrake", "cvxpy", "matplotlib", "clarabel"):
            raise ImportError(f"{name} is blocked")
sys.meta_path.insert(0, Block())
"""
PREDICT = """
import numpy as np
from drake_stiffness.model import load_model
from drake_stiffness.effects.effect import Cases
from drake_stiffness.simulation import simulate_displacement
from drake_stiffness.support import displacement_support
import drake_stiffness.equilibrium, drake_stiffness.sensitivity, drake_stiffness.campaign
model = load_model(sys.argv[1])
cases = Cases(np.full((6, 1), 0.3), np.array([[0.0], [0], [-1000.0], [0], [0], [0]]), model.load_point)
d = simulate_displacement(model, cases, np.array([0]), np.array(["P1"]))
s = displacement_support(model, cases, np.array([0]), np.array(["P1"]))
print(*d.dp[:, 0], s.unsupported[0])
"""


def run(code, *arguments):
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, cwd=ROOT, timeout=60
    )


def test_a_stored_model_predicts_where_neither_drake_nor_cvxpy_can_be_imported(tmp_path, arms, cells, judges):
    import numpy as np

    from drake_stiffness.assembly import make_model
    from drake_stiffness.effects.compliance import JointCompliance

    arm, cell = arms["kr270"], cells["kr270"]
    k = np.full(6, 1e-6)
    make_model(cell, arm, [JointCompliance(n) for n in arm.joint_names], k).save(tmp_path / "model.json")
    done = run(BLOCK + PREDICT, str(tmp_path / "model.json"))
    assert done.returncode == 0, done.stderr
    found = np.array(done.stdout.split(), dtype=float)[:3]
    point, ends = np.array(cell.reference_points_m["P1"]), []
    for load in (-1000.0, 0.0):
        wrench = np.array([0, 0, load, 0, 0, 0])
        X, _, _ = judges["kr270"].equilibrium(np.full(6, 0.3), wrench, cell.load_point_m, k, [None] * 7)
        ends.append(X[:3, :3] @ point + X[:3, 3])
    assert found == pytest.approx(ends[0] - ends[1], abs=1e-9)


def test_the_block_blocks():
    assert run(BLOCK + "import pydrake").returncode != 0
    assert run(BLOCK + "import cvxpy").returncode != 0


def test_importing_the_package_is_cheap():
    done = run(
        "import sys, drake_stiffness; print([m for m in ('pydrake', 'cvxpy', 'matplotlib', 'numpy') if m in sys.modules])"
    )
    assert done.stdout.strip() == "[]"
