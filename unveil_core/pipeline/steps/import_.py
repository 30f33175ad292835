"""Stage ``import``: the drive in one layout, undistorted, in metres, at the working size, with labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from unveil_core.base.errors import DriveError
from unveil_core.base.frame_cache import Frames
from unveil_core.base.progress import Progress, no_progress
from unveil_core.drives.drive import Drive, FrameLabels, PointCloud
from unveil_core.drives.imported import pose_facts
from unveil_core.drives.importing.colours import colour_notices
from unveil_core.drives.importing.frames import labels_at_work_size
from unveil_core.drives.importing.whole_drive import import_drive, write_labels
from unveil_core.drives.scale_and_up import place_drive
from unveil_core.labelling.boxes_of_points import points_have_classes, with_boxes_of_points
from unveil_core.pipeline.outside import opened
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Facts, StageContext
from unveil_core.points.of_drive import found_points, lacks_points
from unveil_core.workspace.assumptions import Assumption, assumed

__all__ = ["labels_come_from", "labels_of", "run", "work_side_of"]

WORKING_SIZE_PX = {"draft": 512, "standard": 768, "high": 1600}
"""Longer image side that larger images are reduced to, pixels."""


def work_side_of(settings: RunSettings) -> int:
    """Longer image side that larger images are reduced to, pixels."""
    return settings.work_side or WORKING_SIZE_PX[settings.quality]


def run(context: StageContext) -> Facts:
    """drive/: undistorted, in metres with z up, with labels where the drive has what they follow from."""
    settings = context.settings
    side = work_side_of(settings)
    drive = opened(context.drive, settings.drive_options)
    drive = _with_points(drive, context)
    placement = place_drive(drive, scale=settings.scale, up=settings.up, camera_height_m=settings.camera_height)
    folder = context.output("drive")
    imported = import_drive(
        drive,
        folder,
        work_side=side,
        placement=placement,
        refine=settings.poses == "auto",
        kept=context.kept,
        progress=context.progress,
    )
    labels, source = labels_of(drive, imported, settings, context.progress)
    if labels is not None:
        write_labels(folder, labels, context.progress, together=source in ("boxes", "points"))
    tested = _poses_assumed(pose_facts(folder))
    return {
        **placement.to_json(),
        "labels": source,
        "notices": [*drive.notices, *colour_notices(imported.frames)],
        **assumed(tested),
    }


def _with_points(drive: Drive, context: StageContext) -> Drive:
    """A drive with points: those that its photographs show where it lacks them, the few that it has where these show none."""
    if not lacks_points(drive):
        return drive

    def made() -> dict[str, Any]:
        try:
            points = found_points(drive, context.progress)
        except DriveError:
            if not len(drive.points.positions):
                raise
            return {}
        return {"positions": points.positions, "colors": points.colors}

    found = context.kept.once("points", made)
    if not found:
        return drive
    return replace(drive, points=PointCloud(found["positions"], found["colors"]))


def _poses_assumed(facts: dict[str, Any]) -> list[Assumption]:
    """That photographs and poses agree, by the tracks that decide; nothing where too little was matched."""
    if "given_px" not in facts:
        return []
    found = f"they explain matched features to {facts['given_px']:.2f} pixels"
    instead = "they stay: refined ones explain them no better"
    if facts["refined"]:
        moved = f"{facts['shift_m']:.2f} m and {facts['turn_deg']:.2f} degrees"
        instead = f"refined to {facts['refined_px']:.2f} pixels, by {moved} at most"
    holds = not facts["refined"] and "refined_px" not in facts
    return [Assumption("the poses agree with the photographs", holds, found, instead)]


def labels_of(
    drive: Drive, imported: Drive, settings: RunSettings, progress: Progress = no_progress
) -> tuple[Sequence[FrameLabels] | None, str]:
    """Labels for the frames of a drive that has none in files of its own, and where they come from.

    Args:
        drive: as read; imported: as it was imported.
    """
    source = labels_come_from(drive, settings)
    if source == "segmenter":
        from unveil_core.labelling.segmenter import label_by_network

        return label_by_network(imported, settings.networks["segmenter"]), source
    if source == "dataset":
        return _of_dataset(drive, imported), source
    if source == "boxes":
        from unveil_core.labelling.from_boxes import label_frames

        return label_frames(imported, progress), source
    if source == "points":
        from unveil_core.labelling.from_boxes import label_frames

        return label_frames(with_boxes_of_points(imported), progress), source
    return None, source


def labels_come_from(drive: Drive, settings: RunSettings) -> str:
    """Where the labels of a drive, as read, come from: "segmenter", "drive", its own files; "dataset", its own encoding; "boxes",
    these and its points; "points", classes of these; or "nothing".

    Raises:
        DriveError: the first sweep is looked at for classes and cannot be read.
    """
    if "segmenter" in settings.networks:
        return "segmenter"
    if any(f.semantic_path is not None or f.mask_path is not None for f in drive.frames):
        return "drive"
    if drive.frames and all(f.labels is not None for f in drive.frames):
        return "dataset"
    if any(f.boxes for f in drive.frames):
        return "boxes"
    return "points" if points_have_classes(drive) else "nothing"


def _of_dataset(drive: Drive, imported: Drive) -> Sequence[FrameLabels]:
    def of_frame(i: int) -> FrameLabels:
        frame = drive.frames[i]
        assert frame.labels is not None
        return labels_at_work_size(frame, frame.labels(), imported.frames[i].camera)

    return Frames(len(drive.frames), of_frame)
