"""``unveil export``: results in the formats that other programs want."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from unveil_core.base.errors import SettingsError, WorkspaceError
from unveil_core.base.progress import Progress, no_notice, no_progress
from unveil_core.exports.job import START_FRAME, TEXTURE_PX, Job
from unveil_core.exports.registry import ExportFormat, formats_named, place_of
from unveil_core.exports.splats.spz import SPZ_VERSION, check_spz
from unveil_core.exports.writing import export
from unveil_core.pipeline.graph import STAGES
from unveil_core.pipeline.output_place import check_file_place, check_folder_place, drives_of
from unveil_core.pipeline.up_to_date import Digests, changed_result
from unveil_core.workspace.scene_states import check_scene_state
from unveil_core.workspace.workspace import Workspace

__all__ = ["MESHES", "export_results"]

MESHES = ("ply", "obj", "glb")
"""Formats that the suffix of a file may choose, and that go beside the workspace's meshes where no place is named."""
UNREAD = ("report",)
"""Stages of whose results no export takes anything."""
MOST_LEVELS = 6
SMALLEST_PAGE, LARGEST_PAGE = 64, 16_384
"""Sides of a page of textures, pixels: more is too large for graphics cards."""
MOST_FRAME = 9_999_999
"""Number of a first frame at most: more digits are none that compositors count in."""


def export_results(
    workspace: Workspace,
    *,
    to: Sequence[str] = (),
    state: str = "empty",
    triangles: int | None = None,
    levels: int = 0,
    texture_px: int = TEXTURE_PX,
    start_frame: int = START_FRAME,
    spz_version: int = SPZ_VERSION,
    epsg: str = "",
    output: Path | None = None,
    replace: bool = False,
    undistorted: bool = False,
    progress: Progress = no_progress,
    notice: Callable[[str], None] = no_notice,
) -> list[Path]:
    """Write results of a workspace in one or more formats, in the drive's coordinates (see ``exports.coordinates``).

    Args:
        workspace: a finished one.
        to: names of ``exports.registry.FORMATS``; without any, the mesh format that the suffix of ``output`` names.
        state: one of ``exports.job.STATES``.
        triangles: the most that a mesh may have; None for all, or for 200,000 of a mesh with textures.
        levels: of detail of a mesh with textures, besides the finest, 0 to 6; texture_px: side of a page, 256 to 16,384.
        start_frame: number of the first plate of each track.
        spz_version: 2, 3 or 4, of ``spz``.
        epsg: code of the coordinate system that the drive's coordinates are of, for ``las`` and ``laz``; "" for none.
        output: a folder; of a single format that is one file, also that file, with its suffix. A single mesh goes to
            ``meshes/<state>_<triangles or all>.<format>`` by default.
        replace: whether a file that no export of the workspace made may be written over.
        undistorted: whether cameras and pictures of ``colmap`` and ``nerfstudio`` are pinhole, their lens taken out.
        progress: called by long formats; notice: with what a user should know of what was written.
    Returns:
        the files and folders written.
    Raises:
        SettingsError: an unknown format or state, a library that is missing, too few triangles, or a place that holds other things.
        WorkspaceError: a stage that a format needs has not run.
        UnveilError: it cannot be written.
    """
    check_scene_state(state)
    if not 0 <= start_frame <= MOST_FRAME:
        raise SettingsError(f"Not the number of a frame: --start-frame {start_frame}", mend=f"use 0 to {MOST_FRAME}")
    if not 0 <= levels <= MOST_LEVELS:
        raise SettingsError(f"Not a number of levels of detail: --lods {levels}", mend=f"use 0 to {MOST_LEVELS}")
    if not SMALLEST_PAGE <= texture_px >> levels <= texture_px <= LARGEST_PAGE:
        mend = (
            f"use {SMALLEST_PAGE} to {LARGEST_PAGE:,}, and fewer --lods for small pages: each level has half the side"
        )
        raise SettingsError(f"Not the side of a page: --texture {texture_px}", mend=mend)
    formats = formats_named(to or _of_suffix(output))
    check_spz(spz_version)
    job = Job(
        workspace,
        state,
        triangles,
        levels,
        texture_px,
        start_frame,
        spz_version=spz_version,
        epsg=epsg,
        undistorted=undistorted,
        progress=progress,
        notice=notice,
    )
    places, digests = _places(job, formats, output), Digests(workspace)
    _check_as_made(workspace, digests)
    made = export(job, places, replace=replace)
    with suppress(OSError):  # without it files of a copied workspace are read again
        digests.save()
    return made


def _check_as_made(workspace: Workspace, digests: Digests) -> None:
    """Check that results are as the stages wrote them: a bit that turned over shows in no picture, and goes out with the export.

    Raises:
        WorkspaceError: one is not; with its file.
    """
    for stage in STAGES:
        path = changed_result(stage.name, workspace, digests) if stage.name not in UNREAD else None
        if path is not None:
            raise WorkspaceError(
                f"Not as the stage {stage.name} wrote it"
                if path.is_file()
                else f"Gone since the stage {stage.name} wrote it",
                path=path,
                mend="make it again with unveil run, which keeps yours in kept/; painted frames go in by --corrections",
            )


def _of_suffix(output: Path | None) -> list[str]:
    """The mesh format that a file's name tells; none where no file is named."""
    if output is None:
        return []
    kind = output.suffix.lower().removeprefix(".")
    if kind not in MESHES:
        raise SettingsError("Not a mesh file", path=output, mend=f"use {', '.join(MESHES)}")
    return [kind]


def _places(job: Job, formats: Sequence[ExportFormat], output: Path | None) -> list[tuple[ExportFormat, Path]]:
    """Where each format goes."""
    folder = job.workspace.root / "meshes"
    single = formats[0] if len(formats) == 1 else None
    path = None
    if output is None:
        if single is None or single.name not in MESHES:
            raise SettingsError("Name a folder", mend="give one with -o")
        path = folder / f"{job.state}_{job.triangles or 'all'}.{single.name}"
    elif single is not None and single.suffix and output.suffix and not output.is_dir():
        if output.suffix.lower() != single.suffix:
            raise SettingsError(f"Not the suffix of {single.name}", path=output, mend=f"name it {single.suffix}")
        path = output
    if path is None:
        assert output is not None
        check_folder_place(output, drives_of(job.workspace))
        return [(one, place_of(one, job, output)) for one in formats]
    assert single is not None
    if path.resolve() in {(folder / name).resolve() for name in ("full.ply", "empty.ply", "empty.glb")}:
        raise SettingsError("The workspace's own mesh lies here", path=path, mend="name another file")
    if path.parent.resolve() != folder.resolve():
        check_file_place(path, drives_of(job.workspace))
    return [(single, path)]
