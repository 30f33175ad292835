"""Rows of a large JSON table, a list of flat objects, without decoding or holding the rest of it.

The tables of a whole dataset measure gigabytes, a scene needs a thousandth of their rows. The file is cut between rows by a
pattern, rows that lack what is looked for are passed over as bytes, and the others are decoded.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from unveil_core.base.disk.open_safely import open_file
from unveil_core.base.errors import DriveError
from unveil_core.base.files import parsed_json

__all__ = ["json_rows"]

CHUNK_BYTES = 1 << 21
"""Read at once. From 1 to 8 MB all sizes are as fast, larger ones leave the cache of the processor."""
MOST_BYTES_OF_A_ROW = 1 << 26
"""A longer row is none: a row of the datasets has about 500 bytes, and what has no end must not fill the memory."""

BETWEEN_ROWS = re.compile(rb'\}\s*,\s*\{(?=\s*"\w)')
"""Ends one row and begins the next. It cannot lie inside a string: its quotation mark would end that string, and no letter may
follow the end of one."""
BEGIN = re.compile(rb"(?:\xef\xbb\xbf)?\s*\[\s*(?:\{|(?=\]))")
LAST = re.compile(rb"(?s:(.*)\})?\s*\]\s*")
MEND = "download it again"


def json_rows(path: Path, field: str | None = None, wanted: Collection[str] = ()) -> Iterator[dict[str, Any]]:
    """The rows of a table, or those of them whose field has a wanted value, in the order of the file.

    Args:
        path: of the file, a list of objects that hold no objects themselves.
        field: its name; None = all rows. wanted: its values, plain ASCII without escapes, as tokens are.
    Raises:
        DriveError: missing, cut short, no such list, or a row that is looked for and is no JSON.
    """
    pattern = None if field is None else re.compile(rb'"' + re.escape(field.encode()) + rb'"\s*:\s*"([^"\\]*)"')
    values = {w.encode() for w in wanted}
    for bodies in _bodies(path):
        if pattern is not None:
            look = pattern.search
            bodies = [b for b in bodies if (m := look(b)) is not None and m[1] in values]
        for body in bodies:
            try:
                row = parsed_json(b"{" + body + b"}")
            except ValueError as error:
                raise DriveError(f"Not valid JSON in a row: {error}", path=path, mend=MEND) from error
            if field is None or row.get(field) in wanted:
                yield row


def _bodies(path: Path) -> Iterator[list[bytes]]:
    """What stands between the braces of each row, some thousand rows at a time."""
    try:
        with open_file(path) as stream:
            rest = stream.read(CHUNK_BYTES)
            begin = BEGIN.match(rest)
            if begin is None:
                raise DriveError("Not a list of rows", path=path, mend=MEND)
            rest = rest[begin.end() :]
            while True:
                *bodies, rest = BETWEEN_ROWS.split(rest)
                yield bodies
                if len(rest) > MOST_BYTES_OF_A_ROW:
                    raise DriveError("holds a row without an end", path=path, mend=MEND)
                chunk = stream.read(CHUNK_BYTES)
                if not chunk:
                    break
                rest += chunk
    except OSError as error:
        raise DriveError(f"cannot be read: {error.strerror}", path=path, mend="unpack the tables, too") from error
    last = LAST.fullmatch(rest)
    if last is None:
        raise DriveError("Cut short", path=path, mend=MEND)
    if last[1] is not None:
        yield [last[1]]
