"""Long programs of CAM systems in pieces: G-code, APT, RAPID, URScript and Fanuc listings are read, corrected and accounted for as in one."""

import pickle
import random
import re

import numpy as np
import pytest
from long_sources import SOURCES, STRAY, cutter_location, listing, milling, module, place, script

from drake_stiffness.files import write_together
from toolpaths.formats import read_again, read_program
from toolpaths.formats.pieces import pieces
from toolpaths.formats.reading import NeedsWhole
from toolpaths.job import compensate
from toolpaths.long_programs import _Job, compensate_file

SIZE = 900


@pytest.fixture(params=SOURCES)
def long_program(request, tmp_path):
    text, process = SOURCES[request.param]
    path = tmp_path / request.param
    path.write_text(text)
    return path, process


def test_pieces_hold_every_byte_and_every_row_once(long_program):
    path, _ = long_program
    whole, found = read_program(path), list(pieces(path, None, SIZE))
    assert len(found) > 2
    assert b"".join(piece.raw for piece in found) == path.read_bytes()
    own = [slice(bool(n), None) for n in range(len(found))]
    for name in (
        "line",
        "kind",
        "carries_force",
        "refused",
        "feed_mm_per_min",
        "blend_mm",
        "position_mm",
        "orientation",
        "follows",
    ):
        joined = np.concatenate([getattr(piece, name)[rows] for piece, rows in zip(found, own, strict=True)])
        np.testing.assert_array_equal(joined, getattr(whole, name), err_msg=name)
    assert list(dict.fromkeys(setting for piece in found for setting in piece.frames)) == list(whole.frames)


@pytest.mark.parametrize("seed", range(5))
def test_damaged_programs_read_in_pieces_as_they_do_as_a_whole(long_program, seed):
    """Lines taken out, put in and spoilt; or the pieces depend on each other, which is said."""
    path, _ = long_program
    rng, lines = random.Random(seed), path.read_text().split("\n")
    for _ in range(rng.choice([1, 2, 4, 8])):
        at, what = rng.randrange(len(lines)), rng.random()
        if what < 0.5:
            lines.insert(at, rng.choice(STRAY[path.suffix]))
        elif what < 0.75:
            del lines[at]
        else:
            lines[at] = lines[at][:4] + rng.choice(" ;()XZG1.-,$") + lines[at][5:]
    path.write_text("\n".join(lines))
    try:
        found = list(pieces(path, None, SIZE))
    except NeedsWhole:
        return
    whole = read_program(path)
    own = [slice(bool(n), None) for n in range(len(found))]
    for name in ("line", "kind", "refused", "feed_mm_per_min", "position_mm", "orientation", "follows", "external"):
        joined = np.concatenate([getattr(piece, name)[rows] for piece, rows in zip(found, own, strict=True)])
        np.testing.assert_array_equal(joined, getattr(whole, name), err_msg=name)
    told = sorted((r.line, r.reason) for piece in found for r in (*piece.refusals, *piece.notes))
    assert told == sorted((r.line, r.reason) for r in (*whole.refusals, *whole.notes))


def test_another_process_reads_a_piece_again_as_it_is(long_program):
    path, _ = long_program
    for piece in pieces(path, None, SIZE):
        sent = pickle.loads(pickle.dumps(piece))
        again = read_again(sent, [sent.raw])
        for name in ("line", "kind", "position_mm", "orientation", "source", "span", "feed_mm_per_min"):
            np.testing.assert_array_equal(getattr(again, name), getattr(piece, name), err_msg=name)


def test_the_numbers_of_a_piece_are_in_its_own_bytes(long_program):
    path, _ = long_program
    for piece in pieces(path, None, SIZE):
        rows, words = np.nonzero(piece.written)
        tokens = [float(piece.raw[start:end]) for start, end in piece.span[rows, words]]
        np.testing.assert_allclose(tokens * piece.unit[words], piece.pose[rows, words], atol=1e-12)


def test_pieces_and_the_whole_give_the_same_bytes(long_program, model, tools):
    path, changes = long_program
    process, options = tools.process(**changes), {"keep_refused": True}
    whole = compensate(read_program(path), model, process, **options)
    out = path.with_name("out" + path.suffix)
    parts = compensate_file(path, model, process, size=SIZE, processes=1, output=out, **options)
    assert type(parts).__name__ == "LongCompensation"
    write_together(parts.files(out))
    assert out.read_bytes() == whole.raw != path.read_bytes()
    told, expected = parts.to_dict(), whole.to_dict()
    for key in ("corrected_points", "lines", "refused"):
        assert told[key] == expected[key], key
    assert told["evenness"]["kink_lines"] == expected["evenness"]["kink_lines"]
    assert told["residual_mm"]["max"] == pytest.approx(expected["residual_mm"]["max"], rel=1e-4)


def test_a_branch_that_was_guessed_wrongly_is_found_for_rotary_words_too(model, tools, tmp_path, monkeypatch):
    path, (text, changes) = tmp_path / "five.nc", SOURCES["five.nc"]
    path.write_text(text)
    process, options = tools.process(**changes), {"keep_refused": True}
    whole = compensate(read_program(path), model, process, **options)
    flipped, original = np.radians([0, -70, 120, 180, 50, 180]), _Job._tasks

    def guess_wrongly(job):
        for index, (program, own, lead) in enumerate(original(job)):
            job.sent[index] = (program, own, flipped if index == 2 else lead)
            yield job.sent[index]

    monkeypatch.setattr(_Job, "_tasks", guess_wrongly)
    parts = compensate_file(path, model, process, size=SIZE, processes=1, **options)
    np.testing.assert_allclose(parts.path.postures.q, whole.path.postures.q, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "text"),
    {
        "jump.nc": milling() + "GOTO 20\n",
        "late.nc": milling() + f"G1 {place(60)} C5.0\n",
        "kept.nc": milling(turn=" A5.0 C10.0").replace(" C10.", " ;C10."),
        "stored.mod": module().replace("ENDPROC", r"MoveL home,v50,z1,mill \WObj:=part;" + "\nENDPROC"),
        "assigned.mod": module().replace("SetDO spindle,1", "part.uframe.trans.x:=1"),
        "along.ls": listing().replace("J P[12] 50% FINE", "L P[12] 50mm/sec FINE"),
        "both.ls": listing()
        .replace(":L P[2]", ":J P[1] 5% FINE ;\n   9:L P[2]", 1)
        .replace("J P[12] 50%", "J P[1] 50%"),
        "again.ls": listing().replace("/POS", "  99:J P[1] 50% FINE    ;\n/POS"),
        "remark.ls": listing().replace("C P[20]\n", "C P[20]\n  22:!via    ;\n"),
        "disorder.ls": listing().replace("P[5]", "P[55]", 1).replace("P[50]", "P[5]", 1).replace("P[55]", "P[50]", 1),
        "listed.ls": listing().replace("P[60]{", "P[2]{"),
        "named.script": script().replace("movej(home, a=1, v=1)\n  ", "movel(home, a=1, v=1)\n  "),
        "named_late.script": script() + "movel(home)\n",
        "open.script": script().replace('popup("a ] in )")', "popup("),
        "kept.cl": cutter_location(3) + cutter_location(axes=False),
    }.items(),
    ids=lambda value: value if len(value) < 20 else "",
)
def test_a_program_whose_pieces_depend_on_each_other_is_read_as_a_whole(name, text, model, tools, tmp_path):
    """A jump; a rotary word that turns up late or is kept over pieces; a stored point; a work object that is set anew; a named pose; a bracket
    that stays open; points that are used again, out of order or listed out of order; a kept axis."""
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(NeedsWhole):
        list(pieces(path, None, SIZE))


def test_a_piece_with_nothing_to_correct_still_warns(model, tools, tmp_path):
    path = tmp_path / "long.ls"
    text = listing().replace("UFRAME_NUM=1", "UFRAME[1]=PR[2]")
    for n in range(1, 8):
        text = text.replace(f"L P[{n}] 50", f"J P[{n}] 50")
    path.write_text(text)
    assert not next(pieces(path, None, SIZE)).corrected.any()
    parts = compensate_file(path, model, tools.process(), size=SIZE, processes=1)
    assert any("sets a frame while it runs" in note for note in parts.notes)


def test_an_arc_whose_points_a_cut_would_part_is_not_parted(tmp_path):
    path = tmp_path / "arcs.ls"
    along = r"L (P\[\d+\]) 50mm/sec CNT10    ;\n *\d+:L (P\[\d+\] 50)"
    path.write_text(re.sub(along, r"C \1\n    :\2", listing()))
    whole = read_program(path)
    assert (whole.role == "via").sum() > 12
    assert not whole.refusals
    for size in range(700, 1100, 50):
        found = list(pieces(path, None, size))
        np.testing.assert_array_equal(np.concatenate([p.role[bool(n) :] for n, p in enumerate(found)]), whole.role)


def test_a_program_without_a_whole_line_is_not_cut(tmp_path):
    path = tmp_path / "part.nc"
    path.write_text("G21\n" + "".join(f"G1 X{n}.000\nG1 Y{n}.000\n" for n in range(200)))
    assert len(list(pieces(path, None, SIZE))) == 1
