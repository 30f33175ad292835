"""What moves is found, with ids, boxes or neither; what stands is not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.moving_street import AHEAD, FRAMES, MOVER_ID, ONCOMING, PARKED_ID, WALKER, Street, make_moving_street
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Drive
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.movers.find import FoundMovers, find_movers
from unveil_core.semantics.labels import choose_labels

STREETS = {"oncoming": ONCOMING, "ahead": AHEAD, "walker": WALKER}


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Drive]:
    """The three streets, with ids and boxes."""
    root = tmp_path_factory.mktemp("movers")
    made = {}
    for name, street in STREETS.items():
        path = make_moving_street(root / name, street, instances=True, boxes=True)
        made[name] = replace(import_drive(open_drive(path), root / name / "drive"), root=path.parent)
    return made


def without(drive: Drive, *, ids: bool = False, boxes: bool = False) -> Drive:
    frames = [
        replace(f, instance_path=f.instance_path if ids else None, boxes=f.boxes if boxes else ()) for f in drive.frames
    ]
    return replace(drive, frames=tuple(frames))


def shown(drive: Drive, number: int) -> list[np.ndarray]:
    """(H, W) per frame, true pixels of an id."""
    paths = [drive.root / f"instances/{i:02d}.png" for i in range(FRAMES)]
    return [cv2.imread(str(p), cv2.IMREAD_UNCHANGED) == number for p in paths]


def found_in(drive: Drive) -> FoundMovers:
    found = find_movers(drive, choose_labels(drive))
    assert found is not None
    return found


@pytest.fixture(scope="module")
def found(drives: dict[str, Drive]) -> Callable[[str, str], FoundMovers]:
    """What moves on a street of which neither ids nor boxes are known, or ids, or boxes; looked for once."""
    return cache(lambda name, kind: found_in(without(drives[name], ids=kind == "ids", boxes=kind == "boxes")))


def share(found: list[np.ndarray], wanted: list[np.ndarray]) -> float:
    """Of the wanted pixels that are found."""
    hit = sum(int((f & w).sum()) for f, w in zip(found, wanted, strict=True))
    return hit / sum(int(w.sum()) for w in wanted)


@pytest.mark.parametrize("name", STREETS)
@pytest.mark.parametrize("kind", ["neither", "ids", "boxes"])
def test_the_mover_is_found_and_the_parked_car_is_not(
    drives: dict[str, Drive], found: Callable[[str, str], FoundMovers], name: str, kind: str
) -> None:
    movers = found(name, kind)
    assert [m.class_name for m in movers.movers] == ["person" if name == "walker" else "car"]
    mover = movers.movers[0]
    assert mover.source == (0 if kind == "neither" else MOVER_ID) and (mover.evidence == "boxes") == (kind == "boxes")
    pixels = [n > 0 for n in movers.numbers]
    assert [f.name for f, p in zip(drives[name].frames, pixels, strict=True) if p.any()] == [n for _, n in mover.frames]
    assert share(pixels, shown(drives[name], MOVER_ID)) > (0.85 if kind == "neither" else 0.99)
    assert share(pixels, shown(drives[name], PARKED_ID)) < 0.005


@pytest.mark.parametrize(("name", "least"), [("oncoming", 0.8), ("ahead", 0.8), ("walker", 0.5)])
def test_points_on_the_mover_are_known(
    drives: dict[str, Drive], found: Callable[[str, str], FoundMovers], name: str, least: float
) -> None:
    on_mover = np.load(drives[name].root / "on_mover.npy")
    for kind in ("neither", "ids"):
        known = found(name, kind).on_mover
        assert known[on_mover].mean() > least
        assert known[~on_mover].mean() < 0.001
    boxed = found(name, "boxes").on_mover
    # What a point less than 0.15 m over the ground belongs to, a box cannot say.
    assert boxed[on_mover].mean() > 0.85 and boxed[~on_mover].mean() < 0.001


def test_a_mover_s_shadow_is_its_own(drives: dict[str, Drive], found: Callable[[str, str], FoundMovers]) -> None:
    drive = drives["oncoming"]
    shadows = found("oncoming", "neither").shadows
    darkened = []
    for i, frame in enumerate(drive.frames):
        image = cv2.imread(str(frame.image_path)).astype(float).mean(axis=2)
        empty = cv2.imread(str(drive.root / f"truth/images/{i:02d}.png")).astype(float).mean(axis=2)
        darkened.append((image < 0.75 * empty) & ~shown(drive, MOVER_ID)[i] & ~shown(drive, PARKED_ID)[i])
    # From the second frame on others show the place lit. The parked car's shadow is dark in all frames and stays.
    columns = np.arange(darkened[0].shape[1]) < 88
    own = [d & columns for d in darkened]
    assert share(list(shadows[1:9]), own[1:9]) > 0.9
    lit = [~cv2.dilate(d.astype(np.uint8), np.ones((7, 7), np.uint8)).astype(bool) for d in darkened]
    wrong = sum(int((s & k).sum()) for s, k in zip(shadows, lit, strict=True))
    assert wrong < 0.05 * sum(int(s.sum()) for s in shadows)


def test_where_everything_stands_nothing_is_found(tmp_path: Path) -> None:
    still = Street((9.0, 2.3, 0.0), (13.0, 4.0, 1.4), (0.0, 0.0, 0.0))
    path = make_moving_street(tmp_path / "still", still, instances=True, boxes=True)
    drive = import_drive(open_drive(path), tmp_path / "drive")
    for ids, boxes in ((False, False), (True, False), (False, True)):
        variant = without(drive, ids=ids, boxes=boxes)
        assert find_movers(variant, choose_labels(variant)) is None


def test_with_masks_only_tracks_decide_and_nothing_else_is_called_moving(
    drives: dict[str, Drive], tmp_path: Path
) -> None:
    drive = drives["oncoming"]
    frames = []
    for i, frame in enumerate(drive.frames):
        gone = shown(drive, MOVER_ID)[i] | shown(drive, PARKED_ID)[i]
        cv2.imwrite(str(tmp_path / f"{i:02d}.png"), np.where(gone, 0, 255).astype(np.uint8))
        frames.append(replace(frame, semantic_path=None, mask_path=tmp_path / f"{i:02d}.png"))
    masked = replace(drive, frames=tuple(frames))
    found = found_in(without(masked, boxes=True))
    assert [(m.class_name, m.evidence) for m in found.movers] == [("car", "boxes")]
    assert share([n > 0 for n in found.numbers], shown(drive, MOVER_ID)) > 0.99
    assert share([n > 0 for n in found.numbers], shown(drive, PARKED_ID)) < 0.005
    assert find_movers(without(masked), choose_labels(masked)) is None, "masks alone prove nothing here"


def test_a_box_of_an_unknown_class_is_an_error(drives: dict[str, Drive]) -> None:
    drive = without(drives["oncoming"], boxes=True)
    first = drive.frames[0]
    strange = replace(first, boxes=(replace(first.boxes[0], class_name="zeppelin"),))
    with pytest.raises(DriveError, match="box 5 of frame 00 has the unknown class 'zeppelin'"):
        find_movers(replace(drive, frames=(strange, *drive.frames[1:])), choose_labels(drive))


def test_two_cameras_in_turn_find_what_one_found(
    drives: dict[str, Drive], found: Callable[[str, str], FoundMovers], tmp_path: Path
) -> None:
    """Every second frame by a darker camera, listed after those of the other: neither order nor colour is in the way."""
    alone = drives["oncoming"]
    frames = []
    for i, frame in enumerate(alone.frames):
        if i % 2:
            dark = (0.6 * cv2.imread(str(frame.image_path)).astype(float)).round().astype(np.uint8)
            cv2.imwrite(str(tmp_path / f"{i:02d}.png"), dark)
            frame = replace(frame, camera_name="dark", image_path=tmp_path / f"{i:02d}.png")
        frames.append(frame)
    places = [*range(0, FRAMES, 2), *range(1, FRAMES, 2)]
    rig = replace(alone, frames=tuple(frames[i] for i in places))
    movers, wanted = found_in(without(rig, ids=True)), found("oncoming", "ids")
    assert [m.source for m in movers.movers] == [MOVER_ID]
    on_mover = np.load(alone.root / "on_mover.npy")
    assert movers.on_mover[on_mover].mean() > 0.8 and movers.on_mover[~on_mover].mean() < 0.001
    shadows = [movers.shadows[places.index(i)] for i in range(FRAMES)]
    assert share(shadows[1:9], list(wanted.shadows[1:9])) > 0.9
    assert sum(int(s.sum()) for s in shadows) < 1.2 * sum(int(s.sum()) for s in wanted.shadows)
