"""Frames of files that list them anyhow come in the order of travel."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from tests.drives.captures import (
    STEP_M,
    frame,
    frames,
    way,
    write_model,
    write_pictures,
    write_transforms,
)
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Drive
from unveil_core.drives.travel.way import along_the_way, way_of

COUNT = 12
SHUFFLED = random.Random(5).sample(range(COUNT), COUNT)
TRUE_M = STEP_M * (COUNT - 1)


def names(pattern: str) -> list[str]:
    """Of pictures in the order of travel."""
    sensitivities, hashes = (100, 400, 200), random.Random(2)
    return [
        "images/"
        + pattern.format(
            i=i, back=20 - i, signed=i - 6, s=0.05 * i, iso=sensitivities[i % 3], hash=hashes.getrandbits(40)
        )
        + ".png"
        for i in range(COUNT)
    ]


def is_true_way(drive: Drive) -> bool:
    return list(way(drive).values()) == pytest.approx([TRUE_M], rel=1e-3)


@pytest.mark.parametrize(
    ("pattern", "told"),
    [
        ("{i:04d}", "in the order of their names"),
        ("frame{i}", "in the order of the numbers in their names"),
        ("cam2_take3_f{i}_iso{iso}", "in the order of the numbers in their names"),
        ("seed{hash}_f{i}", "in the order of the second number in their names"),
        ("f{signed}", "in the order of the signed numbers in their names"),
        ("{s:g}", "in the order of the decimal numbers in their names"),
        ("{hash:010x}", "as they lie along the way"),
    ],
)
def test_a_scrambled_file_is_put_in_order_and_told(pattern: str, told: str, tmp_path: Path) -> None:
    drive = open_drive(write_transforms(tmp_path, frames(names(pattern), SHUFFLED)))
    assert is_true_way(drive)
    assert len(drive.notices) == 1 and told in drive.notices[0] and drive.notices[0].endswith("timestamp decides")
    ahead = drive.frames[-1].camera.centre - drive.frames[0].camera.centre
    assert float(ahead @ drive.frames[0].camera.forward) > 0


@pytest.mark.parametrize("pattern", ["{i:04d}", "frame{i}", "{back}", "{hash:010x}"])
def test_a_file_in_the_order_of_travel_stays_so_whatever_its_names_are(pattern: str, tmp_path: Path) -> None:
    own = names(pattern)
    drive = open_drive(write_transforms(tmp_path, frames(own)))
    assert [f"images/{f.name}.png" for f in drive.frames] == own and drive.notices == ()


def test_a_file_that_runs_backwards_stays_so(tmp_path: Path) -> None:
    drive = open_drive(write_transforms(tmp_path, frames(names("{i:04d}"), range(COUNT)[::-1])))
    assert drive.frames[0].name == "0011" and is_true_way(drive) and drive.notices == ()


def test_names_in_the_order_of_texts_are_told(tmp_path: Path) -> None:
    """As ``frame1, frame10, frame11, frame12, frame2`` stand in a file."""
    own = names("frame{i}")
    drive = open_drive(write_transforms(tmp_path, frames(own, sorted(range(COUNT), key=lambda i: own[i]))))
    assert is_true_way(drive) and "the numbers in their names: in that of the file the way is" in drive.notices[0]


def test_there_and_back_is_a_way(tmp_path: Path) -> None:
    entries = [frame(f"images/{i:03d}.png", STEP_M * min(i, 20 - i)) for i in range(20)]
    drive = open_drive(write_transforms(tmp_path, entries))
    assert [f.name for f in drive.frames] == [f"{i:03d}" for i in range(20)] and drive.notices == ()


def test_time_stamps_rule(tmp_path: Path) -> None:
    own = names("{hash:010x}")
    drive = open_drive(write_transforms(tmp_path, frames(own, SHUFFLED, timestamp=[0.1 * i for i in range(COUNT)])))
    assert is_true_way(drive) and "frames are taken by time" in drive.notices[0]


def test_time_stamps_that_contradict_the_way_are_not_used(tmp_path: Path) -> None:
    stamps = [float(i) for i in SHUFFLED]
    drive = open_drive(write_transforms(tmp_path, frames(names("{i:04d}"), timestamp=stamps)))
    assert is_true_way(drive) and {f.timestamp for f in drive.frames} == {None}
    assert "time stamps do not follow the way and are not used" in drive.notices[0]


def test_one_time_stamp_for_all_is_none(tmp_path: Path) -> None:
    drive = open_drive(write_transforms(tmp_path, frames(names("{i:04d}"), SHUFFLED, timestamp=[7.0] * COUNT)))
    assert is_true_way(drive) and {f.timestamp for f in drive.frames} == {None}
    assert "all frames have one time stamp" in drive.notices[0]


def test_time_stamps_of_some_frames_do_not_order_them(tmp_path: Path) -> None:
    stamps = [float(i) if i > 3 else None for i in range(COUNT)]
    drive = open_drive(write_transforms(tmp_path, frames(names("{i:04d}"), SHUFFLED, timestamp=stamps)))
    assert is_true_way(drive) and "only 8 of 12 frames have a time stamp" in drive.notices[0]


def test_a_camera_that_stands_has_no_way(tmp_path: Path) -> None:
    generator = random.Random(1)
    entries = [frame(f"images/{i:03d}.png", generator.gauss(0, 0.02)) for i in range(COUNT)]
    assert open_drive(write_transforms(tmp_path, entries)).notices == ()


def test_frames_that_make_no_way_are_told(tmp_path: Path) -> None:
    """Photographs of a square from everywhere."""
    generator = random.Random(1)
    entries = [frame(f"images/{i:03d}.png", generator.uniform(0, 30)) for i in range(40)]
    for entry in entries:
        entry["transform_matrix"][1][3] += generator.uniform(-20, 20)
    notices = open_drive(write_transforms(tmp_path, entries)).notices
    assert (
        len(notices) == 1 and "no order of the frames makes a way" in notices[0] and "timestamp decides" in notices[0]
    )


@pytest.mark.parametrize(("pattern", "told"), [("frame{i}", "by the numbers in their names"), ("{i:04d}", None)])
def test_colmap_names_count_as_numbers(pattern: str, told: str | None, tmp_path: Path) -> None:
    own = [n.removeprefix("images/") for n in names(pattern)]
    write_pictures(tmp_path / "images", own)
    write_model(tmp_path / "sparse/0", [(own[i], STEP_M * i) for i in SHUFFLED])
    drive = open_drive(tmp_path)
    assert is_true_way(drive) and [f"{f.name}.png" for f in drive.frames] == own
    assert len(drive.notices) == (told is not None) and (told is None or told in drive.notices[0])


def test_three_frames_of_colmap_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    own = ["f10.png", "f9.png", "f100.png"]
    write_pictures(tmp_path / "images", own)
    write_model(tmp_path / "sparse/0", [(n, STEP_M * k) for k, n in enumerate(own)])
    assert [f.name for f in open_drive(tmp_path).frames] == ["f9", "f10", "f100"]


def test_colmap_names_that_mean_nothing_leave_the_order_of_the_model(tmp_path: Path) -> None:
    own = [n.removeprefix("images/") for n in names("{hash:010x}")]
    write_pictures(tmp_path / "images", own)
    write_model(tmp_path / "sparse/0", [(n, STEP_M * i) for i, n in enumerate(own)])
    drive = open_drive(tmp_path)
    assert [f"{f.name}.png" for f in drive.frames] == own and "in the order of the file" in drive.notices[0]


def test_parts_of_one_sequence_in_two_folders_are_one_sequence(tmp_path: Path) -> None:
    """As sets to train and to test are split."""
    entries = [frame(f"{'test' if i % 3 == 1 else 'train'}/r_{i}.png", STEP_M * i) for i in range(COUNT)]
    drive = open_drive(write_transforms(tmp_path, sorted(entries, key=lambda e: e["file_path"])))
    assert is_true_way(drive) and [f.name for f in drive.frames] == [f"r_{i}" for i in range(COUNT)]


def test_the_way_of_places() -> None:
    straight = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0.0]])
    found = way_of(straight)
    assert (found.length, found.extent, found.turning_back, found.zigzags) == (3, 3, 0, False)
    found = way_of(straight[[0, 3, 1, 2, 0, 3]])
    assert found.zigzags and (found.length, found.turning_back) == (11, 1.0)


def test_places_along_a_bend_are_found_in_their_order() -> None:
    turn = np.linspace(0, np.pi, 60)
    places = np.stack([30 * np.sin(turn), 30 * np.cos(turn), np.zeros(60)], axis=1)
    ahead = np.stack([np.cos(turn), -np.sin(turn), np.zeros(60)], axis=1)
    mixed = np.random.default_rng(0).permutation(60)
    found = along_the_way(places[mixed], ahead[mixed])
    assert found is not None and mixed[found].tolist() == list(range(60))
