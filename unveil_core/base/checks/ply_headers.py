"""What the header of a PLY claims, before anything is taken from memory for it."""

from __future__ import annotations

from pathlib import Path

from plyfile import PlyParseError

__all__ = ["UNREADABLE", "check_counts"]

UNREADABLE = (
    PlyParseError,
    LookupError,
    TypeError,
    ValueError,
    ArithmeticError,
    MemoryError,
    EOFError,
    OSError,
    RuntimeError,
)
"""What comes of reading a file that is no PLY."""
MOST_LINES, MOST_LINE = 10_000, 65_536
"""Of a header."""


def check_counts(path: Path) -> None:
    """Raise a ValueError where the header tells more than the file can hold: room for it would be taken first."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        for _ in range(MOST_LINES):
            words = stream.readline(MOST_LINE).split()
            if not words or words[0] == b"end_header":
                return
            # A row is a byte at least.
            if words[0] == b"element" and len(words) > 2 and not 0 <= int(words[2][:20]) <= size:
                raise ValueError(f"it says {words[2][:20].decode()} rows in {size:,} bytes")
    raise ValueError("its header has no end")
