"""Looking up the keys of a frame, which stand at the frame or at the top of the file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from unveil_core.base.errors import DriveError
from unveil_core.drives.formats.on_disk.pictures import NamedFiles
from unveil_core.drives.travel.stamps import stamp_of

__all__ = ["Keys"]


@dataclass(frozen=True)
class Keys:
    """Keys of a frame, or of the file where ``frame`` is empty.

    Attributes:
        frame: the frame's entry; top: of the whole file.
        path: of the file, for messages; name: of the frame, likewise.
    """

    frame: dict[str, Any]
    top: dict[str, Any]
    path: Path
    name: str = ""

    def get(self, key: str) -> Any:
        """The value at the frame, else at the top, else None."""
        value = self.frame.get(key)
        return self.top.get(key) if value is None else value

    def number(self, key: str) -> float | None:
        """A finite number, or None where the key is missing.

        Raises:
            DriveError: it is something else.
        """
        value = self.get(key)
        if value is None:
            return None
        try:
            found = math.nan if isinstance(value, bool) else float(value)
        except (TypeError, ValueError, OverflowError):
            found = math.nan
        if not math.isfinite(found):
            where = f" of frame {self.name}" if self.name and self.frame.get(key) is not None else ""
            raise DriveError(f"Not a number: {key}{where}: {str(value)[:40]!r}", path=self.path, mend="correct it")
        return found

    def stamp(self) -> float | None:
        """The time stamp, in whatever unit: ``timestamp``, else ``time``; None where the frame has neither.

        Raises:
            DriveError: it is none.
        """
        key = "timestamp" if self.frame.get("timestamp") is not None else "time"
        value = self.get(key)
        found = None if value is None else stamp_of(value)
        if value is not None and found is None:
            where = f" of frame {self.name}" if self.name else ""
            mend = "give seconds, or a date as 2026-01-31T12:00:00.5"
            raise DriveError(f"Not a number: {key}{where}: {str(value)[:40]!r}", path=self.path, mend=mend)
        return found

    def file(self, files: NamedFiles, *keys: str) -> Path | None:
        """The file that the frame names by the first of some keys that it has, or None.

        Raises:
            DriveError: it is no name of a file.
        """
        key = next((k for k in keys if self.frame.get(k)), None)
        return None if key is None else files.file(self.frame[key], key)
