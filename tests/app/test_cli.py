"""The command line: exit codes, one line per bad input, nothing left behind, and a whole run on a tiny street."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.drives.tiny_drive import edit, make_tiny_drive
from tests.inpaint.networks import from_reference, mean_fill
from unveil_core.app.cli import main
from unveil_core.base.kernels.device import gpu_problem


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_and_version_load_nothing_heavy(option: str) -> None:
    heavy = ("torch", "numba", "cv2", "scipy", "onnxruntime")
    code = f"import atexit, sys; atexit.register(lambda: print('loaded:', [n for n in {heavy} if n in sys.modules]))\n"
    code += f"from unveil_core.app.cli import main; main([{option!r}])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert out.returncode == 0 and "unveil" in out.stdout.splitlines()[0]
    assert out.stdout.splitlines()[-1] == "loaded: []", out.stdout


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["fly"], "invalid choice"),
        ([], "required"),
        (["run"], "required"),
        (["run", "x", "-o", "y", "--quality", "best"], "invalid choice"),
        (["run", "x", "-o", "y", "--instances", "a"], "not numbers with commas between"),
        (["run", "x", "-o", "y", "--keyframes", ","], "not names or numbers with commas between"),
        (
            ["run", "x", "-o", "y", "--keyframes", "3", "--order", "independent"],
            "Not used when each frame is filled for itself: keyframes",
        ),
        (["run", "nowhere", "-o", "w"], "nowhere: Not found"),
        (["reconstruct", "nowhere"], "nowhere: Not a workspace"),
        (["evaluate", "nowhere"], "nowhere: Not a workspace"),
    ],
)
def test_usage_errors_are_one_line_and_exit_2(
    arguments: list[str], line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert line in error and error.count("\n") == 1 and error.startswith("unveil: error: ")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("option", "name", "said"),
    [
        ("--inpainter", "lama", "Not a choice of inpainter: 'lama'"),
        ("--inpainter", "absent.onnx", "absent.onnx: cannot be read"),
        ("--inpainter", "broken.onnx", "broken.onnx: cannot be loaded"),
        ("--inpainter", "reference.onnx", "reference.onnx: takes a reference"),
        ("--reference-inpainter", "mean.onnx", "mean.onnx: takes no reference"),
        ("--reference-inpainter", "telea", "Not a reference inpainter: telea"),
    ],
)
def test_a_network_that_is_none_is_told_before_anything_is_made(
    option: str, name: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    (tmp_path / "broken.onnx").write_bytes(b"no network")
    mean_fill(tmp_path / "mean.onnx")
    from_reference(tmp_path / "reference.onnx")
    path = str(tmp_path / name) if name.endswith(".onnx") else name
    assert main(["run", str(drive), "-o", str(tmp_path / "w"), option, path]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1 and error.startswith("unveil: error: ")
    assert not (tmp_path / "w").exists()


def drop_images(path: Path) -> None:
    for picture in path.parent.rglob("*.png"):
        picture.unlink()


def garble_image(path: Path) -> None:
    (path.parent / "images/02.png").write_bytes(b"\x89PNG rubbish")


def other_size(path: Path) -> None:
    edit(path, lambda d: d.update(w=64))


def nan_pose(path: Path) -> None:
    edit(path, lambda d: d["frames"][3]["transform_matrix"][2].__setitem__(3, float("nan")))


def skewed_pose(path: Path) -> None:
    edit(path, lambda d: d["frames"][0]["transform_matrix"][1].__setitem__(0, 0.5))


def no_frames(path: Path) -> None:
    edit(path, lambda d: d.update(frames=[]))


def no_points(path: Path) -> None:
    edit(path, lambda d: d.pop("ply_file_path"))


@pytest.mark.parametrize(
    ("change", "extra", "line"),
    [
        (drop_images, [], "none of the 4 photographs is there, the first images/00.png (no pictures lie beside it"),
        (garble_image, [], "02.png: Not a readable image"),
        (other_size, [], "00.png: Not the size of its camera: 32x24 pixels, the camera says 64x24"),
        (nan_pose, [], "the pose of frame 03 holds NaN or infinity"),
        (skewed_pose, [], "Not a rotation: the pose of frame 00"),
        (no_frames, [], "has no frames"),
        (no_points, [], "names no points"),
        (None, ["--remove", "person"], "nothing to remove: the drive has no person; found: road, sky, car"),
        (None, ["--remove", "cars"], "Not a class: 'cars'"),
        (None, ["--instances", "9"], "nothing to remove: the drive has no instance 9; found: 300"),
        (
            None,
            ["--keyframes", "1,9"],
            "Not a frame to be a keyframe: '9' (use numbers from 0 to 3, or stems such as 00)",
        ),
        (None, ["--device", "cuda"], "no GPU can be used: "),
    ],
)
def test_bad_drives_are_one_line_exit_2_and_leave_nothing(
    change, extra: list[str], line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:  # type: ignore[no-untyped-def]
    path = make_tiny_drive(tmp_path / "drive")
    if change:
        change(path)
    assert main(["run", str(path), "-o", str(tmp_path / "ws"), *extra]) == 2
    error = capsys.readouterr().err
    assert line in error and error.count("\n") == 1
    assert not (tmp_path / "ws").exists()


def test_a_foreign_folder_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = make_tiny_drive(tmp_path / "drive")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.txt").write_text("important")
    assert main(["run", str(path), "-o", str(tmp_path / "mine")]) == 2
    assert "Not empty, and not a workspace" in capsys.readouterr().err
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["thesis.txt"]


def test_doctor_renders_for_real(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["ok"] and found["numpy"] and np.isfinite(found["rasterizer_first_call_s"])
    assert found["cpu"] and found["cpus"] > 0 and found["memory_gb"] > 0 and found["disk_free_gb"] > 0
    assert found["runs_use_gpu"] is (gpu_problem() is None)
    assert ("gpu_memory_gb" in found) == found["cuda"] and ("gpu_problem" in found) != found["runs_use_gpu"]


def test_import_speaks_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = make_tiny_drive(tmp_path / "drive")
    assert main(["import", str(path), "-o", str(tmp_path / "ws"), "--json"]) == 0
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    finished = [e["stage"] for e in events if e["message"] == "done"]
    assert finished == ["import", "objects"]  # what could go is listed right away
    assert (tmp_path / "ws/drive/cameras.json").is_file()


def test_a_workspace_s_settings_can_be_taken_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = make_tiny_drive(tmp_path / "drive")
    network = from_reference(tmp_path / "reference.onnx")
    given = ["--work-side", "32", "--reference-inpainter", str(network), "--keyframes", "1"]
    assert main(["import", str(path), "-o", str(tmp_path / "ws"), *given]) == 0
    recorded = tmp_path / "ws/workspace.json"
    assert main(["segment", str(tmp_path / "ws")]) == 0
    assert json.loads(recorded.read_text())["settings"]["work_side"] == 32
    taken_back = ["--work-side", "auto", "--reference-inpainter", "none", "--keyframes", "auto"]
    assert main(["segment", str(tmp_path / "ws"), *taken_back]) == 0
    settings = json.loads(recorded.read_text())["settings"]
    assert settings["work_side"] is settings["reference_inpainter"] is None and settings["keyframes"] == []
