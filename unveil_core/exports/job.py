"""What an export works on: a workspace, its settings, and the parts that several formats read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.errors import SettingsError, WorkspaceError
from unveil_core.base.files import read_own_json
from unveil_core.base.pictures.colours import Colours
from unveil_core.base.ply.reading import read_vertices
from unveil_core.base.progress import Progress, no_notice, no_progress
from unveil_core.base.types import Labels
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.exposure import Exposures, read_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.drives.importing.colours import colours_of_footage, looked_at
from unveil_core.exports.mapping.epsg import wkt_of
from unveil_core.exports.splats.shortened import shortened
from unveil_core.mesh import Mesh, decimate, read_ply
from unveil_core.semantics.classes import VOID
from unveil_core.semantics.instances import Box
from unveil_core.semantics.labels import SceneLabels
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.scene_edit import read_edit
from unveil_core.surfels.surfels import Surfels
from unveil_core.workspace.files import frame_file, load_array, load_labels
from unveil_core.workspace.scene_states import SCENE_STATES, scene_file
from unveil_core.workspace.workspace import Workspace

__all__ = ["START_FRAME", "STATES", "TEXTURE_PX", "Job"]

STATES = SCENE_STATES
START_FRAME = 1001
"""Number of the first frame of a track: film and television begin their shots there, so that handles before it have numbers."""

TEXTURE_PX = 4096
"""Side of a page of a texture: what every program and every graphics card of the last ten years takes."""


@dataclass(frozen=True, eq=False)
class Job:
    """One export of one or more formats. Its parts are read when they are first asked for.

    Attributes:
        workspace: a finished one.
        state: of :data:`STATES`, for formats that hold the scene.
        triangles: of a mesh at most, None for all.
        levels: of detail of a textured mesh, besides the finest.
        texture_px: side of a page of its texture.
        start_frame: number of the first frame of each track.
        spz_version: of an SPZ file.
        epsg: codes of the coordinate system that the drive's coordinates are of, see :mod:`unveil_core.exports.mapping.epsg`; ""
            where nobody tells.
        undistorted: whether cameras and pictures for other programs are pinhole, their lens taken out.
        progress: called by long formats; notice: with what a user should know of what was written, one line each.
        made: what formats of one kind have in common, by the kind: made by the first of them.
    """

    workspace: Workspace
    state: str = "empty"
    triangles: int | None = None
    levels: int = 0
    texture_px: int = TEXTURE_PX
    start_frame: int = START_FRAME
    spz_version: int = 3
    epsg: str = ""
    undistorted: bool = False
    progress: Progress = field(default=no_progress)
    notice: Callable[[str], None] = field(default=no_notice)
    made: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def drive(self) -> Drive:
        """The imported drive, without its points."""
        return read_imported(self.workspace.drive_dir, points=False)

    @cached_property
    def exposures(self) -> Exposures:
        """Of each frame of the drive."""
        return read_exposures(self.workspace.exposure_json)

    def colours(self, frame: Frame) -> Colours:
        """Of the footage that a frame is delivered as."""
        known: dict[Path, Colours] = self.made.setdefault("colours", {})
        if frame.image_path not in known:
            known[frame.image_path] = colours_of_footage(frame)
        return known[frame.image_path]

    @cached_property
    def colorspace(self) -> str:
        """Name of the footage's colours, by the Color Interop Forum where it has one; the names of all where there are several."""
        found = {c.encoded or c.name: None for c in map(self.colours, looked_at(self.drive.frames))}
        return ", ".join(found)

    @cached_property
    def scene(self) -> Surfels:
        """The surfels of the state for other programs, in local coordinates, see :meth:`for_viewers`.

        Raises:
            WorkspaceError: they are not there yet.
        """
        return self.for_viewers(self.full if self.state == "full" else self.surfels(self.state))

    @cached_property
    def full(self) -> Surfels:
        """The surfels with everything in them, as they are."""
        return self.surfels("full")

    def surfels(self, state: str) -> Surfels:
        """The surfels of a state as they are."""
        return read_surfels(scene_file(self.workspace, state))

    def for_viewers(self, surfels: Surfels) -> Surfels:
        """Surfels for programs that show them from anywhere, see :func:`unveil_core.exports.splats.shortened.shortened`."""
        return shortened(surfels, np.array([f.camera.centre for f in self.drive.frames]).reshape(-1, 3))

    @cached_property
    def mesh(self) -> Mesh:
        """The mesh of the state, in local coordinates, with at most as many triangles as asked.

        Raises:
            WorkspaceError: no mesh there yet, or nothing in it.
            SettingsError: too few triangles, or a state that has no mesh.
        """
        if self.state == "edited":
            raise SettingsError(
                "the edited scene has no mesh", mend="export splats of it, or the mesh of --state empty"
            )
        source = self.workspace.root / "meshes" / f"{self.state}.ply"
        mesh = read_ply(source, self.drive.to_world)
        if not len(mesh.faces):
            raise WorkspaceError("has no triangles", path=source, mend="run `unveil mesh` on a scene that has surfaces")
        if self.triangles is None:
            return mesh
        try:
            return decimate(mesh, self.triangles)
        except SettingsError as error:
            raise SettingsError(error.problem, path=source, mend=error.mend) from error

    @cached_property
    def labels(self) -> SceneLabels:
        """The labels that occur."""
        return load_labels(self.workspace)

    def train_ids(self, surfels: Surfels) -> Labels:
        """(N,) what stands for the labels of surfels in files: Cityscapes trainIds, 255 none; of a scene of masks only 0 and 1."""
        ids = np.append(np.array(self.labels.labels.disk_ids, dtype=np.int64), VOID)
        known = surfels.labels.numpy()
        found: Labels = ids[np.where((known < 0) | (known >= len(ids) - 1), len(ids) - 1, known)]
        return found

    @cached_property
    def coordinate_system(self) -> str | None:
        """The system of the drive's coordinates as WKT 1, None where nobody tells.

        Raises:
            SettingsError: see :func:`unveil_core.exports.mapping.epsg.wkt_of`.
        """
        return wkt_of(self.epsg, self.drive)

    @cached_property
    def objects(self) -> list[dict[str, Any]]:
        """Entries of instances.json: objects that have surfels. Each has an ``id``, a ``class``, and a ``box`` or None. Empty where
        the workspace has none.

        Raises:
            WorkspaceError: it is damaged.
        """
        path = self.workspace.root / "instances.json"
        if not path.is_file():
            return []
        try:
            entries = read_own_json(path)
            for entry in entries:
                if type(entry["id"]) is not int or not 0 < entry["id"] < 65536 or type(entry["class"]) is not str:
                    raise ValueError("an object without id or class")
                box = entry.get("box")
                entry["box"] = None if box is None else Box.from_json(box).to_json()
        except (OSError, ValueError, KeyError, TypeError) as error:
            mend = "run `unveil instances` again"
            raise WorkspaceError(f"Not a list of objects: {error}", path=path, mend=mend) from error
        return list(entries)

    @cached_property
    def full_instances(self) -> Labels:
        """(N,) object of each surfel of the full scene, 0 none."""
        return self._array("surfels/instances.npy", len(self.full)).astype(np.int64)

    def scene_instances(self) -> Labels:
        """(N,) object of each surfel of :attr:`scene`, 0 none: what stays in the empty scene keeps its object."""
        count = len(self.scene)
        if self.state == "edited":
            return _column(scene_file(self.workspace, self.state), "instance", count)
        if not (self.workspace.root / "surfels/instances.npy").is_file():
            return np.zeros(count, dtype=np.int64)
        if self.state == "full":
            return self.full_instances
        known = self.full_instances
        stays = known[read_edit(self.workspace.root / "surfels/edit.npz", len(known)).stays]
        if count < len(stays):
            mend = "run `unveil reoptimize` again"
            raise WorkspaceError("Not made from the full scene", path=self.workspace.surfels_empty, mend=mend)
        # The empty scene is what stays, then what was added (pipeline.steps.reoptimize).
        return np.concatenate([stays, np.zeros(count - len(stays), dtype=np.int64)])

    def _array(self, name: str, count: int) -> Labels:
        path = self.workspace.root / name
        found = load_array(path)
        if found.shape != (count,):
            problem = f"Not of this scene: {found.shape[0] if found.ndim else 0} surfels, the scene has {count}"
            raise WorkspaceError(problem, path=path, mend="run `unveil run` again")
        return found

    def delivered(self, frame: Frame) -> Path:
        """The clean frame's file.

        Raises:
            WorkspaceError: it is not there yet.
        """
        path = frame_file(self.workspace.root / "frames", frame)
        if not path.is_file():
            raise WorkspaceError("Not made yet: clean frames", path=path, mend="run `unveil deliver`")
        return path


def _column(path: Path, name: str, count: int) -> Labels:
    """(N,) whole numbers that a file of surfels has beside what all have, 0 where it has none."""
    found = read_vertices(path)
    if name not in found.names:
        return np.zeros(count, dtype=np.int64)
    numbers: Labels = np.nan_to_num(found.columns((name,), np.float64)[:, 0]).astype(np.int64)
    return numbers
