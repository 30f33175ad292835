"""A few clicks make an object of all frames, which a run removes; corrections count."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.small_street import FRAMES, make_small_street
from unveil_core.app.cli import main
from unveil_core.base.errors import DriveError, WorkspaceError
from unveil_core.base.output.own_folder import EXCHANGE
from unveil_core.drives import open_drive
from unveil_core.drives.imported import read_imported
from unveil_core.drives.marked import matte, read_marked
from unveil_core.marking.asked.said import Said, SaidObject
from unveil_core.marking.mark import mark
from unveil_core.pipeline.run import look_at, run
from unveil_core.pipeline.settings import RunSettings

CLICKED = 2


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive that nothing labels."""
    path = make_small_street(tmp_path_factory.mktemp("street") / "street")
    data = json.loads(path.read_text())
    data.pop("semantic_classes", None)
    for frame in data["frames"]:
        for key in ("semantic_path", "instance_path", "mask_path"):
            frame.pop(key, None)
    path.write_text(json.dumps(data))
    return path


def truth(street: Path, i: int) -> np.ndarray:
    return cv2.imread(str(street.parent / f"truth/removed/{i:02d}.png"), 0) > 0


def clicks_on(mask: np.ndarray) -> list[str]:
    """Three pixels well inside."""
    rows, columns = np.nonzero(cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8)))
    return [f"{columns[k] + 0.5},{rows[k] + 0.5}" for k in (len(rows) // 6, len(rows) // 2, 5 * len(rows) // 6)]


def iou(folder: Path, street: Path, name: str = "car") -> float:
    """Of the mattes of all frames together."""
    both = either = 0
    for i in range(FRAMES):
        own = cv2.imread(str(folder / f"mattes/{name}/camera/{i:02d}.png"), 0) > 127
        both += int((own & truth(street, i)).sum())
        either += int((own | truth(street, i)).sum())
    return both / either


@pytest.fixture(scope="module")
def clicked(street: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("masks") / "masks"
    words = [w for c in clicks_on(truth(street, CLICKED)) for w in ("--click", f"{CLICKED:02d}:{c}")]
    assert main(["mask", str(street), "-o", str(folder), "--object", "car", *words]) == 0
    return folder


def test_three_clicks_are_an_object_in_all_frames(street: Path, clicked: Path) -> None:
    assert iou(clicked, street) > 0.85
    (entry,) = json.loads((clicked / "marked.json").read_text())
    assert entry == {"id": 1001, "class": "car", "mattes": "mattes/car", "of": "footage"}
    assert (clicked / "sheets/car.jpg").stat().st_size > 2000 and "mattes/car/" in (clicked / "index.html").read_text()


def test_a_run_removes_these_and_nothing_else(street: Path, clicked: Path, tmp_path: Path) -> None:
    marked = str(clicked / "marked.json")
    workspace = run(street, tmp_path / "ws", RunSettings(quality="draft", marked=marked), until="choose")
    assert json.loads((workspace.root / "selection.json").read_text()) == {"removed": [], "instances": [1001]}
    (car,) = json.loads((workspace.root / "objects.json").read_text())["objects"]
    assert (car["source"], car["class"]) == ("mattes", "car") and car["points"] > 30 and car["frames"] >= 6


def test_what_is_painted_over_stays_and_is_carried(street: Path, clicked: Path, tmp_path: Path) -> None:
    """One frame's matte, painted, is enough: the others follow."""
    folder = tmp_path / "masks"
    said = [SaidObject("car", [Said(f"{CLICKED:02d}", "inside", (5.0, 75.0))])]  # the road, by mistake
    mark(street, folder, said)
    assert iou(folder, street) < 0.3
    white = truth(street, 3).astype(np.uint8) * 255
    cv2.imwrite(str(folder / "mattes/car/camera/03.png"), white)
    said = [SaidObject("car", [Said(f"{CLICKED:02d}", "outside", (5.0, 75.0))])]
    (now,) = mark(street, folder, said)
    assert now.frames >= 6 and iou(folder, street) > 0.6
    assert (cv2.imread(str(folder / "mattes/car/camera/03.png"), 0) == white).all()
    (again,) = mark(street, folder, [])  # it counts in the next call, too
    assert again.frames == now.frames and (cv2.imread(str(folder / "mattes/car/camera/03.png"), 0) == white).all()


@pytest.mark.parametrize(("name", "turned"), [("roto", False), ("roto_inv", True), ("plain", True)])
def test_a_matte_of_one_frame_of_either_polarity(
    name: str, turned: bool, street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mattes = tmp_path / name
    mattes.mkdir()
    white = truth(street, 3)
    cv2.imwrite(str(mattes / "03.png"), (~white if turned else white).astype(np.uint8) * 255)
    assert main(["mask", str(street), "-o", str(tmp_path / "out"), "--object", "car", "--mattes", str(mattes)]) == 0
    assert iou(tmp_path / "out", street) > 0.75
    assert ("black is taken for the object" in capsys.readouterr().err) == turned


def test_strokes_of_a_file_and_of_a_picture(street: Path, tmp_path: Path) -> None:
    rows, columns = np.nonzero(truth(street, 3))
    middle = (float(np.median(columns)), float(np.median(rows)))
    entry = {
        "object": "car",
        "frame": "03",
        "stroke": [[middle[0] - 6, middle[1]], [middle[0] + 6, middle[1]]],
        "width": 3,
    }
    (tmp_path / "strokes.json").write_text(json.dumps([entry]))
    assert main(["mask", str(street), "-o", str(tmp_path / "a"), "--stroke", str(tmp_path / "strokes.json")]) == 0
    assert iou(tmp_path / "a", street) > 0.75
    picture = np.zeros((*truth(street, 3).shape, 4), np.uint8)
    picture[int(middle[1]) - 1 : int(middle[1]) + 2, int(middle[0]) - 6 : int(middle[0]) + 7] = (0, 0, 255, 255)
    cv2.imwrite(str(tmp_path / "stroke.png"), picture)
    words = ["--object", "car", "--stroke", f"3:{tmp_path / 'stroke.png'}"]
    assert main(["mask", str(street), "-o", str(tmp_path / "b"), *words]) == 0
    assert iou(tmp_path / "b", street) > 0.75


def test_in_a_workspace_ids_are_new(street: Path, tmp_path: Path) -> None:
    run(street, tmp_path / "ws", RunSettings(quality="draft"), until="objects")
    said = [SaidObject("car", [Said(f"{CLICKED:02d}", "inside", tuple(float(v) for v in c.split(",")))])
            for c in clicks_on(truth(street, CLICKED))[:1]]  # fmt: skip
    (now,) = mark(tmp_path / "ws", tmp_path / "masks", said)
    assert now.id == 1001 and iou(tmp_path / "masks", street) > 0.7
    listed = tmp_path / "ws/objects.json"
    for damaged in ("[", "[]", '{"objects": [{"id": "a"}]}'):
        listed.write_text(damaged)
        with pytest.raises(WorkspaceError, match=r"objects\.json: .*restore it"):
            mark(tmp_path / "ws", tmp_path / "others", said)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ([], "Nothing to outline: neither a click nor a stroke is given"),
        (["--click", "02"], "Not a click: '02'"),
        (["--click", "77:3,3"], "Not a frame: '77'"),
        (["--click", "02:300,3"], "Not in the picture: 300,3 of frame 02, which has 128x80 pixels"),
        (["--stroke", "02:nowhere.png"], "nowhere.png: Not found"),
        (["--mattes", "nowhere"], "nowhere: Not found"),
        (["--object", "car"], "No click, stroke or matte for 'car'"),
        (["--click", "02:3,3", "--prompt-encoder", "a.onnx"], "One network of two is given"),
    ],
)
def test_slips_are_one_line(
    words: list[str], line: str, street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["mask", str(street), "-o", str(tmp_path / "out"), *words]) == 2
    told = capsys.readouterr().err.strip()
    assert line in told and "\n" not in told and not (tmp_path / "out").exists()


def test_mattes_lie_over_the_footage_with_its_lens(tmp_path: Path) -> None:
    """A click and a matte are of the frame as it was filmed: barrel distortion moves a corner by several pixels."""
    path = make_small_street(tmp_path / "street")
    data = json.loads(path.read_text())
    data |= {"camera_model": "OPENCV", "k1": -0.3}
    path.write_text(json.dumps(data))
    run(path, tmp_path / "ws", RunSettings(quality="draft"), until="import")
    drive = read_imported(tmp_path / "ws/drive")
    flat = cv2.imread(str(drive.frames[0].image_path), 0)
    (tmp_path / "mattes").mkdir()
    filmed = open_drive(path).frames[0]
    bright = cv2.imread(str(filmed.image_path), 0) > 128
    cv2.imwrite(str(tmp_path / f"mattes/{filmed.name}.png"), bright.astype(np.uint8) * 255)
    kinds = (("footage", "white"), ("photograph", "white"), ("footage", "black"))
    entries = [{"id": k, "mattes": "mattes", "of": of, "shows": shows} for k, (of, shows) in enumerate(kinds, start=1)]
    (tmp_path / "marked.json").write_text(json.dumps(entries))
    found = [matte(m, drive, drive.frames[0]) for m in read_marked(tmp_path / "marked.json")]
    assert all(m is not None for m in found)
    right, wrong, black = (np.asarray(m) for m in found)
    inside = cv2.erode((flat > 0).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0  # what the flat picture shows at all
    assert ((flat > 128) != right)[inside].mean() < 0.05 < ((flat > 128) != wrong)[inside].mean()
    assert (black != right)[inside].mean() > 0.95


def _one_click(street: Path) -> list[SaidObject]:
    place = tuple(float(v) for v in clicks_on(truth(street, CLICKED))[1].split(","))
    return [SaidObject("car", [Said(f"{CLICKED:02d}", "inside", place)])]


def test_a_painted_matte_stays_where_its_record_is_gone(street: Path, tmp_path: Path) -> None:
    mark(street, tmp_path / "masks", _one_click(street))
    painted = np.full((3, 5), 255, np.uint8)
    cv2.imwrite(str(tmp_path / "masks/mattes/car/camera/04.png"), painted)
    before = (tmp_path / "masks/mattes/car/camera/04.png").read_bytes()
    (tmp_path / "masks/clicks.json").unlink()
    mark(street, tmp_path / "masks", _one_click(street))
    assert (tmp_path / "masks/mattes/car/camera/04.png").read_bytes() == before


def test_a_call_that_ends_too_early_changes_nothing(
    street: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its own new mattes do not count as painted."""
    mark(street, tmp_path / "masks", _one_click(street))
    before = {p: p.read_bytes() for p in (tmp_path / "masks").rglob("*.*") if p.is_file()}

    def fails(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr("unveil_core.marking.mark.write_page", fails)
        road = [SaidObject("car", [Said(f"{CLICKED:02d}", "inside", (5.0, 75.0))])]
        mark(street, tmp_path / "masks", road)
    assert {p: p.read_bytes() for p in before} == before
    (now,) = mark(street, tmp_path / "masks", _one_click(street))
    assert iou(tmp_path / "masks", street) > 0.7 and now.frames >= 6


def test_a_list_of_other_footage_is_told(street: Path, clicked: Path, tmp_path: Path) -> None:
    other = Path(shutil.copytree(street.parent, tmp_path / "other")) / street.name
    for picture in (other.parent / "images").rglob("*.png"):
        cv2.imwrite(str(picture), cv2.GaussianBlur(cv2.imread(str(picture)), (0, 0), 1))
    told: list[str] = []
    mark(other, Path(shutil.copytree(clicked, tmp_path / "masks")), _one_click(street), notice=told.append)
    assert "marked.json: its objects were clicked in other footage" in told[0]
    settings = RunSettings(quality="draft", marked=str(clicked / "marked.json"))
    lines = [n.message for n in look_at(other, tmp_path / "ws", settings).notices]
    assert [line for line in lines if "clicked in other footage" in line]
    lines = [n.message for n in look_at(street, tmp_path / "ws", settings).notices]
    assert not [line for line in lines if "clicked in other footage" in line]


def test_a_list_that_is_half_exchanged_is_refused(clicked: Path, tmp_path: Path) -> None:
    masks = Path(shutil.copytree(clicked, tmp_path / "masks"))
    (masks / EXCHANGE).write_text("{}")
    with pytest.raises(DriveError, match=r"masks: Not whole: a command was ended"):
        read_marked(masks / "marked.json")


@pytest.mark.skipif(os.name == "nt", reason="rights of POSIX")
def test_who_may_not_read_the_drive_may_not_read_its_sheets(street: Path, tmp_path: Path) -> None:
    private = Path(shutil.copytree(street.parent, tmp_path / "private")) / street.name
    for picture in (private.parent / "images").rglob("*.png"):
        picture.chmod(0o600)
    mark(private, tmp_path / "masks", _one_click(street))
    assert not [
        p for p in (tmp_path / "masks").rglob("*.*") if p.is_file() and p.name[0] != "." and p.stat().st_mode & 0o077
    ]
