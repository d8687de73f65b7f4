"""CAM programs through the whole job: what APT and five-axis G-code say alike is corrected alike; arcs by the command."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from drake_stiffness.cli import app
from drake_stiffness.errors import InputError
from toolpaths.formats.apt import Apt
from toolpaths.formats.gcode import GCode
from toolpaths.job import compensate
from toolpaths.linearise import linearise

# Places (mm) and turns of the spindle about z and x (deg) in the workpiece's frame.
PLACES = np.array([[20.0, 20.0, -4.0], [80.0, 25.0, -4.5], [120.0, 60.0, -5.0], [100.0, 100.0, -5.5]])
C, A = np.array([20.0, 30.0, 40.0, 25.0]), np.array([6.0, 5.0, 8.0, 4.0])
AXES = Rotation.from_euler("ZX", np.column_stack([C, A]), degrees=True).apply([0.0, 0.0, 1.0])


def apt():
    lines = [
        "GOTO/{:.5f},{:.5f},{:.5f},{:.9f},{:.9f},{:.9f}".format(*p, *axis) for p, axis in zip(PLACES, AXES, strict=True)
    ]
    return Apt().parse("\n".join(lines).encode(), "part.cl")


def gcode(scale=1.0):
    lines = [
        f"G1 X{x:.5f} Y{y:.5f} Z{z:.5f} A{a * scale:.8f} C{c * scale:.8f}"
        for (x, y, z), a, c in zip(PLACES, A, C, strict=True)
    ]
    return GCode().parse("\n".join(lines).encode(), "part.nc")


@pytest.fixture(scope="module")
def corrected(model, request):
    from conftest import process_of

    force = {"constant": {"fx_N": 240, "fy_N": 180, "fz_N": -400, "frame": "world"}}
    return {
        "apt": compensate(apt(), model, process_of(force=force)),
        "deg": compensate(gcode(), model, process_of(force=force, gcode={"rotary": "AC"})),
        "rad": compensate(gcode(np.pi / 180), model, process_of(force=force, gcode={"rotary": "AC", "unit": "rad"})),
    }


def test_apt_and_five_axis_gcode_are_corrected_alike(corrected):
    one = corrected["apt"]
    assert one.after_mm.max() < 1e-3
    assert np.linalg.norm(one.correction_mm, axis=1).min() > 0.1
    for name, dialect in (("deg", 1.0), ("rad", 180 / np.pi)):
        other = corrected[name]
        np.testing.assert_allclose(other.correction_mm, one.correction_mm, atol=2e-5)
        axes = Apt().parse(one.raw, "x").orientation
        angles = GCode().parse(other.raw, "x").orientation * dialect
        turned = Rotation.from_euler("ZX", angles[:, ::-1], degrees=True).apply([0.0, 0.0, 1.0])
        np.testing.assert_allclose(turned, axes, atol=2e-8)
        assert np.abs(turned - AXES).max() > 1e-4  # the axis was corrected, not only the place


def test_rotary_words_without_their_meaning_are_refused(model, tools):
    with pytest.raises(InputError, match="found the rotary words A, C"):
        compensate(gcode(), model, tools.process())


def test_straight_moves_instead_of_an_arc_are_corrected_and_listed(model, tools, tmp_path):
    raw = b"G54 G21\nG0 X20. Y0. Z5.\nG1 X20.000 Y0.000 Z-1.000 F800\nG2 X30.000 Y10.000 Z-1.000 I10. J0.\nG1 X60.000 Y10.000 Z-1.000\nG0 Z50.\n"
    (tmp_path / "part.nc").write_bytes(raw)
    process = "workpiece: {position_m: [1.65, -0.10, 0.75]}\nposture_deg: [0, -70, 120, 0, -50, 0]\n"
    process += "force: {constant: {fx_N: 240, fz_N: -400, frame: world}}\n"
    (tmp_path / "process.yaml").write_text(process)
    model.save(tmp_path / "model.json")

    def run(*more):
        names = ["part.nc", "--model", "model.json", "--process", "process.yaml", "-o", "out.nc", "--json", "out.json"]
        arguments = [str(tmp_path / word) if "." in word else word for word in names]
        return CliRunner().invoke(app, ["compensate", *arguments, *more])

    refused = run()
    assert isinstance(refused.exception, InputError)
    assert "line 4" in str(refused.exception)
    assert "--linearise" in str(refused.exception)
    done = run("--linearise", "0.05", "--allow-insert")
    assert done.exit_code == 0, done.output
    said = json.loads((tmp_path / "out.json").read_text())
    (arc,) = said["linearised"]
    assert (arc["line"], arc["new_line"], arc["before"]) == (4, 4, "G2 X30.000 Y10.000 Z-1.000 I10. J0.")
    straight = linearise(GCode().parse(raw, "part.nc"), 0.05)
    assert arc["after"] == straight.raw.decode().splitlines()[3:-2]
    out = (tmp_path / "out.nc").read_bytes()
    assert out.count(b"\n") == straight.raw.count(b"\n")
    assert said["residual_mm"]["max"] < 2e-3 < 0.2 < said["correction_mm"]["max"]
    assert [entry["line"] for entry in said["inserted"]] == [out.count(b"\n")]  # the rapid that must stay
