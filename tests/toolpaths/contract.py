"""What every dialect promises of a rewritten program, held against number tokens that a test itself knows."""

from __future__ import annotations

import re

import numpy as np

from toolpaths.rewriting import rewrite


def half_digit(program):
    """Half a printed digit of the token behind each word, found with Python's own decimals, in mm and units of the convention."""
    half = np.full(program.pose.shape, np.nan)
    for row, word in zip(*np.nonzero(program.source >= 0), strict=True):
        start, end = program.span[program.source[row, word], word]
        mantissa, _, exponent = program.raw[start:end].upper().partition(b"E")
        half[row, word] = 0.5 * 10.0 ** (int(exponent or 0) - len(mantissa.partition(b".")[2]))
    return half * program.unit


def holds_contract(dialect, raw, movable, seed, others=()):
    """Assert the contract for one program and one random correction.

    Parameters
    ----------
    movable
        Byte spans (in all files, one after the other) that a correction may touch: the numbers of poses that carry force.
    """
    program = dialect.parse(raw, "generated", others)
    rng = np.random.default_rng(seed)
    everything = b"".join([raw, *(content for _, content in others)])
    same = rewrite(program, program.position_mm, program.orientation, np.ones(len(program), bool))
    assert b"".join(same.parts) == everything
    assert not same.refusals

    size = rng.choice([1e-3, 0.3, 20.0])
    common = rng.random() < 0.5
    by = rng.normal(0, size, (1 if common else len(program), program.pose.shape[1]))
    by = np.broadcast_to(by, program.pose.shape) * np.where(np.arange(program.pose.shape[1]) < 3, 1.0, 1e-2)
    change = rng.random(len(program)) < rng.choice([0.5, 1.0])
    wanted = program.pose + by
    out = rewrite(program, wanted[:, :3], wanted[:, 3:], change)
    written = b"".join(out.parts)
    only_numbers_changed(everything, written, movable)
    assert out.insertions == ()

    ends = np.cumsum([len(part) for part in out.parts])
    files = [written[a:b] for a, b in zip([0, *ends], ends, strict=False)]
    back = dialect.parse(files[0], "generated", [(name, new) for (name, _), new in zip(others, files[1:], strict=True)])
    expected = np.where(out.changed[:, None], wanted, program.pose)
    limit = np.where(out.changed[:, None], half_digit(back) * (1 + 1e-6) + 1e-9, 1e-9)
    assert (np.abs(back.pose - expected) <= limit).all()
    for name in ("line", "kind", "role", "status", "external", "follows"):
        np.testing.assert_array_equal(getattr(back, name), getattr(program, name), err_msg=name)
    left = change & program.carries_force & ~out.changed
    assert set(program.line[left].tolist()) <= {r.line for r in (*out.refusals, *program.refusals)}
    return program, out


def only_numbers_changed(before, after, movable):
    """Between the spans that may change stands what stood there; in them stand numbers of as many decimals."""
    pattern, done = b"", 0
    for start, end in sorted(movable):
        mantissa, mark, exponent = re.fullmatch(rb"([^eE]+)([eE]?)(.*)", before[start:end]).groups()
        decimals = len(mantissa.partition(b".")[2])
        dot = rb"\.\d{%d}" % decimals if decimals else rb"\.?"
        pattern += re.escape(before[done:start]) + rb"[+-]?\d*" + dot + re.escape(mark + exponent)
        done = end
    assert re.fullmatch(pattern + re.escape(before[done:]), after, re.DOTALL)
    assert after.count(b"\n") == before.count(b"\n")
