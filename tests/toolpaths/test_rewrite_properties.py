"""Promises of the rewriter over generated KRL programs, held against spans that the generator itself knows."""

import re
from dataclasses import dataclass, field

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from toolpaths.formats.krl import Krl
from toolpaths.rewriting import rewrite

POSE = ("X", "Y", "Z", "A", "B", "C")

blank = st.sampled_from(["", "", " ", "  ", "\t"])
gap = st.sampled_from([" ", " ", "  ", "\t"])
newline = st.sampled_from(["\n", "\r\n"])
tail = st.sampled_from(["", " C_DIS", " C_VEL ; trailing {X 9} \xfc", "C_DIS", " ;LIN {X 1.0}"])
filler = st.sampled_from(
    [
        ";FOLD LIN P1 {X 1.0};%{PE}",
        ";ENDFOLD",
        "; caf\xe9 {X 2.0}",
        "",
        "   ",
        "$OUT[3]=TRUE",
        'm="LIN {X 1.0}; x"',
        "WAIT SEC 0.5",
    ]
)
breaker = st.sampled_from(
    ["LIN XP1", "PTP HOME", "ENDIF", "LIN {X a+1}", "sub(1)", "LIN_REL {Z 5.0}", "LIN {X 1.0, X 2.0}"]
)


@st.composite
def number(draw, largest=999):
    whole = draw(st.integers(0, largest))
    decimals = draw(st.integers(0, 5))
    text = draw(st.sampled_from(["", "-", "+", "-0"])) + str(whole)
    if decimals:
        text += "." + str(draw(st.integers(0, 10**decimals - 1))).zfill(decimals)
    return text + draw(st.sampled_from(["", "", "", "E-1", "e+0"]))


@dataclass
class Generated:
    """A program in the making: text (latin-1) and, for every pose, where its number tokens are, by word."""

    text: str = ""
    poses: list[tuple[str, dict[str, tuple[int, int]]]] = field(default_factory=list)

    def pose(self, draw, kind, words, lower):
        spans = {}
        self.text += "{" + draw(blank)
        for n, word in enumerate(words):
            self.text += (draw(blank) + "," + draw(blank) if n else "") + (word.lower() if lower else word) + draw(gap)
            token = draw(number())
            if word in POSE:
                spans[word] = (len(self.text), len(self.text) + len(token))
            self.text += token
        self.text += draw(blank) + "}"
        self.poses.append((kind, spans))


@st.composite
def programs(draw):
    g = Generated(draw(st.sampled_from(["", "&ACCESS RVP\r\n&REL 1\r\n", "DEF part( )\n"])))
    whole_next = True
    for _ in range(draw(st.integers(1, 8))):
        what = draw(st.sampled_from(["LIN", "LIN", "SLIN", "PTP", "CIRC", "filler", "breaker"]))
        g.text += draw(blank)
        if what in ("filler", "breaker"):
            g.text += draw(filler if what == "filler" else breaker)
            whole_next = whole_next or what == "breaker"
        else:
            lower = draw(st.booleans())
            g.text += (what.lower() if lower else what) + draw(blank)
            for leg in range(2 if what == "CIRC" else 1):
                whole = whole_next or draw(st.booleans())
                words = [w for w in POSE if whole or draw(st.booleans())] or ["X"]
                words += draw(st.sampled_from([[], ["E1"], ["E1", "E2"], ["S", "T"]]))
                if draw(st.integers(0, 4)) == 0:
                    words = draw(st.permutations(words))
                g.text += "," + draw(blank) if leg else ""
                g.pose(draw, what, words, lower)
            g.text += draw(tail)
            whole_next = False
        g.text += draw(newline)
    if draw(st.booleans()):
        g.text = g.text.rstrip("\r\n") if g.text.strip() else g.text
    g.text += "" if g.poses else "\nPTP HOME"
    return g


@st.composite
def corrections(draw, count):
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    size = draw(st.sampled_from([1e-4, 0.05, 0.3, 20.0]))
    common = draw(st.booleans())  # a common shift needs no words that are not written
    by = rng.normal(0, size, (1 if common else count, 6)) * (rng.random(6) < draw(st.sampled_from([0.3, 1.0])))
    return np.broadcast_to(by, (count, 6)), rng.random(count) < draw(st.sampled_from([0.5, 1.0, 1.0]))


def parse(raw):
    return Krl().parse(raw, "generated.src")


def tolerance(program):
    """Half a printed digit of the token that gives each word, found with Python's own decimals."""
    half = np.full((len(program), 6), np.nan)
    for row, word in zip(*np.nonzero(program.source >= 0), strict=True):
        start, end = program.span[program.source[row, word], word]
        mantissa, _, exponent = program.raw[start:end].upper().partition(b"E")
        half[row, word] = 0.5 * 10.0 ** (int(exponent or 0) - len(mantissa.partition(b".")[2]))
    return half


def poses(program):
    return np.concatenate([program.position_mm, program.orientation], axis=1)


@settings(max_examples=40, deadline=None)
@given(programs())
def test_the_reader_finds_the_tokens_that_the_generator_wrote(generated):
    program = parse(generated.text.encode("latin-1"))
    assert program.kind.tolist() == [kind for kind, _ in generated.poses]
    for row, (_, spans) in enumerate(generated.poses):
        found = {POSE[w]: tuple(program.span[row, w].tolist()) for w in range(6) if program.written[row, w]}
        assert found == spans


@settings(max_examples=40, deadline=None)
@given(programs(), st.booleans())
def test_zero_correction_is_byte_identical(generated, allow_insert):
    raw = generated.text.encode("latin-1")
    program = parse(raw)
    out = rewrite(
        program, program.position_mm, program.orientation, np.ones(len(program), bool), allow_insert=allow_insert
    )
    assert out.raw == raw
    assert out.refusals == ()
    assert out.insertions == ()


@settings(max_examples=50, deadline=None)
@given(programs(), st.data())
def test_only_numbers_of_corrected_poses_change_and_they_keep_their_decimals(generated, data):
    raw = generated.text.encode("latin-1")
    program = parse(raw)
    by, change = data.draw(corrections(len(program)))
    out = rewrite(program, program.position_mm + by[:, :3], program.orientation + by[:, 3:], change)
    allowed = sorted(
        span
        for row, (kind, spans) in enumerate(generated.poses)
        if kind != "PTP" and change[row]
        for span in spans.values()
    )
    # What lies between the tokens that may change must be found again, in order; between it stand numbers of equal decimals.
    pattern, done = b"", 0
    for start, end in allowed:
        mantissa, mark, exponent = re.fullmatch(rb"([^eE]+)([eE]?)(.*)", raw[start:end]).groups()
        decimals = len(mantissa.partition(b".")[2])
        dot = rb"\.\d{%d}" % decimals if decimals else b""
        pattern += re.escape(raw[done:start]) + rb"[+-]?\d+" + dot + re.escape(mark + exponent)
        done = end
    assert re.fullmatch(pattern + re.escape(raw[done:]), out.raw, re.DOTALL)
    assert out.raw.count(b"\n") == raw.count(b"\n")


@settings(max_examples=40, deadline=None)
@given(programs(), st.booleans(), st.data())
def test_reading_back_gives_the_wanted_pose_or_the_original_one(generated, allow_insert, data):
    program = parse(generated.text.encode("latin-1"))
    by, change = data.draw(corrections(len(program)))
    wanted = poses(program) + by
    out = rewrite(program, wanted[:, :3], wanted[:, 3:], change, allow_insert=allow_insert)
    back = parse(out.raw)
    expected = np.where(out.changed[:, None], wanted, poses(program))
    expected[program.position_only, 3:] = program.orientation[program.position_only]
    error = np.abs(poses(back) - expected)
    assert (np.isnan(error) == np.isnan(poses(program))).all()
    limit = np.where(out.changed[:, None], tolerance(back) * (1 + 1e-6) + 1e-9, 1e-9)
    error[program.free_orientation, 3:] = 0.0  # auxiliary points without angles: theirs are disregarded
    assert not (error > limit).any()
    # Nothing is left out in silence: what was to be changed and is not has its line in a list.
    refused = {r.line for r in (*out.refusals, *program.refusals)}
    left = change & program.carries_force & ~out.changed
    assert set(program.line[left].tolist()) <= refused
    # An arc is corrected in both of its poses or in none.
    both = np.flatnonzero((program.role[:-1] == "via") & change[:-1] & change[1:])
    assert (out.changed[both] == out.changed[both + 1]).all()
    if allow_insert:
        assert out.refusals == ()
    else:
        assert out.insertions == ()


@settings(max_examples=40, deadline=None)
@given(programs(), st.data())
def test_whole_poses_are_never_refused(generated, data):
    program = parse(generated.text.encode("latin-1"))
    by, change = data.draw(corrections(len(program)))
    out = rewrite(program, program.position_mm + by[:, :3], program.orientation + by[:, 3:], change)
    if program.written.all():
        assert out.refusals == ()
        assert (out.changed == (change & program.corrected)).all()


@settings(max_examples=40, deadline=None)
@given(st.binary(max_size=60), st.integers(0, 10**6), programs())
def test_damaged_bytes_never_crash_the_reader(noise, where, generated):
    raw = generated.text.encode("latin-1")
    at = where % (len(raw) + 1)
    damaged = b"PTP HOME\n" + raw[:at] + noise + raw[at + len(noise) // 2 :]
    program = parse(damaged)
    out = rewrite(program, program.position_mm + 0.3, program.orientation, np.ones(len(program), bool))
    assert out.raw.count(b"\n") == damaged.count(b"\n")
