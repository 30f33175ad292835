"""The benchmark of the pipeline's rows: what it refuses. The rows themselves are in ``tests/slow/``."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.small_street import make_small_street
from unveil_core.app.cli import main


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_small_street(tmp_path_factory.mktemp("street"))


def test_a_network_that_is_none_is_told_before_the_scene_is_made(
    street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "broken.onnx").write_bytes(b"no network")
    for option in ("--inpainter", "--reference-inpainter"):
        command = ["bench", "pipeline", str(street), "--scene", str(tmp_path / "scene"), option]
        assert main([*command, str(tmp_path / "broken.onnx")]) == 2
        error = capsys.readouterr().err.strip()
        assert "broken.onnx: cannot be loaded" in error and len(error.splitlines()) == 1
        assert not (tmp_path / "scene").exists()


@pytest.mark.parametrize(
    ("more", "said"), [(["--rows", "magic"], "Not a row: magic"), (["--inpainter", "magic"], "'magic'")]
)
def test_bad_input_is_one_line(street: Path, more: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "pipeline", str(street), *more]) == 2
    error = capsys.readouterr().err
    assert said in error and len(error.strip().splitlines()) == 1


def test_without_a_truth_there_is_nothing_to_compare(street: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (street.parent / "truth").rename(street.parent / "hidden")
    try:
        assert main(["bench", "pipeline", str(street), "--rows", "telea"]) == 2
    finally:
        (street.parent / "hidden").rename(street.parent / "truth")
    assert "truth/images" in capsys.readouterr().err
