"""The contents of the report, gathered from a workspace; missing files are left out."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import read_own_json
from unveil_core.base.parallel import each
from unveil_core.base.pictures.decoding import read_image, read_label_image
from unveil_core.base.progress import Progress
from unveil_core.base.types import Picture
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.imported import read_imported
from unveil_core.evaluate.delivered import read_delivered
from unveil_core.evaluate.detail.overlay import draw_lines
from unveil_core.geometry.axes import UP
from unveil_core.geometry.camera import Camera
from unveil_core.ground.track import longest_track
from unveil_core.mesh import read_ply, render_mesh_picture
from unveil_core.report.command import name_of_path
from unveil_core.report.pictures import FRAME_BYTES, fitted, jpeg_uri, page_size, pick, region_overlay_uri
from unveil_core.report.provenance import draw_provenance
from unveil_core.report.scene.gathered import ScenePictures, gather_scene
from unveil_core.report.scene.parts import box_of
from unveil_core.report.scene.path import looking
from unveil_core.report.scene.top_view import BACKGROUND
from unveil_core.workspace.files import frame_file

__all__ = ["FramePictures", "MeshPictures", "Shown", "bird_camera", "gather", "read_json", "step_cameras"]

MESH_PICTURE = (720, 450)
PALE_QUALITY = 68
"""Of JPEG, for pictures in which colours mark regions: they need less than photographs."""
KINDS = 7
"""Pictures of a frame at most, beside the overlay of its regions."""
THUMBNAIL = (240, 180)
MOST_THUMBNAILS = 160
"""Objects with a picture. A long drive has thousands of objects."""
THUMBNAIL_BYTES = 9_000
"""Of the page's text for a thumbnail: 1.4 MB for all."""


@dataclass(frozen=True)
class FramePictures:
    """One frame as data URIs; what is not there is None."""

    name: str
    camera_name: str
    before: str
    after: str | None = None
    rendered: str | None = None
    inpainted: str | None = None
    regions: str | None = None
    lines: str | None = None
    provenance: str | None = None
    certainty: str | None = None


@dataclass(frozen=True)
class MeshPictures:
    """One view of the mesh as data URIs."""

    title: str
    before: str | None
    after: str | None


@dataclass(frozen=True)
class Shown:
    """Everything on the page.

    Attributes:
        name: of the drive.
        frame_count: of the whole drive; ``frames`` may show fewer.
        size: width and height of the first frame.
        frames: pictures in order of travel.
        meshes: views of the mesh.
        instances: entries of instances.json, ``picture`` added where there is a thumbnail.
        state: workspace.json.
        metrics: what the evaluation returned, or None.
        scene: the empty scene, or None.
        workspace: the name of the workspace's folder.
    """

    name: str
    frame_count: int
    size: tuple[int, int]
    frames: tuple[FramePictures, ...]
    meshes: tuple[MeshPictures, ...] = ()
    instances: tuple[dict[str, Any], ...] = ()
    state: dict[str, Any] = field(default_factory=dict)
    metrics: dict[str, Any] | None = None
    scene: ScenePictures | None = None
    workspace: str = "workspace"


AGAIN = "run the stage that writes it again"


def read_json(path: Path, default: Any) -> Any:
    """Parsed JSON, or ``default`` where there is no such file.

    Raises:
        WorkspaceError: the file is damaged.
    """
    if not path.is_file():
        return default
    try:
        return read_own_json(path)
    except (OSError, ValueError) as error:
        raise WorkspaceError(f"cannot be read: {error}", path=path, mend=AGAIN) from error


@contextmanager
def understood(place: Path) -> Iterator[None]:
    """Errors in going through what JSON files of a workspace hold become a WorkspaceError that names ``place``: they hold what no
    stage writes."""
    try:
        yield
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        problem = f"holds what no stage of this version writes: {type(error).__name__} {error}"
        raise WorkspaceError(problem, path=place, mend=AGAIN) from error


def gather(root: Path, metrics: dict[str, Any] | None, progress: Progress) -> Shown:
    """Read a workspace and make all pictures of the page."""
    drive = read_imported(root / "drive", points=False)
    state = read_json(root / "workspace.json", {})
    chosen = pick(len(drive.frames))
    whole = 2 * len(chosen) + 2  # the flight takes about as long as the frames
    frames: list[FramePictures] = []
    for pictures in each(lambda index: _frame_pictures(root, drive, drive.frames[index], len(chosen)), chosen):
        frames.append(pictures)
        progress(len(frames), whole, "writing the report")
    meshes = _mesh_pictures(root, drive)

    def flying(done: int, total: int, message: str = "", **metrics: float) -> None:
        progress(len(chosen) + 1 + done * len(chosen) // total, whole, message, **metrics)

    instances = _instances(root)
    boxes = [box for box in map(box_of, (e for e in instances if e.get("removed"))) if box is not None]
    scene = gather_scene(root, drive, np.array([box.centre for box in boxes]).reshape(-1, 3), flying)
    progress(whole, whole, "writing the report")
    first = drive.frames[0].camera if drive.frames else None
    return Shown(
        name=_drive_name(root, state),
        frame_count=len(drive.frames),
        size=(first.width, first.height) if first else (0, 0),
        frames=tuple(frames),
        meshes=meshes,
        instances=instances,
        state=state,
        metrics=metrics if metrics is not None else read_json(root / "metrics.json", None),
        scene=scene,
        workspace=root.resolve().name,
    )


def _drive_name(root: Path, state: dict[str, Any]) -> str:
    path = PurePosixPath(name_of_path(str(state.get("drive", "")), of_drive=True))
    if path.suffix == ".json":
        path = path.parent
    return path.name or root.resolve().name


def _frame_pictures(root: Path, drive: Drive, frame: Frame, count: int) -> FramePictures:
    size = page_size(frame.camera.width, frame.camera.height, count)
    most = FRAME_BYTES // (count * KINDS)

    def picture(folder: str) -> str | None:
        path = root / folder / frame.camera_name / f"{frame.name}.png"
        return jpeg_uri(fitted(read_image(path), size), most=most) if path.is_file() else None

    # The footage's lens is taken off: the page lays this over the imported photograph.
    there = frame_file(root / "frames", frame).is_file()
    delivered = jpeg_uri(fitted(read_delivered(root, frame), size), most=most) if there else None
    lines = draw_lines(root, drive.truth_root, frame, size) if there and drive.truth_root is not None else None
    drawn = draw_provenance(root, frame, size) if there else None
    regions = root / "regions" / frame.camera_name / f"{frame.name}.png"
    return FramePictures(
        name=frame.name,
        camera_name=frame.camera_name,
        before=jpeg_uri(fitted(read_image(frame.image_path), size), most=most),
        after=delivered,
        lines=None if lines is None else jpeg_uri(lines, most=most),
        provenance=None if drawn is None else jpeg_uri(drawn[0], PALE_QUALITY, most),
        certainty=None if drawn is None else jpeg_uri(drawn[1], PALE_QUALITY, most),
        rendered=picture("renders"),
        inpainted=picture("inpainted"),
        regions=(
            region_overlay_uri(fitted(read_label_image(regions), size, labels=True)) if regions.is_file() else None
        ),
    )


def _instances(root: Path) -> tuple[dict[str, Any], ...]:
    """The entries of instances.json, those that were removed first; the first have pictures."""
    entries = read_json(root / "instances.json", [])
    known = [e for e in entries if isinstance(e, dict)] if isinstance(entries, list) else []
    shown = []
    for place, entry in enumerate(sorted(known, key=lambda e: not e.get("removed"))):
        name = entry.get("thumbnail")
        entry = {key: value for key, value in entry.items() if key != "picture"}  # ours to add
        path = (root / str(name)).resolve() if name else None
        # A thumbnail is a file of this workspace, whatever the JSON says.
        if place < MOST_THUMBNAILS and path is not None and path.is_file() and path.is_relative_to(root.resolve()):
            entry["picture"] = jpeg_uri(_thumbnail(read_image(path)), most=THUMBNAIL_BYTES)
        shown.append(entry)
    return tuple(shown)


def _thumbnail(picture: Picture) -> Picture:
    """At most :data:`THUMBNAIL` in both directions."""
    height, width = picture.shape[:2]
    scale = min(1.0, THUMBNAIL[0] / width, THUMBNAIL[1] / height)
    return fitted(picture, (max(1, round(width * scale)), max(1, round(height * scale))))


# --------------------------------------------------------------------------------------------------------------- meshes


def _mesh_pictures(root: Path, drive: Drive) -> tuple[MeshPictures, ...]:
    paths = {state: root / "meshes" / f"{state}.ply" for state in ("full", "empty")}
    meshes = {state: read_ply(path, drive.to_world) for state, path in paths.items() if path.is_file()}
    if not any(len(m.faces) for m in meshes.values()) or not drive.frames:
        return ()
    views = [("From above", bird_camera(drive)), ("From the road", _street_camera(root, drive))]
    pictures = []
    for title, camera in views:
        drawn: dict[str, str] = {
            state: jpeg_uri(render_mesh_picture(mesh, camera, MESH_PICTURE, background=BACKGROUND), 84)
            for state, mesh in meshes.items()
        }
        pictures.append(MeshPictures(title, drawn.get("full"), drawn.get("empty")))
    return tuple(pictures)


def step_cameras(drive: Drive) -> list[Camera]:
    """The cameras of the track that has gone the longest way, in order of travel."""
    return [drive.frames[i].camera for i in longest_track(drive)]


def bird_camera(drive: Drive) -> Camera:
    """A view from behind and above the start of the drive, along it."""
    cameras = step_cameras(drive)
    places = np.stack([c.centre for c in cameras])
    up = UP
    length = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    heading = _level(places[-1] - places[0], up)
    if heading is None:
        heading = _level(cameras[0].forward, up)
    if heading is None:
        heading = _level(np.eye(3)[int(np.argmin(np.abs(up)))], up)
    assert heading is not None
    reach = max(length, 1e-3)
    rise = float(np.clip(0.22 * reach, 5.0, 12.0))
    eye = places[0] - 0.35 * rise * heading + rise * up
    target = places[0] + (1.1 * rise + 0.25 * reach) * heading
    return looking(eye, target, up, MESH_PICTURE, 0.85 * MESH_PICTURE[0])


def _level(direction: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float64] | None:
    flat = direction - (direction @ up) * up
    length = float(np.linalg.norm(flat))
    return flat / length if length > 1e-6 else None


def _street_camera(root: Path, drive: Drive) -> Camera:
    """The frame that shows most of what was removed, with the picture's shape."""
    best, most = drive.frames[0], -1
    for frame in drive.frames:
        path = root / "masks/removed" / frame.camera_name / f"{frame.name}.png"
        area = int(np.count_nonzero(read_label_image(path))) if path.is_file() else 0
        if area > most:
            best, most = frame, area
    camera = best.camera
    width, height = MESH_PICTURE
    scale = max(width / camera.width, height / camera.height)
    return replace(
        camera,
        width=width,
        height=height,
        fx=camera.fx * scale,
        fy=camera.fy * scale,
        cx=camera.cx * scale - (camera.width * scale - width) / 2,
        cy=camera.cy * scale - (camera.height * scale - height) / 2,
    )
