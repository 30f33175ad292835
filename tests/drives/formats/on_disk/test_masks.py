"""Masks that lie beside the photographs are found under the names that tools give them, or told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.drives.captures import (
    SIZE,
    STEP_M,
    frame,
    frames,
    write_model,
    write_picture,
    write_pictures,
    write_transforms,
)
from unveil_core.base.pictures.decoding import read_label_image
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Drive
from unveil_core.drives.importing.check import check_drive
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.semantics.labels import choose_labels

NAMES = [f"{i:03d}.png" for i in range(8)]
STEMS = [n[:3] for n in NAMES]


def colmap(root: Path, names: list[str] = NAMES) -> Path:
    write_pictures(root / "images", names)
    write_model(root / "sparse/0", [(n, STEP_M * i) for i, n in enumerate(names)])
    return root


def capture(root: Path, **keys: Any) -> Path:
    return write_transforms(root, frames([f"images/{n}" for n in NAMES], **keys))


def masks_of(drive: Drive) -> list[str | None]:
    return [None if f.mask_path is None else f.mask_path.name for f in drive.frames]


@pytest.mark.parametrize(
    ("masks", "told"),
    [
        ([f"{n}.png" for n in NAMES], None),
        (NAMES, None),
        ([f"{s}.jpg" for s in STEMS], "8 of 8 photographs have a mask in masks/, found by name"),
        ([f"{s}.{'jpg' if k % 2 else 'png'}" for k, s in enumerate(STEMS)], "8 of 8 photographs have a mask in masks/"),
        ([f"{n}.JPG" for n in NAMES], "found by name"),
        ([f"{s}_mask.png" for s in STEMS], "found by name"),
        ([f"mask_{s}.png" for s in STEMS], "found by name"),
        ([f"{s}.mask.png" for s in STEMS], "found by name"),
        ([f"sam_{int(s)}.png" for s in STEMS], "found by the number in its name"),
    ],
)  # fmt: skip
def test_colmap_s_masks_are_found(masks: list[str], told: str | None, tmp_path: Path) -> None:
    colmap(tmp_path)
    write_pictures(tmp_path / "masks", masks)
    drive = open_drive(tmp_path)
    assert masks_of(drive) == masks
    assert len(drive.notices) == (told is not None) and (told is None or told in drive.notices[0])
    assert told is None or drive.notices[0].endswith("black = remove; a transforms.json with mask_path decides")


def test_masks_of_no_photograph_are_counted(tmp_path: Path) -> None:
    colmap(tmp_path)
    write_pictures(tmp_path / "masks", [*NAMES[:3], "zebra.png"])
    drive = open_drive(tmp_path)
    assert masks_of(drive) == [*NAMES[:3], *[None] * 5]
    assert drive.notices == ("masks/: 1 of 4 masks belong to no photograph, the first zebra.png",)


def test_masks_that_are_named_like_no_photograph_are_told(tmp_path: Path) -> None:
    colmap(tmp_path)
    write_pictures(tmp_path / "masks", ["a.png", "b.png"])
    drive = open_drive(tmp_path)
    assert masks_of(drive) == [None] * 8
    assert drive.notices[0].startswith(
        "masks/ holds 2 pictures, none of them named like a photograph: they are not read"
    )


def test_masks_of_a_rig_lie_in_folders_or_not(tmp_path: Path) -> None:
    names = [f"{c}/{n}" for c in ("left", "right") for n in NAMES]
    poses = [
        frame("", STEP_M * i, mount={"offset": (o, 0.0, 0.0)})["transform_matrix"]
        for o in (-0.3, 0.3)
        for i in range(8)
    ]
    write_pictures(tmp_path / "images", names)
    write_model(tmp_path / "sparse/0", list(zip(names, map(np.array, poses), strict=True)))
    write_pictures(tmp_path / "masks", [n.replace(".png", ".jpg") for n in names])
    drive = open_drive(tmp_path)
    assert [f.mask_path for f in drive.frames] == [tmp_path / "masks" / n.replace(".png", ".jpg") for n in names]
    for path in (tmp_path / "masks").rglob("*.jpg"):
        path.unlink()
    write_pictures(tmp_path / "masks", [n.replace(".png", ".jpg") for n in NAMES])
    assert set(masks_of(open_drive(tmp_path))) == {None}  # of two photographs each: nothing tells of which


@pytest.mark.parametrize("folder", ["masks", "mask"])
def test_masks_beside_a_transforms_json_that_names_none_are_taken_and_told(folder: str, tmp_path: Path) -> None:
    path = capture(tmp_path)
    write_pictures(tmp_path / folder, NAMES)
    drive = open_drive(path)
    assert masks_of(drive) == NAMES and {f.codes.mask.removes for f in drive.frames} == {"black"}
    assert drive.notices == (
        f"8 of 8 photographs have a mask in {folder}/, found by name: black = remove; mask_path decides",
    )


@pytest.mark.parametrize(
    "keys", [{"mask_path": [f"own/{n}" for n in NAMES]}, {"semantic_path": [f"own/{n}" for n in NAMES]}]
)
def test_what_the_file_names_is_not_replaced_but_the_rest_is_told(keys: dict[str, list[str]], tmp_path: Path) -> None:
    path = capture(tmp_path, **keys)
    for name in NAMES:
        write_picture(tmp_path / "own" / name, 1)
    write_pictures(tmp_path / "masks", NAMES)
    drive = open_drive(path)
    assert {f.mask_path.parent.name for f in drive.frames if f.mask_path is not None} <= {"own"}
    assert drive.notices == ("masks/ holds 8 pictures that no frame names: they are not read; mask_path names one",)


def test_folders_that_no_frame_names_are_told_with_their_key(tmp_path: Path) -> None:
    path = capture(tmp_path)
    write_pictures(tmp_path / "semantics", NAMES)
    write_pictures(tmp_path / "depth", NAMES[:3])
    assert open_drive(path).notices == (
        "semantics/ holds 8 pictures that no frame names: they are not read; semantic_path names one",
        "depth/ holds 3 pictures that no frame names: they are not read; depth_file_path names one",
    )


@pytest.mark.parametrize("pattern", ["{}_mask.png", "mask_{}.jpg", "{}.mask.png"])
def test_masks_among_the_photographs_are_taken_and_told(pattern: str, tmp_path: Path) -> None:
    path = capture(tmp_path)
    masks = [pattern.format(s) for s in STEMS]
    write_pictures(tmp_path / "images", masks)
    drive = open_drive(path)
    assert masks_of(drive) == masks and drive.notices == (
        f"8 masks beside the photographs, as {masks[0]}, are taken: black = remove; mask_path decides",
    )


def test_masks_of_a_rig_beside_a_transforms_json_lie_as_its_photographs(tmp_path: Path) -> None:
    names = [f"images/{c}/{n}" for c in ("left", "right") for n in NAMES]
    entries = [frame(n, STEP_M * (i % 8), mount={"offset": (0.6 * (i // 8), 0.0, 0.0)}) for i, n in enumerate(names)]
    path = write_transforms(tmp_path, entries)
    (tmp_path / "masks").mkdir()
    write_pictures(tmp_path / "mask", [n.removeprefix("images/") for n in names])
    drive = open_drive(path)
    assert [f.mask_path for f in drive.frames] == [tmp_path / n.replace("images", "mask") for n in names]


def test_some_masks_that_no_frame_names_are_told(tmp_path: Path) -> None:
    path = capture(tmp_path, mask_path=[f"masks/{n}" if i < 3 else None for i, n in enumerate(NAMES)])
    write_pictures(tmp_path / "masks", NAMES)
    assert open_drive(path).notices == (
        "masks/ holds 8 pictures, frames name 3 of them: 5 are not read, the first 003.png; mask_path names one",
    )


@pytest.mark.parametrize("folder", ["masks", "images_masks"])
def test_masks_that_are_no_pictures_are_told(folder: str, tmp_path: Path) -> None:
    colmap(tmp_path)
    (tmp_path / folder).mkdir()
    np.savez(tmp_path / folder / "000.npz", np.zeros(3))
    assert open_drive(tmp_path).notices == (
        f"{folder}/ holds 1 files that are not read as masks, the first 000.npz: masks are pictures",
    )


@pytest.mark.parametrize("folder", ["masks", "images"])
def test_masks_that_nobody_named_and_that_do_not_fit_are_told_and_not_taken(folder: str, tmp_path: Path) -> None:
    path = capture(tmp_path)
    for stem in STEMS:
        write_picture(tmp_path / folder / f"{stem}_mask.png", size=(8, 6))
    drive = open_drive(path)
    assert masks_of(drive) == [None] * 8
    check_drive(drive)
    assert "are not read: 000_mask.png is 8x6 pixels, its photograph 16x12" in drive.notices[0]
    for stem in STEMS:
        cv2.imwrite(str(tmp_path / folder / f"{stem}_mask.png"), np.zeros((12, 16), np.uint16))
    drive = open_drive(path)
    assert masks_of(drive) == [None] * 8 and "uint16 pixels" in drive.notices[0]


def half(path: Path) -> None:
    """A mask whose left half is white."""
    mask = np.zeros(SIZE[::-1], np.uint8)
    mask[:, : SIZE[0] // 2] = 255
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), mask)


def test_white_is_removed_by_instant_ngp_s_masks_and_black_by_all_others(tmp_path: Path) -> None:
    path = capture(tmp_path / "ngp")
    other = capture(tmp_path / "other")
    for stem in STEMS:
        half(tmp_path / f"ngp/images/dynamic_mask_{stem}.png")
        half(tmp_path / f"other/masks/{stem}.png")
    drive = open_drive(path)
    assert masks_of(drive) == [f"dynamic_mask_{n}" for n in NAMES]
    assert drive.notices[0] == (
        "8 masks beside the photographs (dynamic_mask_*) are taken: white = remove, as Instant-NGP has it; mask_path decides"
    )
    assert choose_labels(drive).pixel_counts == (8 * SIZE[0] * SIZE[1] // 2,) * 2
    for opened, black in ((drive, True), (open_drive(other), False)):
        imported = import_drive(opened, tmp_path / f"{black}/drive")
        mask = read_label_image(imported.frames[0].mask_path)  # type: ignore[arg-type]
        assert (
            imported.frames[0].codes.mask.removes == "black"
            and (mask[:, 0] == 0).all() == black
            and (mask[:, -1] == 0).all() != black
        )
        assert choose_labels(imported).pixel_counts == (8 * SIZE[0] * SIZE[1] // 2,) * 2
