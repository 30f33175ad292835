"""Results written in some formats, each whole or not at all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from unveil_core.base.disk.open_safely import RefusedFileError
from unveil_core.base.disk.rights import keep_rights, rights_of
from unveil_core.base.errors import DiskFullError, SettingsError, UnveilError
from unveil_core.base.files import full_disk
from unveil_core.base.output.single_files import receipts_at, whole_file
from unveil_core.exports.color import SRGB
from unveil_core.exports.job import Job
from unveil_core.exports.registry import ExportFormat
from unveil_core.exports.whole import check_free, whole_folder

__all__ = ["export"]

RECEIPTS = ".exports.json"
WITHOUT_PROFILE = frozenset(
    (
        "splat-ply",
        "spz",
        "splat-gltf",
        "usd-splats",
        "usd-points",
        "ply",
        "obj",
        "glb",
        "usd",
        "textured-glb",
        "textured-obj",
    )
    + ("textured-usd", "las", "laz", "objects-json")
)
"""Formats whose colours every reader takes for sRGB."""


def export(job: Job, places: Sequence[tuple[ExportFormat, Path]], *, replace: bool = False) -> list[Path]:
    """Write the results of some formats, each whole or not at all; what an export before made there is replaced.

    Args:
        job: what to export.
        places: formats, and the file or folder that each makes.
        replace: whether single files that no export made may be written over.
    Returns:
        the files and folders.
    Raises:
        SettingsError: a state that a format does not have, or a place that holds something else.
        WorkspaceError: a stage that a format needs has not run.
        UnveilError: it cannot be written. DiskFullError: no room.
    """
    receipts = receipts_at(job.workspace.root / RECEIPTS, replace=replace)
    for one, path in places:
        if job.state != "empty" and not one.both_states:
            raise SettingsError(f"Not of this state: {one.name} shows the empty street only", mend="leave --state out")
        if not one.suffix:
            check_free(path)
        else:
            receipts.check(path)
        for part in one.needs:
            getattr(job, part)
    shared = rights_of(job.workspace.drive_dir / name for name in ("images", "footage"))
    without = [one.name for one, _ in places if one.name in WITHOUT_PROFILE]
    if without and job.colorspace != SRGB:
        job.notice(f"{', '.join(without)}: the colours are the footage's ({job.colorspace}); these files cannot say so")
    for one, path in places:
        try:
            with whole_file(path, receipts) if one.suffix else whole_folder(path) as made:
                one.write(job, made)
                keep_rights((made.parent,), shared)
        except RefusedFileError:
            raise
        except OSError as error:
            if full := full_disk(error, path.parent):
                raise DiskFullError(full) from error
            raise UnveilError(f"cannot be written: {error.strerror}", path=path) from error
    return [path for _, path in places]
