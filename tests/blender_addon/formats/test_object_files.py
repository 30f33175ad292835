"""What a workspace lists, as the add-on reads it: of a real one everything, of a damaged one a line that names the file."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blender_addon.formats.drive_files import ImportedDrive, read_drive
from blender_addon.formats.object_files import (
    Choice,
    ListedObject,
    read_choice,
    read_keyframes,
    read_listed,
    read_marks,
    read_moving,
    read_source,
    recorded_drive,
)
from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.pipeline.run import run

READERS: dict[str, Callable[[ImportedDrive], Any]] = {
    "objects.json": read_listed,
    "movers/movers.json": read_moving,
    "selection.json": lambda drive: read_choice(drive.workspace),
    "marked.json": read_marks,
    "inpaint/keyframes.json": lambda drive: read_keyframes(drive.workspace),
    "workspace.json": lambda drive: recorded_drive(drive.workspace),
}
WRITTEN: dict[str, Any] = {
    "movers/movers.json": [{"id": 7}, {"id": None}],
    "marked.json": [
        {"id": 1001, "class": "skip", "centre": [1, 2, 3], "size": [4, 2, 1], "yaw": 0.5},
        {"id": 1002, "mattes": "mattes"},
    ],
    "inpaint/keyframes.json": {"keyframes": [{"camera": "front", "frame": "0003"}]},
}


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> ImportedDrive:
    folder = tmp_path_factory.mktemp("listed")
    root = run(make_tiny_drive(folder / "drive"), folder / "ws", until="choose").root
    for name, content in WRITTEN.items():
        (root / name).parent.mkdir(exist_ok=True)
        (root / name).write_text(json.dumps(content))
    return read_drive(root)


def test_a_real_workspace_is_read(drive: ImportedDrive) -> None:
    classes, (car,) = read_listed(drive)
    assert {c.name for c in classes} == {"road", "sky", "car"}
    assert (car.number, car.class_name, car.frames) == (300, "car", 4)
    assert car.thumbnail is not None and car.thumbnail.is_file()
    assert read_choice(drive.workspace) == Choice(frozenset(), frozenset({"car"}))
    assert read_moving(drive) == {7} and read_source(drive) == "semantics"
    skip, other = read_marks(drive)
    assert skip.box is not None and skip.box.size == (4, 2, 1) and skip.box.yaw == 0.5
    assert other.box is None and Path(other.mattes) == drive.workspace / "mattes"
    assert read_keyframes(drive.workspace) == [("front", "0003")]
    assert recorded_drive(drive.workspace).endswith("transforms.json")


def test_what_is_not_there_is_nothing(tmp_path: Path, drive: ImportedDrive) -> None:
    empty = ImportedDrive(tmp_path, "", {}, drive.offset, 1.0, drive.rotation)
    found = [read(empty) for read in READERS.values()]
    assert found == [([], []), set(), Choice(), [], [], ""]


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("objects.json", lambda d: d["objects"][0].update(thumbnail="../../elsewhere.png")),
        ("objects.json", lambda d: d["objects"][0].update(thumbnail="//host/share/x.png")),
        ("objects.json", lambda d: d["objects"][0].update(id=1 << 40)),
        ("objects.json", lambda d: d["objects"][0]["box"].update(centre=[math.nan, 0, 0])),
        ("objects.json", lambda d: d["objects"][0]["box"].update(size=[1, 2])),
        ("objects.json", lambda d: d["objects"][0].pop("frames")),
        ("objects.json", lambda d: d.update(classes={"road": 1})),
        ("marked.json", lambda d: d[0].update(yaw="north")),
        ("marked.json", lambda d: d[0].update(size=[1e300, 1, 1])),
        ("inpaint/keyframes.json", lambda d: d.update(keyframes=["0003"])),
        ("selection.json", lambda d: d.update(instances=[1.5])),
        ("movers/movers.json", lambda d: d.append("car")),
        ("workspace.json", lambda d: d.update(drive=["x"])),
    ],
)
def test_a_damaged_file_is_one_line_that_names_it(
    drive: ImportedDrive, name: str, change: Callable[[Any], Any]
) -> None:
    path = drive.workspace / name
    before = path.read_text()
    try:
        data = json.loads(before)
        change(data)
        path.write_text(json.dumps(data))
        with pytest.raises(ValueError) as raised:
            READERS[name](drive)
    finally:
        path.write_text(before)
    line = str(raised.value)
    assert line.startswith(f"{path}: Damaged: ") and line.endswith(")") and "\n" not in line


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)


def places(data: Any, way: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Ways to all values within a document."""
    keys = data.keys() if isinstance(data, dict) else range(len(data)) if isinstance(data, list) else ()
    return [way, *(found for key in keys for found in places(data[key], (*way, key)))]


@given(st.sampled_from(sorted(READERS)), st.data())
def test_any_value_anywhere_is_read_or_refused(drive: ImportedDrive, name: str, data: st.DataObject) -> None:
    path = drive.workspace / name
    before = path.read_text()
    document = {"": json.loads(before)}
    *way, last = ("", *data.draw(st.sampled_from(places(document[""]))))
    holder: Any = document
    for key in way:
        holder = holder[key]
    holder[last] = data.draw(JSON)
    try:
        path.write_text(json.dumps(document[""]))
        found = READERS[name](drive)
    except ValueError as error:
        assert str(error).startswith(f"{path}: ")
        return
    finally:
        path.write_text(before)
    for thing in found[1] if name == "objects.json" else ():
        assert isinstance(thing, ListedObject) and abs(thing.number) < 1 << 31
        assert thing.thumbnail is None or thing.thumbnail.is_relative_to(drive.workspace)
