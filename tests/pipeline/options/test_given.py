"""Settings over others: by keywords, from a file, over what a workspace records."""

from __future__ import annotations

from pathlib import Path

import pytest

from unveil_core.base.errors import SettingsError
from unveil_core.pipeline.options.given import changed_from_default, settings_of_values, settings_over
from unveil_core.pipeline.options.toml_file import read_settings_file
from unveil_core.pipeline.settings import RunSettings


def test_what_is_given_goes_over_what_was() -> None:
    before = RunSettings(quality="high", scale=2.0, segmenter="/net.onnx", keyframes=("3",))
    made = settings_of_values({"quality": "draft", "remove": ["car"], "keyframes": None}, before)
    assert (made.quality, made.remove, made.keyframes, made.scale) == ("draft", ("car",), (), 2.0)
    assert settings_over(before, {}) == before


@pytest.mark.parametrize(
    ("given", "gone"),
    [({"scale": 2.0}, "camera_height"), ({"camera_height": 1.4}, "scale"), ({"labels": "/l"}, "segmenter")],
)
def test_what_is_given_takes_the_place_of_what_it_excludes(given: dict[str, object], gone: str) -> None:
    before = RunSettings(camera_height=1.6) if gone == "camera_height" else RunSettings(scale=0.3, segmenter="/n.onnx")
    assert getattr(before, gone) is not None and getattr(settings_over(before, given), gone) is None


def test_both_given_are_refused() -> None:
    with pytest.raises(SettingsError, match="Given twice: the scale"):
        settings_over(RunSettings(), {"scale": 2.0, "camera_height": 1.4})


def test_a_slip_of_the_name_is_told() -> None:
    with pytest.raises(SettingsError, match="Not a setting: qualty.*did you mean quality"):
        settings_of_values({"qualty": "draft"})


def test_what_is_no_default_is_said_as_the_command_takes_it() -> None:
    made = RunSettings(remove=("car", "bus"), scale=0.5, adapt=False)
    assert changed_from_default(made) == {"remove": "car,bus", "scale": "0.5", "adapt": "False"}
    assert changed_from_default(RunSettings()) == {}


def test_a_file_of_settings(tmp_path: Path) -> None:
    path = tmp_path / "run.toml"
    path.write_text(
        'quality = "high"\nremove = ["vehicle"]\nshadows = [135, 40]\nadapt = false\niterations = "auto"\n'
        'segmenter = "nets/city.onnx"\nmarked = "/m.json"\ninpainter = "telea"\nper_object = { 3 = { grow = 8 } }\n'
    )
    assert read_settings_file(path) == {
        "quality": "high",
        "remove": ("vehicle",),
        "shadows": "135,40",
        "adapt": False,
        "iterations": None,
        "segmenter": str(tmp_path / "nets/city.onnx"),
        "marked": "/m.json",
        "inpainter": "telea",
        "per_object": ("3:grow=8",),
    }


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"quality = ", "Not a TOML file"),
        (b"\xff", "Not a TOML file"),
        (b'quality = "best"', "Not a choice of quality"),
        (b"seeds = 3", "Not a setting: seeds.*did you mean seed"),
        (b"[run]\nseed = 3", "Not a setting: run"),
        (b"seed = 1979-05-27", "Not a value of seed"),
        (b"quality = " + b"[" * 1500 + b"]" * 1500, "Not a TOML file: it has too many lists or tables"),
        (b"quality = " + b"{a=" * 300 + b"1" + b"}" * 300, "Not a "),
        (b".".join([b"a"] * 20_000) + b" = 1", "Not a TOML file: it has more than 2000 dots"),
        (b"".join(b".".join([b"a"] * 100) + b".b%d = 1\n" % i for i in range(150)), "Not a TOML file"),
        (b"#" * (2 << 20), "Not readable: it is larger than 1,048,576 bytes"),
    ],
)
def test_a_file_that_is_none_is_one_line(content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "run.toml"
    path.write_bytes(content)
    with pytest.raises(SettingsError, match=rf"run\.toml: {message}"):
        read_settings_file(path)
    with pytest.raises(SettingsError, match="Not readable"):
        read_settings_file(tmp_path / "none.toml")
