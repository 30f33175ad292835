"""``unveil solve``, and ``unveil run`` of footage, as a user meets them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.drives.tiny_drive import make_tiny_drive
from tests.solve.films import write_clip, write_frames
from unveil_core.app.cli import main
from unveil_core.app.footage.solve import footage_settings, is_footage_alone, next_step, summary
from unveil_core.app.given_settings import settings_of
from unveil_core.app.parser import command_parser
from unveil_core.base.errors import SettingsError
from unveil_core.base.files import write_json_atomic
from unveil_core.base.output.written import GENERATOR
from unveil_core.solve.plan import footage_marks, made_from
from unveil_core.solve.settings import SolveSettings


def _run(*words: str) -> tuple[object, object]:
    arguments = command_parser().parse_args(["run", "clip.mp4", "-o", "out", *words])
    return footage_settings(arguments, settings_of(arguments)), arguments


def test_a_run_of_footage_hands_on_what_the_solve_takes(tmp_path: Path) -> None:
    settings, _ = _run(
        "--labels", str(tmp_path), "--camera-height", "1.4", "--frames", "0:50", "--every", "2", "--focal", "26mm"
    )
    told = (settings.labels, settings.camera_height, settings.frames, settings.every, settings.focal)  # type: ignore[attr-defined]
    assert told == (tmp_path, 1.4, "0:50", 2, "26mm")


def test_what_only_drives_have_is_refused() -> None:
    with pytest.raises(SettingsError, match="Not an option of footage: --scale belongs to drives"):
        _run("--scale", "2")


def test_what_only_footage_has_is_refused_of_a_drive(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    assert main(["run", str(drive), "-o", str(tmp_path / "out"), "--known-length", "20"]) == 2
    assert "Not an option of drives: --known-length belongs to clips and photographs" in capsys.readouterr().err


def test_a_drive_is_no_footage(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    assert not is_footage_alone(Path(drive)) and not is_footage_alone(Path(drive).parent)
    assert is_footage_alone(write_frames(tmp_path / "frames", [np.zeros((8, 8, 3), np.uint8)] * 3))


def test_a_run_of_footage_that_would_end_after_the_solve_does_not_begin(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    footage = write_frames(tmp_path / "frames", [np.zeros((40, 60, 3), np.uint8)] * 8)
    assert main(["run", str(footage), "-o", str(tmp_path / "out")]) == 2
    line = capsys.readouterr().err
    assert "frames: nothing says what to remove from this footage (give --labels or --segmenter; or click" in line
    assert line.count("\n") == 1 and not (tmp_path / "out_drive").exists()


def test_a_dry_run_of_footage_tells_the_solve_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pycolmap")
    footage = write_frames(tmp_path / "frames", [np.zeros((40, 60, 3), np.uint8)] * 30)
    words = ["run", str(footage), "-o", str(tmp_path / "out"), "--dry-run", "--frames", "10:", "--every", "2"]
    assert main(words) == 0
    first, second, third = capsys.readouterr().out.splitlines()
    assert first == "solve        would run: it has not run" and second.strip().startswith(
        "10 frames, 60x40: at most about"
    )
    assert third.startswith("import to report would run after it")
    assert main([*words, "--json", "--until", "ground"]) == 0
    plan = json.loads(capsys.readouterr().out)["plan"]
    assert plan["solve"]["would_run"] and plan["solve"]["frames"] == 10
    assert list(plan["stages"])[0] == "import" and list(plan["stages"])[-1] == "ground"
    assert all(stage["would_run"] for stage in plan["stages"].values())
    assert plan["settings"]["frames"] is None  # the solve takes them
    assert [p.name for p in tmp_path.iterdir()] == ["frames"]


def test_a_dry_run_goes_on_where_the_drive_is_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pycolmap")
    footage = write_frames(tmp_path / "frames", [np.zeros((40, 60, 3), np.uint8)] * 8)
    words = ["run", str(footage), "-o", str(tmp_path / "out"), "--dry-run", "--until", "ground"]
    arguments = command_parser().parse_args(words)
    # A drive as the solve leaves it, with its record.
    drive = Path(make_tiny_drive(tmp_path / "out_drive")).parent
    made = made_from([footage], footage_settings(arguments, settings_of(arguments)))
    record = {"state": "done", "made_from": made, "footage_marks": footage_marks([footage])}
    write_json_atomic(drive / "solve.json", {"generator": GENERATOR, **record})
    write_json_atomic(drive / ".unveil.json", {"generator": GENERATOR, "drive": True, "files": {}})
    assert main(words) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "solve        up to date" and any(line.startswith("reconstruct  would run") for line in lines)
    assert not (tmp_path / "out").exists()
    (footage / "0008.png").write_bytes((footage / "0007.png").read_bytes())
    assert main(words) == 0
    assert "would run: the footage or its settings have changed" in capsys.readouterr().out


@pytest.mark.parametrize("verb", ["import", "check"])
def test_other_verbs_name_the_door(verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clip = tmp_path / "clip.mp4"
    clip.write_bytes(b"\0" * 100)
    assert main([verb, str(clip), "-o", str(tmp_path / "out")]) == 2
    line = capsys.readouterr().err
    assert "Not a drive" in line and "unveil solve CLIP" in line and line.count("\n") == 1


def test_a_broken_clip_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("av")
    clip = tmp_path / "clip.mp4"
    clip.write_bytes(b"\0" * 100)
    assert main(["solve", str(clip), "-o", str(tmp_path / "out")]) == 2
    line = capsys.readouterr().err
    assert "clip.mp4: Not a readable video" in line and "copy the clip again" in line


def test_the_summary_says_what_matters() -> None:
    facts = {
        "frames": 9, "placed": 8, "error_px": 0.5, "points": 1234, "scale": "as given", "way_m": 12.0,
        "lens": {"camera": {"focal_px": 700.0, "focal_known_by": "given"}},
    }  # fmt: skip
    text = "\n".join(summary(facts))
    assert "8 of 9, 12.0 m" in text and "700 px (given)" in text and "1,234" in text


def test_a_drive_without_labels_is_outlined_next(tmp_path: Path) -> None:
    assert next_step(Path("drive"), SolveSettings()).startswith("unveil mask drive -o masks --click")
    assert next_step(Path("drive"), SolveSettings(labels=tmp_path)) == "unveil run drive -o WORKSPACE"


def test_results_go_beside_the_footage_and_never_into_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pycolmap")
    pytest.importorskip("av")
    pictures = [np.full((40, 60, 3), k, np.uint8) for k in range(8)]
    folder, clip = write_frames(tmp_path / "frames", pictures), write_clip(tmp_path / "clip.mp4", pictures)
    for footage, place, code in ((folder, "out", 0), (clip, "out", 0), (folder, "frames/out", 2), (folder, "", 2)):
        words = ["run", str(footage), "-o", str(tmp_path / place), "--dry-run", "--until", "objects"]
        assert main(words) == code, capsys.readouterr().err
