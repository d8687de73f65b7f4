"""Small programs that mill, and the processes they are milled with."""

from __future__ import annotations

import numpy as np

from toolpaths.compensation import bench_of
from toolpaths.forces import loads
from toolpaths.loaded_path import targets
from toolpaths.process import read_process

AL = "{Ktc: 767.01, Krc: 168.8, Kac: 222, Kte: 27.7, Kre: 26.6, Kae: 0.7}"
CUTTER = f"diameter_mm: 20, teeth: 4, helix_deg: 30, spindle_rpm: 6000, coefficients: {AL}"
SLOT = f"diameter_mm: 20, teeth: 4, helix_deg: 30, spindle_rpm: 6000, axial_depth_mm: 3, radial_depth_mm: 20, mode: slot, coefficients: {AL}"
MEAN = np.array([-152.2, 335.9, 89.0])
DOWN = "A 0.000,B 0.000,C 180.000"  # tool z into the workpiece, tool x along the base's x


def process(tmp_path, milling=SLOT, more="", feed=", feed_mm_per_min: 2400", rotation=", rotation: clockwise"):
    """A process; the spindle turns clockwise unless `milling` or `rotation` say otherwise."""
    feed += "" if "rotation:" in milling else rotation
    (tmp_path / "process.yaml").write_text(
        f"workpiece: {{position_m: [1.8, 0, 0.8]}}\nposture_deg: [0, -70, 120, 0, -50, 0]\n{more}\n"
        f"force: {{milling: {{{milling}{feed}}}}}\n"
    )
    return read_process(tmp_path / "process.yaml")


def load(program, process, model):
    R, p = targets(program, process, bench_of(model, "unloaded", False), np.radians([0, -70, 120, 0, -50, 0.0]))
    rows = np.flatnonzero(program.corrected)
    return loads(process, program, rows, p, R[rows])


def along(tools, *points, pose=DOWN):
    return tools.program(*(f"LIN {{X {x:.3f},Y {y:.3f},Z {z:.3f},{pose}}}" for x, y, z in points))


STRAIGHT = ((0, 0, 0), (10, 0, 0), (20, 0, 0))


def stated(a, w, mode) -> str:
    """The cutter with its engagement."""
    return f"{CUTTER}, axial_depth_mm: {a}, radial_depth_mm: {w}, mode: {mode}"


def swept(low, high) -> str:
    """The cutter in a block 3 mm high between two y."""
    return f"{CUTTER}, heightfield: {{cell_mm: 0.5, stock: {{x_mm: [0, 60], y_mm: [{low}, {high}], top_mm: 3}}}}"
