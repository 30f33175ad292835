"""Looking up the keys of a frame, which stand at the frame or at the top of the file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from unveil_core.base.checks.named_paths import named_path
from unveil_core.base.errors import DriveError

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
            raise DriveError(f"{key}{where} is no number: {str(value)[:40]!r}", path=self.path, mend="correct it")
        return found

    def file(self, key: str) -> Path | None:
        """A path that the frame names, relative to the folder of the file, or None.

        Raises:
            DriveError: it is no name of a file.
        """
        value = self.frame.get(key)
        return named_path(self.path.parent, value, self.path, key) if value else None
