"""What a check of a drive finds, within a minute and without a workspace: the page and the command show it."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from unveil_core.base.disk.rights import rights_of_files
from unveil_core.base.errors import DriveError
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float64
from unveil_core.checkup.labels import LabelPicture, label_pictures
from unveil_core.checkup.points import PointsPicture, points_picture
from unveil_core.checkup.way import WayPicture, way_picture
from unveil_core.drives import open_drive
from unveil_core.drives.checks.conventions import OPENCV
from unveil_core.drives.checks.findings import Finding
from unveil_core.drives.checks.points_seen import some_points
from unveil_core.drives.checks.poses import CONVENTION_NAMES
from unveil_core.drives.checks.way import height_above_ground
from unveil_core.drives.drive import Drive, Frame, Sweep, tracks
from unveil_core.drives.importing.check import Checked, check_drive
from unveil_core.drives.importing.whole_drive import localized
from unveil_core.drives.labels.semantic_codes import ORDER_NAMES
from unveil_core.drives.scale_and_up import Placement, place_drive
from unveil_core.labelling.object_points import REMOVABLE_IDS
from unveil_core.pipeline.forecasting import workload_of
from unveil_core.pipeline.run import found_wrong
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.steps.import_ import labels_come_from

__all__ = ["Examined", "examine_drive"]

T = TypeVar("T")
MOST_FRAMES = 240
"""Frames that are decoded; of longer drives so many, evenly chosen: a frame of full HD takes some 40 ms."""
SWEEPS_OF_MAP = 6
"""Sweeps whose points are drawn from above, of a drive that has its points in such."""
SOURCES = {
    "segmenter": "labels come from the network",
    "drive": "labels come from the drive's label images",
    "masks": "masks say what to remove",
    "folder": "labels come from the folder of --labels",
    "dataset": "labels come from the dataset's label images",
    "boxes": "labels follow from boxes of objects and points",
    "points": "labels follow from the classes of points",
    "nothing": "no labels, masks or boxes say what can be removed",
}


@dataclass(frozen=True, eq=False)
class Examined:
    """Everything that the page shows.

    Attributes:
        name: of the drive; root: where it lies.
        facts: what it is, name and value each.
        assumed: what is taken of it, a line each; told: what its reader tells.
        findings: what looks wrong, the worst first.
        way: from above; points: of the drive in one photograph, None where it has none near; labels: of three photographs.
        rights: that the photographs have in common.
    """

    name: str
    root: Path
    facts: tuple[tuple[str, str], ...]
    assumed: tuple[str, ...]
    told: tuple[str, ...]
    findings: tuple[Finding, ...]
    way: WayPicture
    points: PointsPicture | None
    labels: tuple[LabelPicture, ...]
    rights: int = 0o600

    @property
    def asks(self) -> bool:
        """Whether a run would not begin without being told to."""
        return any(f.asks for f in self.findings)


def examine_drive(path: str | Path, settings: RunSettings | None = None, progress: Progress = no_progress) -> Examined:
    """Look at a drive as a run with these settings would take it. Nothing is left on the disk.

    Args:
        path: of the drive, as ``open_drive`` takes it.
        settings: of the run that is thought of.
        progress: called per step.
    Raises:
        UnveilError: it cannot be read, or is not whole.
    """
    settings = settings or RunSettings()
    progress(0, 6, "opening the drive")
    drive = open_drive(path, settings.drive_options)
    progress(1, 6, "decoding its files")
    checked, seen = _checked(drive)
    placement = place_drive(drive, scale=settings.scale, up=settings.up, camera_height_m=settings.camera_height)
    progress(2, 6, "comparing poses, points and photographs")
    findings = found_wrong(seen, placement, settings, checked)
    source = labels_come_from(drive, settings)
    there = localized(drive, placement)
    progress(3, 6, "drawing the way")
    sweeps = _evenly(there.sweeps, SWEEPS_OF_MAP)
    way = way_picture(there, [p for s in sweeps if (p := _points(s)) is not None])
    progress(4, 6, "projecting points")
    points = points_picture(there)
    progress(5, 6, "drawing labels")
    with tempfile.TemporaryDirectory(prefix="unveil-check-") as scratch:
        labels = label_pictures(drive, placement, settings, Path(scratch), _fullest(seen, checked))
    progress(6, 6, "done")
    return Examined(
        name=_name(Path(path)),
        root=drive.root,
        facts=tuple(_facts(there, drive, placement, settings, len(seen.frames))),
        assumed=(placement.message(), SOURCES[_told_source(drive, source, settings)], *_taken(drive, settings)),
        told=drive.notices,
        findings=tuple(findings),
        way=way,
        points=points,
        labels=tuple(labels),
        rights=rights_of_files(f.image_path for f in drive.frames),
    )


def _checked(drive: Drive) -> tuple[Checked, Drive]:
    """What was seen of the labels of the frames that are decoded, and the drive with these frames."""
    frames = drive.frames
    if len(frames) > MOST_FRAMES:
        frames = tuple(_evenly(frames, MOST_FRAMES))
    part = replace(drive, frames=frames)
    return check_drive(part), part


def _fullest(drive: Drive, checked: Checked) -> Frame | None:
    """The frame of which most can be removed, by labels that lie in files; None where there are none."""
    of_classes = checked.classes[:, list(REMOVABLE_IDS)].sum(axis=1) / np.maximum(checked.classes.sum(axis=1), 1)
    shares = np.fmax(of_classes, checked.masked)
    return drive.frames[int(shares.argmax())] if shares.any() else None


def _evenly(items: Sequence[T], most: int) -> list[T]:
    count = len(items)
    if count <= most:
        return list(items)
    return [items[k] for k in sorted({round(i * (count - 1) / (most - 1)) for i in range(most)})]


def _points(sweep: Sweep) -> Float64 | None:
    with suppress(DriveError):
        return sweep.read().positions
    return None


def _name(path: Path) -> str:
    whole = path.absolute()
    return whole.parent.name if whole.suffix.lower() == ".json" else whole.name


def _facts(
    there: Drive, drive: Drive, placement: Placement, settings: RunSettings, decoded: int
) -> list[tuple[str, str]]:
    """Name and value of what a drive is.

    Args:
        there: the drive in metres; drive: as read.
        decoded: frames whose files were decoded.
    """
    work = workload_of(there, settings)
    cameras = Counter(f.camera_name for f in drive.frames)
    sizes = Counter((f.camera.width, f.camera.height) for f in drive.frames)
    points = f"{len(drive.points.positions):,}" if len(drive.points.positions) else "in sweeps"
    rows = [
        (
            "frames",
            f"{len(drive.frames)}, of which {decoded} were decoded"
            if decoded < len(drive.frames)
            else f"{len(drive.frames)}",
        ),
        ("cameras", ", ".join(f"{name} ({count})" for name, count in cameras.items())),
        ("size", ", ".join(f"{w} × {h}" for (w, h), _ in sizes.most_common(3))),
        ("way", f"{work.way_m:.0f} m in {work.blocks} block{'s' * (work.blocks > 1)}"),
        ("points", points),
    ]
    if drive.sweeps:
        rows.append(("LiDAR sweeps", f"{len(drive.sweeps)}"))
    boxes = {b.id for f in drive.frames for b in f.boxes}
    if boxes:
        rows.append(("objects with boxes", f"{len(boxes)}"))
    stamps = [f.timestamp for i in max(tracks(drive), key=len) if (f := drive.frames[i]).timestamp is not None]
    if len(stamps) > 1:
        rows.append(("time", f"{stamps[-1] - stamps[0]:.1f} s"))
    # Where the scale is made of the height, it tells nothing.
    height = height_above_ground(drive, some_points(drive), placement) if placement.scale_is_known else None
    if height is not None:
        rows.append(("height of the cameras", f"{height:.2f} m above the ground"))
    return rows


def _told_source(drive: Drive, source: str, settings: RunSettings) -> str:
    """Where the labels come from, as :data:`SOURCES` has it."""
    if source != "drive":
        return source
    if settings.labels is not None:
        return "folder"
    return "drive" if any(f.semantic_path is not None for f in drive.frames) else "masks"


def _taken(drive: Drive, settings: RunSettings) -> list[str]:
    """What is assumed of matrices, labels and masks."""
    lines = []
    if settings.pose_convention is not None or drive.pose_convention != OPENCV:
        given = ", as given" if settings.pose_convention else ""
        lines.append(f"matrices of poses are taken as {CONVENTION_NAMES[drive.pose_convention]}{given}")
    codes = drive.frames[0].codes
    if any(f.semantic_path is not None for f in drive.frames):
        lines.append(f"label pictures hold {ORDER_NAMES.get(codes.semantic.order, codes.semantic.order)}")
    elif any(f.mask_path is not None for f in drive.frames):
        lines.append(f"what is {codes.mask.removes} in a mask is removed")
    return lines
