"""Staubli VAL3: a program and the data files beside it; the numbers that change are in the data files."""

import numpy as np
import pytest
from contract import holds_contract
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_stiffness.errors import InputError
from toolpaths.formats import DIALECTS, read_program
from toolpaths.formats.val3 import Val3
from toolpaths.process import check_frames
from toolpaths.rewriting import rewrite

HEAD = '\ufeff<?xml version="1.0" encoding="utf-8" ?>\r\n<Programs xmlns="http://www.staubli.com/robotics/VAL3/Program/2">\r\n<Program name="start">'
FRAME = 'x="1650.000" y="-100.000" z="700.000" rx="0.000" ry="0.000" rz="0.000" fatherId="world[0]"'


def code(*lines, local=""):
    return "\r\n".join(
        [HEAD, local, "<Code><![CDATA[", "begin", *lines, "end", "]]></Code></Program></Programs>"]
    ).encode()


def value(key, x="-36.802", more='shoulder="lefty" elbow="epositive" wrist="wpositive"', father="fPart[0]"):
    return f'<Value key="{key}" x="{x}" y="-6.159" z="500.000" rx="175.407" ry="8.416" rz="46.453" {more} fatherId="{father}" />'


def data(*values, tool='x="1" z="55.323"', frame=FRAME, more=""):
    return "\n".join(
        [
            '<?xml version="1.0" encoding="utf-8" ?>',
            '<Database xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns="http://www.staubli.com/robotics/VAL3/Data/2"><Datas>',
            f'<Data name="fPart" xsi:type="array" type="frame" size="1"><Value key="0" {frame} /></Data>',
            '<Data name="mSpeed" xsi:type="array" type="mdesc" size="2"><Value key="0" tmax="50.0" /><Value key="1" tmax="99999" /></Data>',
            '<Data name="p" access="public" xsi:type="array" type="pointRx" size="4">',
            *values,
            f'</Data><Data name="tMill" xsi:type="array" type="tool" size="1"><Value key="0" {tool} fatherId="flange[0]" /></Data>',
            more,
            "</Datas></Database>",
        ]
    ).encode()


def parse(lines, values, **said):
    return Val3().parse(code(*lines), "start.pgx", [("part.dtx", data(*values, **said))])


def test_points_are_read_from_the_data_file():
    program = parse(
        [
            "n=movel(p[0],tMill[0],mSpeed[0]) // movel(p[9]",
            "  movec( p[1] ,p[2], tMill, mSpeed[1])",
            "movej(jHome,tMill,mSpeed)",
        ],
        [value(0), value(1, "7.5", 'shoulder="righty" elbow="enegative" wrist="wnegative"'), value(2, "8", "")],
    )
    assert program.refusals == ()
    assert program.role.tolist() == ["point", "via", "end"]
    np.testing.assert_array_equal(program.position_mm[:, 0], [-36.802, 7.5, 8])
    np.testing.assert_array_equal(program.orientation[0], [175.407, 8.416, 46.453])
    assert program.status.tolist() == [[0, 0, 0], [1, 1, 1], [-1, -1, -1]]
    np.testing.assert_array_equal(program.feed_mm_per_min, [3000, np.nan, np.nan])


def test_the_numbers_that_change_are_in_the_data_file():
    program = parse(
        ["movel(p[0],tMill,mSpeed)", "movel(p[1],tMill,mSpeed)", "movel(p[0],tMill,mSpeed)"], [value(0), value(1)]
    )
    out = rewrite(program, program.position_mm + 0.25, program.orientation, np.ones(3, bool))
    assert out.changed.all()
    assert out.parts[0] == program.raw[: program.parts[0].end]
    assert out.parts[1] == data(value(0), value(1)).replace(b"-36.802", b"-36.552").replace(
        b"-6.159", b"-5.909"
    ).replace(b"500.000", b"500.250")


number = st.tuples(
    st.sampled_from(["", "-", "+"]), st.integers(0, 999), st.sampled_from(["", ".", ".5", ".250", ".123456"])
)


@settings(max_examples=25, deadline=None)
@given(st.lists(number, min_size=12, max_size=12), st.integers(0, 2**32 - 1))
def test_the_contract_holds_over_both_files(numbers, seed):
    program_file = code(
        "movel(p[0],tMill,mSpeed)",
        "movej(p[2],tMill,mSpeed)",
        'put("movel(p[2],tMill,mSpeed)")',
        "movec(p[0],p[1],tMill,mSpeed)",
    )
    points, movable = data("@", value(2, "5")), []
    before, _, after = (part.decode() for part in points.partition(b"@"))
    for key in range(2):
        before += f'<Value key="{key}"'
        for word in ("x", "y", "z", "rx", "ry", "rz"):
            sign, whole, decimals = numbers.pop()
            before += f' {word}="'
            movable.append(
                (len(program_file) + len(before), len(program_file) + len(before + f"{sign}{whole}{decimals}"))
            )
            before += f'{sign}{whole}{decimals}"'
        before += ' fatherId="fPart[0]" />\n'
    points = (before + after).encode()
    holds_contract(Val3(), program_file, movable, seed, [("part.dtx", points)])


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("movel(appro(p[0],{0,0,-100,0,0,0}),tMill,mSpeed)", "computed while the program runs"),
        ("movel(p[i],tMill,mSpeed)", "computed while the program runs"),
        ("movel(q,tMill,mSpeed)", "in no data file"),
        ("movel(p[3],tMill,mSpeed)", "whose z is not written"),
        ("movel(p[0])", "not a motion with a point, tool and speed"),
        ("movec(p[0],tMill,mSpeed)", "not a motion with two points"),
    ],
)
def test_targets_that_are_not_in_the_data_are_refused_with_line_and_reason(line, reason):
    program = parse(["// x", line], [value(0), value(3).replace('z="500.000" ', "")])
    (refusal,) = program.refusals
    assert reason in refusal.reason
    assert refusal.line == 8


@pytest.mark.parametrize(
    "other",
    [
        "p[0].trsf.x=5",
        "movej(p[0],tMill,mSpeed)",
        "movel(appro(p[0],t),tMill,mSpeed)",
        "movel(p[i],tMill,mSpeed)",
        "n=distance(p[0],p[1])",
    ],
)
def test_a_point_that_something_else_needs_is_not_corrected(other):
    program = parse(["movel(p[0],tMill,mSpeed)", other], [value(0), value(1)])
    out = rewrite(program, program.position_mm + 2.0, program.orientation, np.ones(len(program), bool))
    assert not out.changed[0]
    assert out.parts[1] == data(value(0), value(1))


def test_frames_in_the_data_must_agree(model, tools):
    process, line = tools.process(), ["movel(p[0],tMill,mSpeed)"]
    x, y, z = model.tcp[1] * 1e3
    # The example's tool is turned by half a turn about x + z: Rx(180) Ry(90).
    tool = f'x="{x}" y="{y}" z="{z}" rx="180" ry="90" rz="0"'
    nested = '<Data name="fCell" xsi:type="array" type="frame" size="1"><Value key="0" z="50" /></Data>'
    inner = FRAME.replace("world[0]", "fCell[0]")
    check_frames(process, parse(line, [value(0)], tool=tool, frame=inner, more=nested), model)
    turned = nested.replace('z="50"', 'x="1750" y="-150" z="700" rz="90"')
    inner_turned = 'x="50" y="100" z="50" rz="-90" fatherId="fCell[0]"'
    check_frames(process, parse(line, [value(0)], tool=tool, frame=inner_turned, more=turned), model)
    with pytest.raises(InputError, match=r"fPart\[0\]: differs from workpiece of process\.yaml by 50\.000 mm"):
        check_frames(process, parse(line, [value(0)], tool=tool), model)
    with pytest.raises(InputError, match="differs from tool"):
        check_frames(process, parse(line, [value(0)], frame=inner, more=nested), model)
    with pytest.raises(InputError, match="the base frame is computed"):
        check_frames(process, parse(["fPart[0].trsf.z=5", *line], [value(0)], tool=tool), model)
    with pytest.raises(InputError, match="the base frame changes"):
        check_frames(
            process,
            parse(
                [*line, "movel(p[1],tMill,mSpeed)"],
                [value(0, father="world[0]"), value(1, father="fOther[0]")],
                tool=tool,
            ),
            model,
        )


def test_a_program_is_read_with_the_data_files_in_its_folder(tmp_path):
    (tmp_path / "start.pgx").write_bytes(code("movel(p[0],tMill,mSpeed)", "movel(q[1],tMill,mSpeed)"))
    (tmp_path / "part.dtx").write_bytes(data(value(0)))
    (tmp_path / "more.dtx").write_bytes(data(value(1)).replace(b'"p"', b'"q"'))
    program = read_program(tmp_path / "start.pgx")
    assert program.corrected.tolist() == [True, True]
    assert [part.path for part in program.parts] == [
        str(tmp_path / name) for name in ("start.pgx", "more.dtx", "part.dtx")
    ]
    with pytest.raises(InputError, match=r"data file: .* Give the program \(\.pgx\)"):
        read_program(tmp_path / "part.dtx")
    assert [d.name for d in DIALECTS if d.recognises(data(value(0)), ".txt")] == ["val3"]
    with pytest.raises(InputError, match="found no motion"):
        Val3().parse(code("waitEndMove()"), "stop.pgx")
    alone = Val3().parse(code("movel(p[0],tMill,mSpeed)"), "start.pgx")
    assert "no data file" in alone.warnings[0]
    assert not alone.corrected.any()
