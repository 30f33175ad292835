"""transforms.json of strangers: what is honest opens, what is not is one line that names the file; never anything else."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.drives.tiny_drive import edit, make_tiny_drive
from unveil_core.base.errors import UnveilError
from unveil_core.base.pictures.decoding import read_image
from unveil_core.drives import open_drive
from unveil_core.drives.importing.check import check_drive
from unveil_core.drives.importing.whole_drive import import_drive

Change = Callable[[dict[str, Any]], object]


def angle(value: object) -> Change:
    def change(d: dict[str, Any]) -> None:
        for key in ("fl_x", "fl_y"):
            d.pop(key)
        d["camera_angle_x"] = value

    return change


STRANGE: dict[str, Change] = {
    "an opening angle of 0": angle(0),
    "a width in words": lambda d: d.update(w="abc"),
    "an infinite width": lambda d: d.update(w=float("inf")),
    "a width of 0": lambda d: d.update(w=0),
    "a width beyond any memory": lambda d: d.update(w=10**9, h=10**9),
    "a focal length of 0": lambda d: d.update(fl_x=0),
    "a focal length that is no number": lambda d: d.update(fl_y=float("nan")),
    "a focal length beyond all": lambda d: d["frames"][1].update(fl_x=float("inf")),
    "a principal point that is no number": lambda d: d.update(cx=float("nan")),
    "a distortion that is no number": lambda d: d.update(k1=float("nan"), camera_model="OPENCV"),
    "an infinite distortion": lambda d: d.update(k2=float("inf"), camera_model="OPENCV"),
    "a scale that is no number": lambda d: d.update(applied_scale=float("nan")),
    "a pose that is infinite": lambda d: d["frames"][2]["transform_matrix"][1].__setitem__(3, float("inf")),
    "a pose of zeros": lambda d: d["frames"][2].update(transform_matrix=[[0] * 4] * 4),
    "a time in words": lambda d: d["frames"][0].update(timestamp="x"),
    "a time that is no number": lambda d: d["frames"][0].update(timestamp=float("nan")),
    "frames that are a number": lambda d: d.update(frames=5),
    "frames that are numbers": lambda d: d.update(frames=[1, 2]),
    "an applied_transform of two numbers": lambda d: d.update(applied_transform=[1, 2]),
    "a NUL in a file's name": lambda d: d["frames"][0].update(file_path="images/\0.png"),
    "a file's name of a list": lambda d: d["frames"][0].update(file_path=["a"]),
    "a pose of words": lambda d: d["frames"][0].update(transform_matrix="identity"),
    "a ragged pose": lambda d: d["frames"][0].update(transform_matrix=[[1], [1, 2], 3, {}]),
    "boxes that are words": lambda d: d["frames"][0].update(boxes="two"),
    "points that are a folder": lambda d: d.update(ply_file_path="."),
    "points with a NUL": lambda d: d.update(ply_file_path="a\0b"),
}


@pytest.mark.parametrize("name", STRANGE)
def test_a_strange_value_is_one_line(tmp_path: Path, name: str) -> None:
    path = make_tiny_drive(tmp_path)
    edit(path, STRANGE[name])
    with pytest.raises(UnveilError) as caught:
        check_drive(open_drive(path))
        import_drive(open_drive(path), tmp_path / "ws/drive")
    assert "\n" not in str(caught.value)


TEXTS = {
    "nested 200,000 deep": b"[" * 200_000,
    "an integer of 5,000 digits": b'{"frames": ' + b"9" * 5000 + b"}",
    "no UTF-8": b'{"frames": "\xff\xfe"}',
    "nothing": b"",
    "a lone surrogate": b'{"frames": [{"file_path": "\\ud800.png"}]}',
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_strange_text_is_one_line(tmp_path: Path, name: str) -> None:
    path = make_tiny_drive(tmp_path)
    path.write_bytes(TEXTS[name])
    with pytest.raises(UnveilError, match=r"transforms\.json|ud800"):
        check_drive(open_drive(path))


def test_a_picture_that_claims_gigabytes_is_never_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_tiny_drive(tmp_path)
    picture = np.zeros((4096, 4096), np.uint8)
    (tmp_path / "images/01.png").write_bytes(cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_BILEVEL, 1])[1])
    sizes = []
    decode = cv2.imdecode

    def watched(content: Any, flags: int) -> Any:
        sizes.append((found := decode(content, flags)).shape[:2])
        return found

    monkeypatch.setattr(cv2, "imdecode", watched)
    with pytest.raises(
        UnveilError, match=r"01\.png: Not the size of its camera: 4096x4096 pixels, the camera says 32x24"
    ):
        check_drive(open_drive(path))
    assert set(sizes) == {(24, 32)}


def leaves() -> st.SearchStrategy[Any]:
    return (
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.just("../x") | st.just("é\0")
    )


def anything() -> st.SearchStrategy[Any]:
    return st.recursive(
        leaves(), lambda v: st.lists(v, max_size=3) | st.dictionaries(st.text(max_size=5), v, max_size=3), max_leaves=6
    )


PLACES = (
    *[
        (key,)
        for key in ("w", "h", "fl_x", "fl_y", "cx", "cy", "k1", "k4", "camera_model", "ply_file_path", "frames", "up")
    ],
    *[
        (key,)
        for key in ("applied_transform", "applied_scale", "metric", "semantic_classes", "camera_angle_x", "is_fisheye")
    ],
    *[
        ("frames", 1, key)
        for key in ("file_path", "transform_matrix", "timestamp", "camera", "camera_id", "boxes", "w")
    ],
    *[("frames", 1, key) for key in ("semantic_path", "instance_path", "mask_path", "depth_file_path")],
    ("frames", 1),
    ("frames", 1, "transform_matrix", 2),
    ("frames", 1, "transform_matrix", 2, 3),
)


@settings(max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.sampled_from(PLACES), value=anything())
def test_any_value_anywhere_opens_or_is_one_line(
    tmp_path_factory: pytest.TempPathFactory, place: tuple[Any, ...], value: Any
) -> None:
    folder = tmp_path_factory.getbasetemp() / "any_value"
    if not (folder / "whole.json").is_file():
        make_tiny_drive(folder).rename(folder / "whole.json")
    document = json.loads((folder / "whole.json").read_text())
    inner = document
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    (folder / "transforms.json").write_text(json.dumps(document))
    try:
        check_drive(open_drive(folder))
    except UnveilError as error:
        assert "\n" not in str(error)


def test_linked_photographs_are_imported_as_what_they_link_to(tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path / "d")
    (tmp_path / "disk").mkdir()
    for image in (tmp_path / "d/images").iterdir():
        image.rename(tmp_path / "disk" / image.name)
        image.symlink_to(os.path.relpath(tmp_path / "disk" / image.name, image.parent))
    local = import_drive(open_drive(path), tmp_path / "ws/drive")
    for frame, own in zip(open_drive(path).frames, local.frames, strict=True):
        assert not own.image_path.is_symlink()
        assert np.array_equal(read_image(frame.image_path), read_image(own.image_path))


def test_a_mark_of_windows_before_the_text_does_not_matter(tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path)
    edit(path, lambda d: d.update(note="Straße"))
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert len(open_drive(path).frames) == 4


def test_what_a_phone_appends_does_not_matter(tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path)
    image = tmp_path / "images/01.png"
    image.write_bytes(image.read_bytes() + b"\0" * 3 + b"a maker's note" * 100)
    check_drive(open_drive(path))


PLACES_OF_FILES = ("file_path", "semantic_path", "instance_path", "mask_path", "depth_file_path", "ply_file_path")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
@pytest.mark.parametrize("key", PLACES_OF_FILES)
def test_a_pipe_is_not_waited_for_and_a_device_not_read_to_its_end(tmp_path: Path, key: str) -> None:
    path = make_tiny_drive(tmp_path)
    os.mkfifo(tmp_path / "pipe.png")
    for name in (str(tmp_path / "pipe.png"), "/dev/zero"):
        edit(path, lambda d, name=name: (d if key == "ply_file_path" else d["frames"][1]).update({key: name}))  # type: ignore[misc]
        if key == "depth_file_path":  # which is read where there are no points
            edit(path, lambda d: d.pop("ply_file_path", None))
        with pytest.raises(UnveilError, match=r"pipe or a device|Not found|no points") as caught:
            check_drive(open_drive(path))
            import_drive(open_drive(path), tmp_path / "ws/drive")
        assert "\n" not in str(caught.value)


def test_one_photograph_by_its_whole_path_does_not_matter(tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path / "d")
    first = sorted((tmp_path / "d/images").iterdir())[0]
    edit(path, lambda d: d["frames"][0].update(file_path=str(first)))
    assert len(open_drive(path).frames) == 4
    check_drive(open_drive(path))
