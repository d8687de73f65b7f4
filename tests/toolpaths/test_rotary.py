"""Rotary words of five-axis G-code: what is declared, what follows, what is refused."""

import numpy as np
import pytest
from contract import holds_contract
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from drake_stiffness.errors import InputError
from toolpaths.conventions import KUKA
from toolpaths.formats import read_again
from toolpaths.formats.gcode import GCode
from toolpaths.rewriting import rewrite
from toolpaths.rotary import RotaryAxes, declare

Z = np.array([0.0, 0.0, 1.0])


def axes(rotary, **more):
    return RotaryAxes.model_validate({"rotary": rotary, **more}).convention()


def tool_axis(rotary, values, **more):
    return axes(rotary, **more).rotation(np.atleast_2d(np.array(values, dtype=float)))[:, :, 2]


def tilted(R, by_deg, seed=0):
    """The same rotations, tilted by a small angle in any direction."""
    turn = np.random.default_rng(seed).normal(0, 1, (len(R), 3))
    turn *= np.radians(by_deg) / np.linalg.norm(turn, axis=1, keepdims=True)
    return Rotation.from_rotvec(turn).as_matrix() @ R


def test_each_axis_turns_about_its_own_letter_from_the_workpiece_to_the_tool():
    np.testing.assert_allclose(tool_axis("AC", [90, 0]), [[0, -1, 0]], atol=1e-15)
    np.testing.assert_allclose(tool_axis("AC", [90, 90]), [[1, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(tool_axis("BC", [90, 90]), [[0, 1, 0]], atol=1e-15)
    for rotary, letters in (("AC", "zx"), ("BC", "zy"), ("AB", "xy"), ("BA", "yx")):
        angles = {"x": 30.0, "y": 40.0, "z": 70.0}
        expected = Rotation.from_euler(letters.upper(), [angles[c] for c in letters], degrees=True).apply(Z)
        words = sorted(rotary)
        values = [angles["xyz"["ABC".index(word)]] for word in words]
        np.testing.assert_allclose(tool_axis(rotary, values)[0], expected, atol=1e-12)
    np.testing.assert_allclose(tool_axis("CA", [30, 70]), tool_axis("AC", [30, 70]))
    np.testing.assert_allclose(tool_axis("A", [30]), [[0, -0.5, np.sqrt(0.75)]])


def test_sense_and_zero_are_declared():
    np.testing.assert_allclose(tool_axis("AC", [-30, 10], reversed=["A"]), tool_axis("AC", [30, 10]), atol=1e-15)
    np.testing.assert_allclose(tool_axis("AC", [30, 100], zero_deg={"C": 90}), tool_axis("AC", [30, 10]), atol=1e-15)
    assert axes("ABC") is KUKA


@pytest.mark.parametrize("rotary", ["AC", "BC", "AB", "BA"])
def test_a_tilted_axis_is_found_near_the_angles_the_program_had(rotary):
    convention = axes(rotary, reversed=[rotary[0]], zero_deg={rotary[1]: 12.0})
    values = np.column_stack([np.linspace(-170, 200, 40), np.linspace(20, 70, 40)])[
        :, :: (-1 if rotary in ("AC", "BC") else 1)
    ]
    values[:, 0 if rotary in ("AC", "BC") else 1] = np.linspace(20, 70, 40)
    R = tilted(convention.rotation(values), 0.05)
    found = convention.near(R, values)
    np.testing.assert_allclose(convention.rotation(found)[:, :, 2], R[:, :, 2], atol=1e-12)
    assert np.abs(found - values).max() < 0.5
    np.testing.assert_array_equal(convention.near(convention.rotation(values), values), values)


def test_at_the_pole_the_outer_axis_does_not_swing():
    values = np.array([[0.0, 33.0], [0.3, 33.0], [10.0, 33.0]])
    convention = axes("AC")
    R = tilted(convention.rotation(values), 0.02)
    found = convention.near(R, values)
    assert found[:2, 1].tolist() == [33.0, 33.0]
    assert 0 < abs(found[2, 1] - 33.0) < 0.2
    assert np.abs(found[:, 0] - values[:, 0]).max() < 0.03


def test_one_axis_comes_as_near_as_one_axis_can():
    convention = axes("A")
    R = Rotation.from_euler("xy", [20.0, 0.1], degrees=True).as_matrix()[None]
    found = convention.near(R, np.array([[19.0]]))
    tried = np.linspace(19, 21, 20001)
    best = tried[np.argmax(convention.rotation(tried[:, None])[:, :, 2] @ R[0, :, 2])]
    assert found[0, 0] == pytest.approx(best, abs=2e-4)


def program(raw=b"G0 X0 Y0 Z9 A0 C0\nG1 X1.000 Y0.000 Z0.000 A30.0000 C20.0000\nX2.000\n"):
    return GCode().parse(raw, "part.nc")


def test_a_program_with_rotary_words_needs_their_meaning(tmp_path):
    where = tmp_path / "process.yaml"
    with pytest.raises(
        InputError, match=r"part.nc, line 1: found the rotary words A, C.*process.yaml does not declare"
    ):
        declare(program(), None, where)
    with pytest.raises(InputError, match=r"rotary: BC.*Make the two agree"):
        declare(program(), RotaryAxes(rotary="BC"), where)
    with pytest.raises(InputError, match="never writes B"):
        declare(program(), RotaryAxes(rotary="ABC"), where)
    three = program(b"G1 X1 Y2 Z3\n")
    assert declare(three, RotaryAxes(rotary="AC"), where) is three
    for wrong in (
        {"rotary": "C"},
        {"rotary": "AC", "reversed": ["B"]},
        {"rotary": "ABC", "zero_deg": {"A": 1}},
        {"rotary": "AC", "unit": "grad"},
    ):
        with pytest.raises(ValidationError):
            RotaryAxes.model_validate(wrong)


@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_angles_are_read_corrected_and_read_again_in_their_unit(unit, tmp_path):
    found = declare(program(), RotaryAxes(rotary="AC", unit=unit), tmp_path / "p.yaml")
    scale = 1.0 if unit == "deg" else np.degrees(1)
    np.testing.assert_allclose(found.orientation[1], np.array([30, 20]) * scale)
    by = np.array([0, 0, 0.0002]) * scale
    out = rewrite(found, found.position_mm, found.orientation + by[1:], np.ones(3, bool))
    # The last line keeps its angles, so those it keeps them from must not change either.
    assert out.raw == found.raw
    alone = declare(
        program(b"G1 X1.0 Y0.0 Z0.0 A30.0000 C20.0000\n"), RotaryAxes(rotary="AC", unit=unit), tmp_path / "p.yaml"
    )
    out = rewrite(alone, alone.position_mm, alone.orientation + by[1:], np.ones(1, bool))
    assert out.raw == b"G1 X1.0 Y0.0 Z0.0 A30.0000 C20.0002\n"
    back = read_again(alone, out.parts)
    assert back.convention == alone.convention
    np.testing.assert_allclose(back.orientation, alone.orientation + by[1:])


def test_a_rotary_word_that_no_line_has_written_yet_is_not_known():
    found = program(b"G1 X0 Y0 Z0 A0\nX1 C0\nX2\nX3 B1\n")
    assert [r.line for r in found.refusals] == [1, 2, 3]
    assert "B, C not written here" in found.refusals[0].reason
    assert found.convention.words == ("A", "B", "C")
    five = program(b"G1 X0 Y0 Z0 A0 C0\nG43.4 H1\nX1 A5\n")
    assert "Y, Z not written here and not known: G43.4 in line 2" in five.refusals[0].reason


class FiveAxes:
    """G-code as a process reads it that says what A and C are."""

    def parse(self, raw, path, others=()):
        return declare(GCode().parse(raw, path, others), RotaryAxes(rotary="AC"), path)


@st.composite
def five_axis_programs(draw):
    """Text whose lines write all five words, and the spans of the numbers of feed moves."""
    text, spans = "", []
    for _ in range(draw(st.integers(1, 6))):
        feed, blank = draw(st.booleans()), draw(st.sampled_from(["", " "]))
        text += draw(st.sampled_from(["", "N10 ", "(A9 C9) ", "; A1\n"])) + ("G1" if feed else "G0")
        for word in draw(st.permutations("XYZAC")):
            sign, decimals = draw(st.sampled_from(["", "-"])), draw(st.sampled_from(["", ".", ".5", ".2500", ".12345"]))
            token = f"{sign}{draw(st.integers(0, 170))}{decimals}"
            text += " " + word + blank
            spans += [(len(text), len(text) + len(token))] if feed else []
            text += token
        text += draw(st.sampled_from([" F200", ""])) + draw(st.sampled_from(["\n", "\r\n"]))
    return text, spans


@settings(max_examples=25, deadline=None)
@given(five_axis_programs(), st.integers(0, 2**32 - 1))
def test_generated_five_axis_programs_keep_every_byte_that_is_no_number_of_a_pose(generated, seed):
    text, movable = generated
    program, _ = holds_contract(FiveAxes(), text.encode("latin-1"), movable, seed)
    assert program.carries_force.sum() * 5 == len(movable)
