"""The single objects of a drive, to look through and to choose from."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

from unveil_core.base.errors import SelectionError, WorkspaceError
from unveil_core.pipeline.settings import RunSettings
from unveil_core.semantics.instances import Box
from unveil_core.workspace.files import listed_objects
from unveil_core.workspace.workspace import Workspace

__all__ = ["ObjectList", "StreetObject", "read_objects"]


@dataclass(frozen=True, eq=False)
class StreetObject:
    """An object that can be removed.

    Attributes:
        id: by which it is chosen.
        cls: its class, as "car".
        source: "boxes" of the dataset, "images", "clusters", "box" or "mattes" by hand: where it comes from.
        frames: number of frames that show it; first_frame, last_frame: their names, None where none does.
        points: number of the drive's points on it.
        distance: from the nearest camera that sees it, metres; None where its place is not known.
        box: centre, size and yaw in local metres, or None.
        thumbnail: a picture of it, or None.
    """

    id: int
    cls: str
    source: str
    frames: int
    first_frame: str | None
    last_frame: str | None
    points: int
    distance: float | None
    box: Box | None
    thumbnail: Path | None


class ObjectList(Sequence[StreetObject]):
    """Objects of a workspace. ``filter`` takes any predicate; ``select`` lets later runs remove what is in the list."""

    def __init__(self, workspace: Workspace, objects: Sequence[StreetObject]) -> None:
        self._workspace, self._objects = workspace, tuple(objects)

    @overload
    def __getitem__(self, index: int) -> StreetObject: ...
    @overload
    def __getitem__(self, index: slice) -> ObjectList: ...
    def __getitem__(self, index: int | slice) -> StreetObject | ObjectList:
        if isinstance(index, slice):
            return ObjectList(self._workspace, self._objects[index])
        return self._objects[index]

    def __len__(self) -> int:
        return len(self._objects)

    def __iter__(self) -> Iterator[StreetObject]:
        return iter(self._objects)

    def __repr__(self) -> str:
        return f"ObjectList({', '.join(f'{o.cls} {o.id}' for o in self._objects)})"

    @property
    def ids(self) -> tuple[int, ...]:
        """The ids, in the order of the list."""
        return tuple(o.id for o in self._objects)

    def filter(self, predicate: Callable[[StreetObject], bool]) -> ObjectList:
        """The objects for which a predicate is true: ``objects.filter(lambda o: o.cls == "car" and o.frames > 10)``."""
        return ObjectList(self._workspace, [o for o in self._objects if predicate(o)])

    def select(self, remove: Sequence[str] = ()) -> RunSettings:
        """Let later runs remove these objects alone, and all objects of some classes; the choice is recorded.

        Args:
            remove: classes and groups that go whole beside them.
        Returns:
            the settings with which the workspace's ``run`` goes on.
        Raises:
            SelectionError: the list is empty, and no class is named.
        """
        from unveil_core.pipeline.options.given import settings_of_values
        from unveil_core.pipeline.run import run_verb

        if not self._objects and not remove:
            raise SelectionError("Nothing is selected", mend="filter so that an object is left, or name classes")
        before = RunSettings.from_json(self._workspace.state().get("settings", {}))
        chosen = settings_of_values({"instances": self.ids, "remove": list(remove)}, before)
        run_verb("choose", self._workspace.root, chosen)
        return chosen


def read_objects(workspace: Workspace) -> ObjectList:
    """The objects that a workspace lists.

    Raises:
        WorkspaceError: objects.json is missing or damaged.
    """
    if not workspace.objects_json.is_file():
        raise WorkspaceError("Not listed yet: objects", path=workspace.root, mend="run `unveil objects`")
    try:
        return ObjectList(workspace, [_object(workspace.root, entry) for entry in listed_objects(workspace)])
    except (KeyError, TypeError, ValueError) as error:
        mend = "run `unveil objects` again"
        raise WorkspaceError(f"Not a list of objects: {error}", path=workspace.objects_json, mend=mend) from error


def _object(root: Path, entry: dict[str, Any]) -> StreetObject:
    box, picture, distance = entry.get("box"), entry.get("thumbnail"), entry.get("distance_m")
    return StreetObject(
        id=entry["id"],
        cls=str(entry["class"]),
        source=str(entry["source"]),
        frames=int(entry["frames"]),
        first_frame=entry.get("first_frame"),
        last_frame=entry.get("last_frame"),
        points=int(entry["points"]),
        distance=None if distance is None else float(distance),
        box=None if box is None else Box.from_json(box),
        thumbnail=None if picture is None else root / str(picture),
    )
