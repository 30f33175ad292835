"""All readers, and which of them reads a given path. A new format is a module beside this one and a line in ``FORMATS``."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.drives.checks.conventions import with_pose_convention
from unveil_core.drives.checks.sizes import with_sizes_of_pictures
from unveil_core.drives.checks.solved import check_whole
from unveil_core.drives.checks.unread import unread
from unveil_core.drives.drive import Drive
from unveil_core.drives.file_names import with_file_names
from unveil_core.drives.formats import argoverse2, kitti360, kitti_odometry, kitti_raw, pandaset
from unveil_core.drives.formats.colmap.models import find_model, has_model
from unveil_core.drives.formats.colmap.reader import read_colmap
from unveil_core.drives.formats.guard import guarded, with_guarded_readers
from unveil_core.drives.formats.nerfstudio.parts import has_transforms
from unveil_core.drives.formats.nuscenes import reader as nuscenes
from unveil_core.drives.formats.plates import with_plates
from unveil_core.drives.formats.processed import drivestudio, neuralsim, street_gaussians
from unveil_core.drives.formats.shot import reader as shot
from unveil_core.drives.formats.shot.described import FILE as SHOT
from unveil_core.drives.formats.transforms_json import read_transforms_json
from unveil_core.drives.formats.waymo import reading as waymo
from unveil_core.drives.imported import is_imported, read_imported
from unveil_core.drives.labels.understood import with_labels
from unveil_core.drives.selecting import select_part
from unveil_core.drives.travel.order import in_order_of_time, in_order_of_travel
from unveil_core.drives.travel.stamps import in_seconds

__all__ = ["FORMATS", "Format", "drive_at", "open_drive"]


@dataclass(frozen=True)
class Format:
    """One kind of drive on disk.

    Attributes:
        name: as documents call it.
        looked_for: what tells it, for the message where nothing is recognized.
        recognizes: whether a path is of this kind; it looks at names only.
        read: the drive at a path, with all its cameras. Raises DriveError.
        scenes: names of the drives that a folder holds, where it may hold several; ``read`` then takes one of them.
        is_one: whether a folder is such a drive itself, by names alone; where a folder never holds several, ``recognizes``.
        order: what order the frames have as read: "time", or as "file" or "names" say, which the way then has to bear out.
        models: whether a folder may hold several models; ``read`` then takes the name of one, or None.
        takes_convention: ``read`` takes the convention of poses, on which more depends than cameras.
    """

    name: str
    looked_for: str
    recognizes: Callable[[Path], bool]
    read: Callable[..., Drive]
    scenes: Callable[[Path], list[str]] | None = None
    is_one: Callable[[Path], bool] | None = None
    order: str = "time"
    models: bool = False
    takes_convention: bool = False


def _read_workspace(folder: Path) -> Drive:
    """With all its cameras: which are read of the dataset's was decided when it was imported."""
    return replace(read_imported(folder), front_cameras=())


def _is_transforms(path: Path) -> bool:
    return path.suffix.lower() == ".json" and path.name.lower() != SHOT


FORMATS: tuple[Format, ...] = (
    Format(
        "transforms.json",
        "transforms.json",
        lambda p: _is_transforms(p) if p.is_file() else has_transforms(p),
        read_transforms_json,
        order="file",
        takes_convention=True,
    ),
    Format("workspace", "cameras.json", lambda p: (p / "cameras.json").is_file(), _read_workspace, is_one=is_imported),
    Format(
        "a shot",
        ".chan, cameras.xml or shot.json",
        shot.recognizes,
        shot.read_shot,
        order="file",
    ),
    Format(
        "PandaSet",
        "camera/, lidar/ and annotations/ (PandaSet)",
        pandaset.recognizes,
        pandaset.read_pandaset,
        pandaset.scenes,
        pandaset.is_one,
    ),
    Format(
        "nuScenes",
        "v1.0-*/ with samples/ and sweeps/ (nuScenes)",
        nuscenes.recognizes,
        nuscenes.read_nuscenes,
        nuscenes.scenes,
    ),
    Format(
        "neuralsim and StreetUnveiler",
        "scenario.pt (neuralsim, StreetUnveiler)",
        neuralsim.recognizes,
        neuralsim.read_neuralsim,
        neuralsim.scenes,
        neuralsim.is_one,
    ),
    Format(
        "Street Gaussians",
        "pointcloud.npz and ego_pose/ (Street Gaussians)",
        street_gaussians.recognizes,
        street_gaussians.read_street_gaussians,
        street_gaussians.scenes,
        street_gaussians.is_one,
    ),
    Format(
        "DriveStudio",
        "images/, intrinsics/, extrinsics/ and ego_pose/ (DriveStudio, S3Gaussian)",
        drivestudio.recognizes,
        drivestudio.read_drivestudio,
        drivestudio.scenes,
        drivestudio.is_one,
    ),
    Format(
        "Waymo Open v2",
        "camera_image/ and vehicle_pose/ (Waymo Open v2)",
        waymo.recognizes,
        waymo.read_waymo,
        waymo.scenes,
        waymo.is_one,
    ),
    Format(
        "Argoverse 2",
        "city_SE3_egovehicle.feather, calibration/ and sensors/ (Argoverse 2)",
        argoverse2.recognizes,
        argoverse2.read_argoverse2,
        argoverse2.scenes,
        argoverse2.is_one,
    ),
    Format(
        "KITTI raw",
        "oxts/data and image_02/data (KITTI raw)",
        kitti_raw.recognizes,
        kitti_raw.read_kitti_raw,
        kitti_raw.scenes,
        kitti_raw.is_one,
    ),
    Format(
        "KITTI odometry",
        "calib.txt and image_2/ (KITTI odometry)",
        kitti_odometry.recognizes,
        kitti_odometry.read_kitti_odometry,
        kitti_odometry.scenes,
        kitti_odometry.is_one,
    ),
    Format(
        "KITTI-360",
        "data_2d_raw/ with image_00/data_rect (KITTI-360)",
        kitti360.recognizes,
        kitti360.read_kitti360,
        kitti360.scenes,
        kitti360.is_one,
    ),
    Format(
        "COLMAP",
        "sparse/0 (COLMAP)",
        lambda p: find_model(p) is not None,
        read_colmap,
        is_one=has_model,
        order="names",
        models=True,
    ),
)
"""In the order in which they are asked: a processed layout may hold a COLMAP model beside what it knows better."""

SHOWN_SCENES = 8
"""Names that a message lists at most."""


def drive_at(folder: Path) -> Format | None:
    """The format of which a folder is a drive itself, by the names in it; None where it is none, or cannot be looked into. A folder
    that holds several drives of a dataset is not one."""
    for kind in FORMATS:
        with suppress(OSError):
            if folder.is_dir() and (kind.is_one or kind.recognizes)(folder):
                return kind
    return None


def open_drive(path: str | Path, options: DriveOptions | None = None) -> Drive:
    """Read a drive: a transforms.json or its folder, a dataset's folder (see docs/datasets.md), a COLMAP folder, or the drive/
    folder of a workspace.

    Args:
        path: of the drive.
        options: which part of it is read; None = all frames of its front camera, or of all cameras where it names none.
    Raises:
        DriveError: it is none of these, or cannot be read.
        SettingsError: a camera, range or scene that it does not have; a folder of labels that lacks some.
    """
    path, options = Path(path), options or DriveOptions()
    if not path.exists():
        raise DriveError("Not found", path=path, mend="check the path")
    check_whole(path)
    kind = next((f for f in FORMATS if f.recognizes(path)), None)
    if kind is None:
        if (known := unread(path)) is not None:
            raise DriveError(known.problem, path=path, mend=known.mend)
        if path.is_file():
            raise DriveError("Not a drive", path=path, mend="give a transforms.json or a folder")
        looked_for = "; ".join(f.looked_for for f in FORMATS)
        raise DriveError("Not a drive", path=path, mend=f"looked for: {looked_for}")
    if kind.scenes is None and options.scene is not None:
        raise SettingsError(f"a drive of {kind.name} is one scene", mend="leave --scene out")
    if not kind.models and options.model is not None:
        raise SettingsError(f"a drive of {kind.name} has no models to choose from", mend="leave --model out")
    with guarded(path, kind.name):
        scene = () if kind.scenes is None else (_scene(kind, path, kind.scenes(path), options.scene),)
        model = {"model": options.model} if kind.models else {}
        given = {"pose_convention": options.pose_convention} if kind.takes_convention else {}
        drive = with_guarded_readers(kind.read(path, *scene, **model, **given), kind.name)
    if options.pose_convention is not None and not kind.takes_convention:
        drive = with_pose_convention(drive, options.pose_convention)
    if not drive.frames and not drive.notices:
        raise DriveError("has no frames", path=path, mend="a drive needs at least one frame")
    drive = in_seconds(with_file_names(drive))
    part = select_part(_in_order(drive, kind), options)
    part = part if kind.read is _read_workspace else with_plates(with_sizes_of_pictures(part))
    return with_labels(part, options, imported=kind.read is _read_workspace)


def _in_order(drive: Drive, kind: Format) -> Drive:
    """The frames in the order of travel."""
    if kind.order == "time":
        return in_order_of_time(drive)
    by_file = kind.order == "file"
    decides = "timestamp" if by_file else "a transforms.json with timestamp"
    return in_order_of_travel(drive, file_order=by_file, decides=decides)


def _scene(kind: Format, path: Path, scenes: list[str], wanted: str | None) -> str:
    """The scene that is meant, where a folder holds several."""
    shown = ", ".join(scenes[:SHOWN_SCENES]) + (
        f" and {len(scenes) - SHOWN_SCENES} more" * (len(scenes) > SHOWN_SCENES)
    )
    if wanted is None and len(scenes) != 1:
        problem = f"holds {len(scenes)} drives of {kind.name}"
        raise DriveError(problem, path=path, mend=f"choose one by --scene: {shown or 'none is complete'}")
    if wanted is not None and wanted not in scenes:
        raise SettingsError(f"{path} has no scene {wanted}", mend=f"it has {shown or 'none'}")
    return wanted if wanted is not None else scenes[0]
