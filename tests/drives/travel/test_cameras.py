"""Cameras that nothing names are found by how their pictures move, and told as the guess that it is."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from tests.drives.captures import FOCAL, STEP_M, frame, pose, way, write_model, write_pictures, write_transforms
from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import SettingsError
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Drive, instants

COUNT = 12
LEFT, RIGHT = {"offset": (-0.27, 0.0, 0.0)}, {"offset": (0.27, 0.0, 0.0)}
BACK = {"offset": (0.0, 0.0, -1.0), "yaw_deg": 180.0}
STEREO = (("left", LEFT), ("right", RIGHT))
Entries = list[dict[str, Any]]


def rig(pattern: str, cameras: Any = STEREO, **keys: Any) -> Entries:
    """A rig's frames in turns; ``{c}`` is a camera's name, ``{k}`` its number, ``{i}`` the moment, ``{n}`` counts all."""
    found = []
    for i in range(COUNT):
        for k, (c, mount) in enumerate(cameras):
            name = pattern.format(c=c, k=k, i=i, n=len(cameras) * i + k, part=100 + i // 6)
            found.append(
                frame(f"images/{name}.png", STEP_M * i, mount=mount, **{key: f(i, k) for key, f in keys.items()})
            )
    return found


def single(pattern: str, **keys: Any) -> Entries:
    """One camera's frames."""
    return [
        frame(
            f"images/{pattern.format(i=i, part=100 + i // 6, inner=i % 6)}.png",
            STEP_M * i,
            **{k: f(i) for k, f in keys.items()},
        )
        for i in range(COUNT)
    ]


def cameras_of(drive: Drive) -> dict[str, int]:
    names = [f.camera_name for f in drive.frames]
    return {name: names.count(name) for name in dict.fromkeys(names)}


def opened(folder: Path, entries: Entries) -> Drive:
    return open_drive(write_transforms(folder, entries))


RIGS = {
    "folders": (rig("{c}/{i:03d}"), ["left", "right"], "their folders"),
    "folders, one after the other": (
        sorted(rig("{c}/{i:03d}"), key=lambda e: e["file_path"]),
        ["left", "right"],
        "their folders",
    ),
    "folders with numbers of their own": (rig("cam{k}/{k}{i:03d}"), ["cam0", "cam1"], "their folders"),
    "folders of moments": (rig("{i:03d}/{c}"), ["left", "right"], "the names"),
    "several folders a camera": (rig("{c}/{part}MEDIA/P_{i:04d}"), ["left", "right"], "their folders"),
    "words in names": (rig("{c}_{i:03d}"), ["left", "right"], "the names"),
    "words of which one has no other": (
        rig("front_{c}_{i:03d}", (("camera", LEFT), ("left_camera", RIGHT))),
        ["front_camera", "front_left_camera"],
        "the names",
    ),
    "words at the end": (rig("{i:03d}_{c}", (*STEREO, ("back", BACK))), ["left", "right", "back"], "the names"),
    "numbers in names": (rig("{i:03d}_{k}"), ["camera_0", "camera_1"], "the names"),
    "lenses": (rig("{n:03d}", fl_x=lambda i, k: FOCAL + 0.1 * k), ["camera_1", "camera_2"], "their lenses"),
    "turns": (rig("{n:03d}"), ["camera_1", "camera_2"], "turns"),
    "turns of front and back": (rig("{n:03d}", (("f", {}), ("b", BACK))), ["camera_1", "camera_2"], "turns"),
    "turns of three": (rig("{n:03d}", (*STEREO, ("b", BACK))), ["camera_1", "camera_2", "camera_3"], "turns"),
    "lenses and turns": (
        rig("{n:03d}", (("front", {}), *STEREO, ("back", BACK)), fl_x=lambda i, k: FOCAL * (1 + (k == 0))),
        ["camera_1", "camera_2", "camera_3", "camera_4"],
        "their lenses",
    ),
    "one behind the other": (
        rig("{c}/{i:03d}", (("a", {}), ("b", {"offset": (0.0, 0.0, -2.0)})), timestamp=lambda i, k: 0.1 * i),
        ["a", "b"],
        "their folders",
    ),
    "wide and tele": (
        rig("{n:03d}", (("w", {}), ("t", {})), fl_x=lambda i, k: FOCAL * (1 + 2 * k)),
        ["camera_1", "camera_2"],
        "lenses",
    ),
}


@pytest.mark.parametrize("name", RIGS)
def test_a_rig_is_found_however_its_files_lie(name: str, tmp_path: Path) -> None:
    entries, names, told = RIGS[name]
    drive = opened(tmp_path, entries)
    assert cameras_of(drive) == dict.fromkeys(names, len(entries) // len(names))
    assert list(way(drive).values()) == pytest.approx([STEP_M * (COUNT - 1)] * len(names), rel=0.02)
    (notice,) = drive.notices
    assert (
        f"{len(names)} cameras are told apart by" in notice
        and told in notice
        and notice.endswith("the key camera decides")
    )


@pytest.mark.parametrize("pattern", ["{c}/{i:03d}", "{n:03d}"])
def test_cameras_that_trigger_in_turns_are_a_rig(pattern: str, tmp_path: Path) -> None:
    entries = [
        frame(
            f"images/{pattern.format(c=c, i=i, n=2 * i + k)}.png",
            STEP_M * (i + 0.5 * k),
            mount=m,
            timestamp=0.1 * i + 0.05 * k,
        )
        for i in range(COUNT)
        for k, (c, m) in enumerate(STEREO)
    ]
    drive = opened(tmp_path, entries)
    assert list(cameras_of(drive).values()) == [COUNT, COUNT]


def test_a_rig_listed_camera_by_camera_in_one_sequence_of_numbers_is_found(tmp_path: Path) -> None:
    side = {"offset": (-0.3, 0.0, 0.5), "yaw_deg": 45.0}
    entries = [
        frame(f"images/{COUNT * k + i:03d}.png", STEP_M * i, mount=m)
        for k, m in enumerate((LEFT, side))
        for i in range(COUNT)
    ]
    assert cameras_of(opened(tmp_path, entries)) == {"camera_1": COUNT, "camera_2": COUNT}


def test_poses_with_noise_and_missing_pictures_make_a_rig_all_the_same(tmp_path: Path) -> None:
    noise = random.Random(3)

    def shaken(i: int, side: float) -> dict[str, Any]:
        mount = {"offset": (side + noise.gauss(0, 0.02), noise.gauss(0, 0.02), 0.0), "yaw_deg": noise.gauss(0, 0.3)}
        return {"at": STEP_M * i + noise.gauss(0, 0.02), "mount": mount}

    entries = [
        frame(f"images/{c}/{i:03d}.png", **shaken(i, side))
        for c, side in (("left", -0.27), ("right", 0.27))
        for i in range(40)
        if c == "left" or i % 7
    ]
    assert cameras_of(opened(tmp_path, entries)) == {"left": 40, "right": 34}


NOISE = random.Random(4)
SINGLES = {
    "a card's folders": (single("{part}MEDIA/DJI_{i:04d}"), "2 folders"),
    "folders whose numbers begin anew": (single("clip{part}/{inner:04d}"), "2 folders"),
    "the same with time stamps": (single("clip{part}/{inner:04d}", timestamp=lambda i: 0.1 * i), "2 folders"),
    "a folder with one picture left": (
        [frame(f"images/{100 + i // 11}GOPRO/G_{i:04d}.png", STEP_M * i) for i in range(COUNT)],
        "2 folders",
    ),
    "autofocus": (single("{i:03d}", fl_x=lambda i: FOCAL + 0.05 * (i % 3)), "3 focal lengths"),
    "autofocus with time stamps": (
        single("{i:03d}", fl_x=lambda i: FOCAL + 0.05 * (i % 3), timestamp=lambda i: 0.1 * i),
        "focal",
    ),
    "autofocus in blocks": (single("{i:03d}", fl_x=lambda i: FOCAL + 0.05 * (i // 4)), "3 focal lengths"),
    "autofocus now and then": (single("{i:03d}", fl_x=lambda i: FOCAL + 0.05 * (i in (3, 4, 9))), "2 focal lengths"),
    "a focal length for each frame": (single("{i:03d}", fl_x=lambda i: FOCAL + 0.01 * i), "12 focal lengths"),
    "a zoom": (single("{i:03d}", fl_x=lambda i: FOCAL * (1 + i // 6)), "2 focal lengths"),
    "a lens number for each frame": (single("{i:03d}", camera_id=lambda i: i), "camera_id of its own"),
    "one folder a frame": (single("f{i}/rgb"), None),
    "shaken hands": (
        [
            frame(
                f"images/{i:03d}.png", STEP_M * i + NOISE.gauss(0, 0.05), mount={"offset": (NOISE.gauss(0, 0.05), 0, 0)}
            )
            for i in range(40)
        ],
        None,
    ),
}


@pytest.mark.parametrize("name", SINGLES)
def test_one_camera_stays_one_whatever_its_files_look_like(name: str, tmp_path: Path) -> None:
    entries, told = SINGLES[name]
    drive = opened(tmp_path, entries)
    assert cameras_of(drive) == {"camera": len(entries)}
    assert list(way(drive).values()) == pytest.approx([STEP_M * (len(entries) - 1)], rel=0.05)
    assert len(drive.notices) == (told is not None)
    assert told is None or (told in drive.notices[0] and "the key camera" in drive.notices[0])


def test_a_part_of_a_card_can_be_asked_for_by_its_folder(tmp_path: Path) -> None:
    path = write_transforms(tmp_path, single("{part}MEDIA/DJI_{i:04d}"))
    drive = open_drive(path, DriveOptions(cameras=("101MEDIA",)))
    assert [f.name for f in drive.frames] == [f"DJI_{i:04d}" for i in range(6, 12)]
    with pytest.raises(SettingsError, match="no camera 102MEDIA .it has camera"):
        open_drive(path, DriveOptions(cameras=("102MEDIA",)))


def test_who_comes_back_on_the_other_side_is_one_camera(tmp_path: Path) -> None:
    ways = [("go", {"offset": (1.75, 0.0, 0.0)}), ("back", {"offset": (-1.75, 0.0, 0.0), "yaw_deg": 180.0})]
    entries = [
        frame(f"images/{ways[i // 8][0]}/{i:03d}.png", STEP_M * min(i, 15 - i), mount=ways[i // 8][1])
        for i in range(16)
    ]
    assert cameras_of(opened(tmp_path, entries)) == {"camera": 16}


def test_two_drives_through_a_street_are_not_put_into_one(tmp_path: Path) -> None:
    noise = random.Random(1)
    entries = [
        frame(
            f"images/{day}/{i:03d}.png",
            STEP_M * i + noise.uniform(0, 0.5),
            mount={"offset": (noise.gauss(0, 0.4), 0.0, 0.0)},
        )
        for day in ("mon", "tue")
        for i in range(COUNT)
    ]
    drive = opened(tmp_path, entries)
    assert cameras_of(drive) == {"mon": COUNT, "tue": COUNT} and "do not move as one camera" in drive.notices[0]


def test_the_key_decides(tmp_path: Path) -> None:
    entries = rig("{n:03d}")
    for entry in entries:
        entry["camera"] = "one"
    drive = opened(tmp_path, entries)
    assert cameras_of(drive) == {"one": 2 * COUNT} and not any("cameras" in n for n in drive.notices)


def test_frames_of_a_moment_are_known_by_the_numbers_in_their_names(tmp_path: Path) -> None:
    entries = [e for e in rig("{c}_{i:03d}") if e["file_path"] != "images/right_004.png"]
    drive = opened(tmp_path, entries)
    at = {f.name: t for f, t in zip(drive.frames, instants(drive.frames), strict=True)}
    assert at["left_007"] == at["right_007"] == 7


@pytest.mark.parametrize("folders", [True, False])
def test_colmap_s_rigs_are_found_by_motion(folders: bool, tmp_path: Path) -> None:
    names = [
        f"{c}/{i:03d}.png" if folders else f"{2 * i + k:03d}.png" for i in range(COUNT) for k, c in enumerate("ab")
    ]
    poses = [pose(STEP_M * i, **m) for i in range(COUNT) for _, m in STEREO]
    write_pictures(tmp_path / "images", names)
    write_model(tmp_path / "sparse/0", list(zip(names, poses, strict=True)), cameras=[1, 2] * COUNT, focal=(12.0, 12.2))
    drive = open_drive(tmp_path)
    assert cameras_of(drive) == dict.fromkeys(("a", "b") if folders else ("camera_1", "camera_2"), COUNT)
    assert drive.notices[0].endswith("a transforms.json with the key camera decides")


def test_colmap_s_folders_of_a_card_are_one_camera(tmp_path: Path) -> None:
    names = [f"{100 + i // 6}MEDIA/DJI_{i:04d}.png" for i in range(COUNT)]
    write_pictures(tmp_path / "images", names)
    write_model(tmp_path / "sparse/0", [(n, STEP_M * i) for i, n in enumerate(names)])
    drive = open_drive(tmp_path)
    assert cameras_of(drive) == {"camera": COUNT} and list(way(drive).values()) == pytest.approx([13.2], rel=1e-3)
