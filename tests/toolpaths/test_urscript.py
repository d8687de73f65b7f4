"""URScript: poses in metres and rotation vectors, named poses, frames, and what a rewrite leaves alone."""

import numpy as np
import pytest
from contract import holds_contract
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_stiffness.errors import InputError
from toolpaths.formats import DIALECTS, urscript
from toolpaths.formats.urscript import UrScript
from toolpaths.process import check_frames
from toolpaths.rewriting import rewrite

P1 = "p[0.001,0.002, .003,0.1,-0.2,0.3]"
P2 = "p[0.5000, -0.25, 1.0, 0, 3.14159, 0]"


def parse(*lines):
    return UrScript().parse("\n".join(lines).encode("latin-1"), "test.script")


@pytest.mark.parametrize(
    "text",
    [
        f"movel({P1}, a=1.2, v=0.1, r=0.001)",
        f"  movel( {P1} , 1.2, 0.1, 0, 0.001)  # movel({P2})\r",
        f"movep(pose={P1}, v=0.1)",
        f"movel(v=0.1, pose={P1})",
        f"global w1 = {P1}\nmovel(w1, a=1.2, v=0.1, t=0)",
        f"speed = 0.1\nw_1={P1}\nwhile i < 3:\n  movel(w_1, v=speed)\nend",
        "movel(p[0.001,\n  0.002, .003, # x\n 0.1,-0.2,0.3],\n v=0.1)",
        f'textmsg("movel({P2})"); movel({P1}, v=0.1)',
        f"if x > 1: movel({P1}, v=0.1) end",
    ],
)
def test_spelling_does_not_change_a_pose(text):
    program = parse("def main():", text, "end")
    assert not program.refusals
    np.testing.assert_allclose(program.position_mm, [[1, 2, 3]], rtol=1e-15)
    np.testing.assert_array_equal(program.orientation, [[0.1, -0.2, 0.3]])
    np.testing.assert_allclose(program.feed_mm_per_min, [6000.0])
    assert program.carries_force.all()


def test_blend_radii_are_read_where_each_call_has_them():
    lines = [
        f"movel({P1}, a=1, v=0.1, r=0.001)",
        f"movel({P1}, 1, 0.1, 0, 0.0025)",
        f"movep({P1}, 1, 0.1, 0.004)",
        f"movec({P1}, {P2}, 1, 0.1, 0.003)",
        f"movel({P1}, 1, 0.1)",
        f"movel({P1}, 1, 0.1, r=2*rad)",
    ]
    program = parse(*lines)
    np.testing.assert_allclose(program.blend_mm, [1.0, 2.5, 4.0, 0.0, 3.0, 0.0, np.nan])
    np.testing.assert_allclose(program.feed_mm_per_min, 6000.0)


def test_ordinary_lines_read_the_same_by_the_general_reader(monkeypatch):
    lines = [f"  move{'ljp'[n % 3]}(p[0.{n}, {n}, -0.5,0,0,{n}e-1], a=1, v=0.{n}, r=0)" for n in range(9)]
    quick = parse(*lines)
    monkeypatch.setattr(urscript.words, "ORDINARY", urscript.re.compile(b"(?!)"))
    general = parse(*lines)
    for name in (
        "line",
        "kind",
        "pose",
        "span",
        "source",
        "refused",
        "carries_force",
        "feed_mm_per_min",
        "blend_mm",
        "follows",
    ):
        np.testing.assert_array_equal(getattr(quick, name), getattr(general, name), err_msg=name)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (f"movel(pose_add(w2, {P1}), a=1)", "computed while the script runs"),
        (f"movel(pose_trans(plane, {P1}), a=1)", "'plane', whose value is not one literal"),
        ("movel(w2)", "not assigned a literal pose"),
        ("movel(p[x, 0, 0, 0, 0, 0])", "computed"),
        ("movel(p[0, 0, 0, 0, 0])", "computed"),
        ("movel([0,1,2,3,4,5])", "joint positions"),
        ("movec(p[0,0,0,0,0,0])", "no pose"),
        ("movel()", "no pose"),
        ("speedl([0,0,0,0,0,0], a=5)", "speedl"),
        (f"servoc({P1}, a=1)", "servoc"),
        ("movel(p[0,0,0,0,0,0]", "not closed"),
    ],
)
def test_targets_that_are_not_in_the_text_are_refused_with_line_and_reason(line, reason):
    program = parse("def main():", "  " + line, "end")
    (refusal,) = program.refusals
    assert reason in refusal.reason
    assert (refusal.line, program.corrected.any()) == (2, False)


def test_joint_moves_carry_no_force():
    program = parse(
        "q = [0,1,2,3,4,5]",
        "movej(q)",
        "movej([0,1,2,3,4,5], a=1)",
        f"movej({P1})",
        f"movej(get_inverse_kin({P1}))",
        f"movec({P1}, {P2}, a=1, v=0.1, r=0)",
    )
    assert program.kind.tolist() == ["MOVEJ", "MOVEC", "MOVEC"]
    assert program.carries_force.tolist() == [False, True, True]
    assert program.role.tolist() == ["point", "via", "end"]
    assert program.refusals == ()


@pytest.mark.parametrize(
    "other",
    [
        f"w = {P2}",
        "w[2] = 0.5",
        "movej(w)",
        f"movel(pose_trans(w, {P1}))",
        "movel(pose_add(w, d))",
        "movej(get_inverse_kin(w))",
        "def f(w):",
        "textmsg(w)",
    ],
)
def test_a_named_pose_that_something_else_needs_is_not_corrected(other):
    program = parse(f"w = {P1}", "movel(w)", other)
    out = rewrite(program, program.position_mm + 2.0, program.orientation, np.ones(len(program), bool))
    assert not out.changed[0]
    assert 2 in {r.line for r in (*program.refusals, *out.refusals)}
    assert out.raw.splitlines()[0] == program.raw.splitlines()[0]


def test_frames_that_the_script_sets_must_agree(model, tools):
    process = tools.process()
    tcp = ", ".join(f"{x:.6f}" for x in (*model.tcp[1], np.pi / np.sqrt(2), 0, np.pi / np.sqrt(2)))
    good = [
        "def main():",
        f"  set_tcp(p[{tcp}])",
        "  plane = p[1.65, -0.1, 0.75, 0, 0, 0]",
        f"  movel(pose_trans(plane, {P1}), v=0.1)",
    ]
    program = parse(*good)
    assert program.corrected.all()
    check_frames(process, program, model)
    with pytest.raises(InputError, match=r"differs from workpiece of process\.yaml by 10\.000 mm"):
        check_frames(process, parse(*[line.replace("1.65", "1.66") for line in good]), model)
    with pytest.raises(InputError, match="differs from tool"):
        check_frames(process, parse(*[line.replace("set_tcp(p[0", "set_tcp(p[1") for line in good]), model)
    with pytest.raises(InputError, match="the tool frame is computed"):
        check_frames(process, parse("set_tcp(measured())", f"movel({P1})"), model)
    with pytest.raises(InputError, match="the base frame changes"):
        check_frames(process, parse(*good, f"movel({P1})"), model)
    check_frames(process, parse(f"movel({P1})", f"movel({P2})"), model)


blank = st.sampled_from(["", "", " ", "\t"])
filler = st.sampled_from(
    [
        'textmsg("movel(p[1,2,3,0,0,0])")',
        "# caf\xe9 movel(",
        "",
        "set_digital_out(1, True)",
        "while True:",
        "end",
        "sub(3)",
        "movel(pose_add(a, b))",
    ]
)


@st.composite
def number(draw):
    decimals = draw(st.integers(0, 6))
    text = draw(st.sampled_from(["", "-", "+"])) + str(draw(st.integers(0, 3)))
    text += "." + str(draw(st.integers(0, 10**decimals - 1))).zfill(decimals) if decimals else ""
    return text + draw(st.sampled_from(["", "", "", "e-1", "E-02"]))


@st.composite
def programs(draw):
    text, movable, count = draw(st.sampled_from(["", "def main():\r\n", "\xef\xbb\xbf# head\n"])), [], 0

    def pose(force):
        nonlocal text
        text += "p" + draw(blank) + "["
        for place in range(6):
            text += draw(blank)
            token = draw(number())
            movable.extend([(len(text), len(text) + len(token))] if force else [])
            text += token + draw(blank) + ("," if place < 5 else "")
        text += "]"

    for _ in range(draw(st.integers(1, 6))):
        what = draw(st.sampled_from(["movel", "movep", "movej", "movec", "named", "filler"]))
        tail = draw(st.sampled_from([")", ", a=1.2, v=0.25, r=0.01) # movel(", " ,1.2,0.25)"]))
        text += draw(blank)
        if what == "filler":
            text += draw(filler)
        elif what == "named":
            count += 1
            text += f"w{count} = "
            pose(True)
            text += f"\nmovel(w{count}{tail}"
        else:
            text += what + "("
            for leg in range(2 if what == "movec" else 1):
                text += draw(st.sampled_from([",", ", ", ",\n "])) if leg else ""
                pose(what != "movej")
            text += tail
        text += draw(st.sampled_from(["\n", "\r\n"]))
    text += "movej(p[0,0,0,0,0,0])"
    return text + draw(st.sampled_from(["", "\n", "\n\0\0"])), movable


@settings(max_examples=25, deadline=None)
@given(programs(), st.integers(0, 2**32 - 1))
def test_generated_programs_keep_every_byte_that_is_no_number_of_a_pose(generated, seed):
    text, movable = generated
    program, _ = holds_contract(UrScript(), text.encode("latin-1"), movable, seed)
    spans = {tuple(span) for row in np.flatnonzero(program.carries_force) for span in program.span[row].tolist()}
    assert spans == set(movable)


@settings(max_examples=25, deadline=None)
@given(st.binary(max_size=40), st.integers(0, 10**6), programs())
def test_damaged_bytes_never_crash_the_reader(noise, where, generated):
    raw = generated[0].encode("latin-1")
    at = where % (len(raw) + 1)
    damaged = b"movej(p[0,0,0,0,0,0])\n" + raw[:at] + noise + raw[at + len(noise) // 2 :]
    program = UrScript().parse(damaged, "damaged.script")
    out = rewrite(program, program.position_mm + 0.3, program.orientation, np.ones(len(program), bool))
    assert out.raw.count(b"\n") == damaged.count(b"\n")


def test_scripts_are_recognised_from_their_content():
    for raw in (b"def main():\n  x = 1\nend\n", b"# head\n movel(p[0,0,0,0,0,0], a=1)\n"):
        assert next(d.name for d in DIALECTS if d.recognises(raw, ".txt")) == "urscript"
    assert next(d.name for d in DIALECTS if d.recognises(b"DEF main()\nLIN {X 1}\nEND\n", ".txt")) == "krl"
    with pytest.raises(InputError, match="found no motion"):
        parse("def main():", "end")
