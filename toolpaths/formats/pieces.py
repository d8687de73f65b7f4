"""A long program piece by piece: every piece reads like a program of its own, and what it needs of those before is handed on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from toolpaths.formats import DIALECTS, Dialect, InPieces, Packed
from toolpaths.program import Program

# About 20,000 lines of an ordinary milling program.
PIECE_BYTES = 1_400_000


def comes_in_pieces(path: Path, dialect: str | None, size: int = PIECE_BYTES) -> bool:
    """Whether a file is longer than one piece and of a dialect that can be cut."""
    return path.is_file() and isinstance(_dialect(path, dialect, size), InPieces) and length(path, dialect, size) > size


def length(path: Path, dialect: str | None, size: int = PIECE_BYTES) -> int:
    """Bytes of a program as text."""
    chosen = _dialect(path, dialect, size)
    return chosen.length(path) if isinstance(chosen, Packed) else path.stat().st_size


def pack(path: Path, dialect: str | None, text: Path, size: int = PIECE_BYTES) -> None:
    """Make a file with the corrected text of a program the corrected program, where that is not the text itself."""
    chosen = _dialect(path, dialect, size)
    if isinstance(chosen, Packed):
        chosen.pack(path, text)


def pieces(path: Path, dialect: str | None, size: int = PIECE_BYTES) -> Iterator[Program]:
    """The pieces of a program, in order. No more than one of them and what is read ahead is held.

    Raises
    ------
    InputError
        As the dialect does.
    """
    chosen = _dialect(path, dialect, size)
    assert isinstance(chosen, InPieces)
    others = [(str(other), other.read_bytes()) for other in chosen.companions(path) if other.is_file()]
    resume: object = None
    pending = bytearray()
    blocks = chosen.blocks(path, size) if isinstance(chosen, Packed) else _blocks(path, size)
    ahead = next(blocks, b"")
    while ahead:
        pending += ahead
        ahead = next(blocks, b"")
        raw = bytes(pending)
        cut = chosen.cut(raw) if ahead else len(raw)
        if cut:
            program, resume = chosen.parse_piece(raw[:cut], str(path), resume, others, last=not ahead)
            del pending[: len(program.raw)]
            yield program


def _blocks(path: Path, size: int) -> Iterator[bytes]:
    with path.open("rb") as file:
        while block := file.read(size):
            yield block


def _dialect(path: Path, name: str | None, size: int) -> Dialect | None:
    if name is not None:
        return next((d for d in DIALECTS if d.name == name), None)
    with path.open("rb") as file:
        head = file.read(size)
    return next((d for d in DIALECTS if d.recognises(head, path.suffix.lower())), None)
