"""What a stage is: a name, the files it reads and writes, the settings that matter to it, and the function that does the work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from unveil_core.base.progress import Progress
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.workspace import Workspace

__all__ = ["Reporter", "Stage", "StageContext", "silent"]

Reporter = Callable[[dict[str, object]], None]
"""Receives each event as it is logged."""


def silent(event: dict[str, object]) -> None:
    """Report nothing."""


@dataclass(frozen=True)
class Stage:
    """One step from files to files.

    Attributes:
        name: the verb on the command line.
        body: does the work.
        inputs: files and folders read, relative to the workspace.
        optional: read too, but older workspaces lack them.
        outputs: files and folders written, relative to the workspace.
        settings: names of the RunSettings that influence the result.
        version: raised when the body's result changes.
        drive_digest: whether the drive outside the workspace is an input (the import).
    """

    name: str
    body: Callable[[StageContext], None]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    settings: tuple[str, ...] = ()
    version: int = 1
    drive_digest: bool = False
    optional: tuple[str, ...] = ()


@dataclass(frozen=True)
class StageContext:
    """What a stage's body gets.

    Attributes:
        workspace: to read from.
        settings: of the run.
        progress: to call after each unit of work.
        drive: path of the drive as the user gave it.
        partial: where outputs are written, see :meth:`output`.
    """

    workspace: Workspace
    settings: RunSettings
    progress: Progress
    drive: Path
    partial: Path

    def output(self, relative: str) -> Path:
        """The path to write an output to; it moves to the same place in the workspace when the stage has finished."""
        path = self.partial / relative
        path.parent.mkdir(parents=True, exist_ok=True)
        return path
