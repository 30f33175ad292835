"""Parts of long work, each kept under a digest of all that it is made of.

They outlast the work: done again after a change, only the parts whose digest is another one are made. A power cut leaves a part
whole or not at all, as of everything that is kept (see ``base.resume.checkpoint``).
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from unveil_core.base.resume.checkpoint import Kept

__all__ = ["Parts"]

RESULT = "part"
"""Name of a finished part beside its checkpoints."""
FILE = f"{RESULT}.npz"


class Parts:
    """Parts by name and digest.

    Args:
        folder: where they lie; None = nowhere, everything is made.
        every_s: seconds between two checkpoints of a part, see :class:`Kept`.
    """

    def __init__(self, folder: Path | None = None, every_s: float | None = None) -> None:
        self.folder, self.every_s = folder, every_s
        self.asked: dict[str, str] = {}

    def once(
        self, name: str, digest: str, make: Callable[[Kept], Mapping[str, NDArray[Any]]]
    ) -> dict[str, NDArray[Any]]:
        """The arrays of a part: made if they are not there yet.

        Args:
            make: gets room for its checkpoints, from which an interrupted call is continued by the next.
        """
        self.asked[name] = digest
        kept = Kept(None if self.folder is None else self.folder / name / digest, self.every_s)
        return kept.once(RESULT, lambda: make(kept))

    def tidy(self) -> None:
        """Keep the parts that were asked for, and of them the results alone."""
        for path in self._all():
            if self.asked.get(path.parent.name) != path.name:
                shutil.rmtree(path, ignore_errors=True)
                continue
            for file in path.iterdir():
                if file.name != FILE:
                    file.unlink(missing_ok=True)
        self._drop_empty()

    def drop_unfinished(self) -> None:
        """Keep finished parts alone: the state of one that failed may be what is wrong."""
        for path in self._all():
            if not (path / FILE).is_file():
                shutil.rmtree(path, ignore_errors=True)
        self._drop_empty()

    def _all(self) -> list[Path]:
        if self.folder is None or not self.folder.is_dir():
            return []
        return [path for name in self.folder.iterdir() for path in name.iterdir()]

    def _drop_empty(self) -> None:
        if self.folder is not None and self.folder.is_dir():
            for name in list(self.folder.iterdir()):
                with suppress(OSError):  # it still has a part
                    name.rmdir()
