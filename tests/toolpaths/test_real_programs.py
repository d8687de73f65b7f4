"""Programs other people wrote: each is of exactly one dialect, and each motion under force is read or refused with its line."""

from pathlib import Path

import numpy as np
import pytest

from drake_stiffness.errors import InputError
from toolpaths.formats import DIALECTS, read_program
from toolpaths.rewriting import rewrite

PROGRAMS = Path(__file__).parents[3] / "shared" / "data" / "programs"
DIALECT_OF = {
    ".src": "krl",
    ".dat": "krl",
    ".gcode": "gcode",
    ".mpf": "gcode",
    ".txt": "gcode",
    ".pgx": "val3",
    ".dtx": "val3",
    ".script": "urscript",
}
# No program but a companion of one: said so.
DATA_ONLY = {".dat", ".dtx"}

files = sorted(path for path in PROGRAMS.glob("*") if path.suffix in DIALECT_OF) if PROGRAMS.is_dir() else []


@pytest.mark.skipif(not files, reason="the real programs (../shared/data/programs) are not here")
def test_the_folder_has_what_is_expected():
    assert len(files) == 13


@pytest.mark.parametrize("path", files, ids=lambda path: path.name)
def test_a_real_program_is_of_one_dialect_and_kept_byte_for_byte(path):
    raw = path.read_bytes()
    assert [d.name for d in DIALECTS if d.recognises(raw, path.suffix)] == [DIALECT_OF[path.suffix]]
    if DIALECT_OF[path.suffix] != "gcode":  # G-code may have no line that is of G-code alone
        assert [d.name for d in DIALECTS if d.recognises(raw, "")] == [DIALECT_OF[path.suffix]]
    if path.suffix in DATA_ONLY:
        with pytest.raises(InputError, match=r"[Gg]ive the (program|\.src)"):
            read_program(path)
        return
    program = read_program(path)
    assert program.dialect == DIALECT_OF[path.suffix]
    everything = np.ones(len(program), bool)
    assert rewrite(program, program.position_mm, program.orientation, everything).raw == raw
    lines = raw.count(b"\n") + 1
    assert all(1 <= refusal.line <= lines and refusal.reason for refusal in program.refusals)
    refused = set(program.line[program.refused].tolist())
    assert refused <= {refusal.line for refusal in program.refusals}
    out = rewrite(program, program.position_mm + 0.37, program.orientation, everything)
    before, after = raw.split(b"\n"), out.raw.split(b"\n")
    assert len(before) == len(after)
    changed = {n for n, (a, b) in enumerate(zip(before, after, strict=True), 1) if a != b}
    assert changed <= set(program.line[out.changed].tolist())
