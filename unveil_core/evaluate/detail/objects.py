"""What a workspace calls its objects."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import read_own_json

__all__ = ["ObjectNames", "read_object_names"]


@dataclass(frozen=True)
class ObjectNames:
    """The objects of instances.json.

    Attributes:
        classes: by id.
        kept: ids of those that stay in the street.
    """

    classes: dict[int, str]
    kept: frozenset[int]


def read_object_names(workspace_root: Path) -> ObjectNames:
    """The objects of a workspace; none where it has no instances.json.

    Raises:
        WorkspaceError: the file is damaged.
    """
    path = workspace_root / "instances.json"
    if not path.is_file():
        return ObjectNames({}, frozenset())
    try:
        entries = read_own_json(path)
        classes = {int(e["id"]): str(e.get("class", "object")) for e in entries}
        kept = frozenset(int(e["id"]) for e in entries if not e.get("removed"))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise WorkspaceError(f"cannot be read: {error}", path=path, mend="run `unveil instances` again") from error
    return ObjectNames(classes, kept)
