"""A workspace as Python sees it: frames, objects, scenes, exports. Everything is read when it is asked for."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Unpack

from unveil_core.api.frames import FrameView
from unveil_core.api.objects import ObjectList, read_objects
from unveil_core.base.errors import SettingsError
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.imported import read_imported
from unveil_core.pipeline.options.keywords import SettingKeywords
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.workspace import Workspace as Folder

if TYPE_CHECKING:  # loads torch
    from unveil_core.api.scenes import Scene

__all__ = ["Workspace", "run"]


def run(
    drive: str | os.PathLike[str],
    workspace: str | os.PathLike[str],
    settings: RunSettings | None = None,
    *,
    until: str | None = None,
    reset: bool = False,
    replace: bool = False,
    yes: bool = False,
    reporter: Callable[[dict[str, object]], None] | None = None,
    **keywords: Unpack[SettingKeywords],
) -> Workspace:
    """Run everything that is missing or changed, from a drive on disk to the report.

    A workspace that is there already keeps the settings that it was made with; a keyword changes one, and None takes it back.

    Args:
        drive: a transforms.json, or the folder of a drive: nerfstudio, COLMAP, KITTI, nuScenes, Waymo, …
        workspace: folder of the results; made if need be, continued if it exists.
        settings: all settings of the run, in the place of those that the workspace was made with; keywords go over them.
        until: name of the last stage to run, as "objects" or "deliver".
        reset: take the defaults, not the settings of the workspace.
        replace: whether a workspace with results of another drive may be given this one.
        yes: go on where a check of the drive would ask.
        reporter: is called with each event, a dict as ``--json`` prints it.
        keywords: settings as values of Python: ``remove=["vehicle"]``, ``shadows=(135, 40)``, ``frames=slice(0, 80, 2)``.
    Returns:
        the workspace.
    Raises:
        UnveilError: bad input, in one line with the mend.
        Cancelled: SIGINT or SIGTERM; calling again continues.
    """
    from unveil_core.api.runs import run_with

    made = run_with(
        Path(drive),
        Path(workspace),
        settings,
        keywords,
        until=until,
        reset=reset,
        replace=replace,
        yes=yes,
        reporter=reporter,
    )
    return Workspace(made)


class Workspace(Folder):
    """A workspace folder. ``Workspace.open("street_empty")`` opens one that is there; :func:`unveil_core.run` makes one.

    Attributes:
        root: the folder.
    """

    def __init__(self, root: str | os.PathLike[str]) -> None:
        super().__init__(Path(root))
        self._scenes: dict[str, Scene] = {}

    @staticmethod
    def open(root: str | os.PathLike[str]) -> Workspace:
        """Open an existing workspace.

        Raises:
            WorkspaceError: there is none, or it is damaged or another program's.
        """
        return Workspace(Folder.open(Path(root)).root)

    def __repr__(self) -> str:
        return f"Workspace({str(self.root)!r})"

    @property
    def settings(self) -> RunSettings:
        """The settings that it was last run with."""
        return RunSettings.from_json(self.state().get("settings", {}))

    @cached_property
    def drive(self) -> Drive:
        """What was imported: frames of working size and points, in metres, z up.

        Raises:
            DriveError: nothing was imported yet.
        """
        return read_imported(self.drive_dir)

    def status(self) -> dict[str, str]:
        """By stage "done", "stale", "running", "failed" or "to do"; nothing is written."""
        from unveil_core.pipeline.status import stage_states

        return stage_states(self)

    def run(
        self,
        until: str | None = None,
        *,
        reporter: Callable[[dict[str, object]], None] | None = None,
        **keywords: Unpack[SettingKeywords],
    ) -> Workspace:
        """Go on with the drive that it was made from, and the settings that it was made with, but for those given.

        Arguments, result and errors as of :func:`unveil_core.run`.
        """
        return run(str(self.state().get("drive", "")), self.root, until=until, reporter=reporter, **keywords)

    # ------------------------------------------------------------------------------------------------------ what is in it

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the drive's cameras."""
        return tuple(dict.fromkeys(frame.camera_name for frame in self._frames))

    @cached_property
    def _frames(self) -> tuple[Frame, ...]:
        return read_imported(self.drive_dir, points=False).frames

    def frames(self, camera: str | None = None, size: Literal["footage", "work"] = "footage") -> list[FrameView]:
        """The frames of a camera, or of all, in the order of travel.

        Args:
            camera: its name; None = all.
            size: of pictures and masks: "footage", that of the files and of the delivery, with their lens; or "work", at which the
                scene was made, without a lens.
        Raises:
            SettingsError: it has no such camera, or size.
        """
        if camera is not None and camera not in self.cameras:
            raise SettingsError(f"Not a camera: {camera!r}", mend=f"use one of {', '.join(self.cameras)}")
        if size not in ("footage", "work"):
            raise SettingsError(f"Not a size: {size!r}", mend='use "footage" or "work"')
        chosen = [f for f in self._frames if camera in (None, f.camera_name)]
        return [FrameView(self.root, frame, size, self.scene) for frame in chosen]

    @property
    def objects(self) -> ObjectList:
        """The single objects that can be removed.

        Raises:
            WorkspaceError: none are listed yet.
        """
        return read_objects(self)

    def scene(self, state: Literal["full", "empty"] = "empty") -> Scene:
        """The street with everything in it, or empty. It is read when it is first asked for.

        Raises:
            SettingsError: an unknown state. WorkspaceError: it was not made yet.
        """
        from unveil_core.api.scenes import Scene

        if state not in self._scenes:
            self._scenes[state] = Scene.of(self, state)
        return self._scenes[state]

    def export(
        self,
        to: str | Sequence[str],
        output: str | os.PathLike[str] | None = None,
        *,
        state: Literal["full", "empty"] = "empty",
        triangles: int | None = None,
        lods: int = 0,
        texture: int = 4096,
        start_frame: int = 1001,
        spz: int = 3,
        epsg: str = "",
        undistorted: bool = False,
        replace: bool = False,
    ) -> list[Path]:
        """Write results for other programs, as ``unveil export`` does.

        Args:
            to: formats, as "glb" or ["colmap", "png"]; docs/exports.md lists them.
            output: a folder, or the file of a single format; a mesh goes beside the workspace's by default.
            state: of the scene; triangles: of a mesh at most; lods: more levels of detail; texture: side of a page, pixels.
            start_frame: number of a camera's first plate; spz: version; epsg: coordinate system of LAS.
            undistorted: pinhole cameras and pictures in colmap and nerfstudio.
            replace: write over a file that no export of the workspace made.
        Returns:
            the files and folders.
        Raises:
            UnveilError: an unknown format, a stage that has not run, or a place that holds other things.
        """
        from unveil_core.app.export import export_results

        return export_results(
            self,
            to=(to,) if isinstance(to, str) else tuple(to),
            state=state,
            triangles=triangles,
            levels=lods,
            texture_px=texture,
            start_frame=start_frame,
            spz_version=spz,
            epsg=epsg,
            undistorted=undistorted,
            output=None if output is None else Path(output),
            replace=replace,
        )
