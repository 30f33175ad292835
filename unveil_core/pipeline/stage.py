"""What a stage is: a name, the files it reads and writes, the settings that matter to it, and the function that does the work."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from unveil_core.base.frame_cache import FrameCache
from unveil_core.base.progress import Progress
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.base.resume.parts import Parts
from unveil_core.ground.blocks import block_name
from unveil_core.pipeline.mechanisms import of_stage
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.journal import PARTIAL
from unveil_core.workspace.workspace import Workspace

__all__ = ["Facts", "Notice", "Reporter", "Stage", "StageContext", "note_of_block", "parts_of", "silent"]

Reporter = Callable[[dict[str, object]], None]
"""Receives each event as it is logged."""
Facts = dict[str, object]
"""What workspace.json records of a finished stage beside its files, JSON-able: counts, choices."""
KEPT = "kept"
SCRATCH = ".scratch"
"""Folder beside a stage's outputs that none of them is in."""


def note_of_block(root: Path, stage: str, number: int) -> Path:
    """The file that shows that a block of a stage, made alone, waits for the stage to put all together."""
    return root / f"{PARTIAL}{stage}" / SCRATCH / "blocks" / block_name(number)


def parts_of(root: Path, stage: str) -> Path:
    """The folder in which a workspace keeps the blocks of a stage, each by its own digest: they outlast the stage's attempts."""
    return root / ".blocks" / stage


def silent(event: dict[str, object]) -> None:
    """Report nothing."""


@dataclass(frozen=True)
class Notice:
    """An event about the run itself.

    Attributes:
        stage: that it belongs to; message: one line.
        level: "notice", or "warning" where the user should look.
        details: further entries of the event, JSON-able.
    """

    stage: str
    message: str
    level: str = "notice"
    details: Facts = field(default_factory=dict)


@dataclass(frozen=True)
class StageContext:
    """What a stage's function gets.

    Attributes:
        workspace: to read from; its state is the runner's to write.
        settings: of the run.
        progress: to call after each unit of work.
        drive: path of the drive as the user gave it.
        partial: where outputs are written, see :meth:`output`.
        cache: room for frames, see ``base.frame_cache``.
    """

    workspace: Workspace
    settings: RunSettings
    progress: Progress
    drive: Path
    partial: Path
    cache: FrameCache = field(default_factory=FrameCache)

    def scratch(self, name: str) -> Path:
        """A folder for what the stage computes and reads again. It is gone when the stage has finished, and is still there
        when it was interrupted and is begun again with the same inputs."""
        return self.partial / SCRATCH / name

    @property
    def kept(self) -> Kept:
        """Results within the stage that an interrupted attempt leaves to the next."""
        return Kept(self.scratch(KEPT))

    def parts(self, blocks: int) -> Parts:
        """Results for each block of the drive, which stay for the next run; what is one block has the stage's own digest."""
        stage = self.partial.name.removeprefix(PARTIAL)
        return Parts(parts_of(self.workspace.root, stage) if blocks > 1 else self.scratch("parts"))

    def output(self, relative: str) -> Path:
        """The path to write an output to; it moves to the same place in the workspace when the stage has finished."""
        path = self.partial / relative
        path.parent.mkdir(parents=True, exist_ok=True)
        return path


@dataclass(frozen=True)
class Stage:
    """One step from files to files.

    Attributes:
        name: the verb on the command line.
        run: does the work; returns what is to be recorded beside the files, or None.
        inputs: files and folders read, relative to the workspace. Nothing else in the workspace may be read.
        outputs: files and folders written, relative to the workspace.
        settings: names of the RunSettings that influence the result.
        outside: from workspace, settings and the drive's path the files outside the workspace that are read, each with the name
            under which it counts; the content decides beside that name.
        check: raises an UnveilError, before any stage runs, where the settings name something unusable.
        variant: distinguishes two results that one function makes in two ways (for comparisons).
        run_block: makes what the stage needs of one block of the drive, and keeps it for the stage (see ``ground.blocks``): on
            any machine that shares the workspace. None where the stage has no such parts.
    """

    name: str
    run: Callable[[StageContext], Facts | None]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    settings: tuple[str, ...] = ()
    outside: Callable[[Workspace, RunSettings, Path], Iterable[tuple[str, Path]]] | None = None
    check: Callable[[RunSettings], None] | None = None
    variant: str = ""
    run_block: Callable[[StageContext, int], None] | None = None

    def chosen(self, settings: RunSettings) -> Facts:
        """The settings that influence the result, JSON-able; of mechanisms that a run does without those of this stage."""
        values = settings.to_json() | {"without": of_stage(self.name, settings.without)}
        return {name: values[name] for name in self.settings}
