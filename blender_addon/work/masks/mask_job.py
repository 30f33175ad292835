# SPDX-License-Identifier: GPL-3.0-or-later
"""What operators share that have ``unveil mask`` carry an object from pictures of it into all frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import bpy

from ...choice.click_files import FOLDER
from ...formats.drive_files import DriveFrame, ImportedDrive, read_drive
from ...formats.files import own_folder
from ...formats.timeline import timeline_of
from ...scene import cameras, view
from ..job.job_operator import JobOperator, UserError
from ..job.task import Task
from ..operators_outline import list_outlined
from ..operators_run import workspace_of

__all__ = ["MaskJob", "Shown", "carried", "has_frames", "shown_frames"]

DRAWN = "drawn"
"""Within :data:`FOLDER`: the pictures that artists drew or painted, a folder each."""


class Shown:
    """What the scene's camera shows of its drive.

    Attributes:
        root: the workspace; drive: as imported.
        track: name of the camera; frames: its frames; times: of the timeline, of each.
        now: place in them of the one that is shown now.
    """

    def __init__(self, scene: bpy.types.Scene) -> None:
        root = workspace_of(scene)
        assert root is not None  # its drive is shown
        self.root = root
        self.drive: ImportedDrive = read_drive(root)
        self.track = str(cameras.track_of(scene.camera))
        timeline = timeline_of(self.drive, scene.unveil.start_frame)
        self.frames: Sequence[DriveFrame] = self.drive.tracks[self.track]
        self.times: Sequence[int] = timeline.frames[self.track]
        self.now = timeline.at(self.track, scene.frame_current)

    def folder(self, *names: str) -> Path:
        """A folder of pictures of the camera's frames, made if need be."""
        return own_folder(self.root, FOLDER, DRAWN, *names, self.track)


def shown_frames(scene: bpy.types.Scene) -> Shown:
    """Of a scene that looks through a camera of its drive.

    Raises:
        UserError: it is damaged, in one line.
    """
    try:
        return Shown(scene)
    except (OSError, ValueError) as error:
        raise UserError(str(error)) from error


def has_frames(operator: type, context: bpy.types.Context) -> bool:
    """Whether the scene looks through a camera of its drive; an operator's poll tells why not."""
    ready = view.shown_drive(context.scene) is not None and cameras.track_of(context.scene.camera) is not None
    if not ready:
        operator.poll_message_set("Import a drive first, and make a camera of it the scene's")  # type: ignore[attr-defined]
    return ready


class MaskJob(JobOperator):
    """Mix in before ``bpy.types.Operator``."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return has_frames(cls, context) and super().poll(context)

    def task(self, context: bpy.types.Context) -> Task:
        return replace(super().task(context), load=list_outlined)


def carried(root: Path, name: str, *pictures: str) -> list[str]:
    """The command that carries an object into all frames.

    Args:
        root: the workspace; name: of the object.
        pictures: options that name pictures of it.
    """
    return ["mask", str(root), "--object", name, *pictures, "-o", str(own_folder(root, FOLDER))]
