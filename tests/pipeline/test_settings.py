"""What the user may decide, and what is refused with one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from unveil_core.base.errors import SettingsError
from unveil_core.pipeline.settings import RunSettings


@pytest.mark.parametrize(
    ("shadows", "sun"), [("auto", None), ("off", None), ("135,40", (135.0, 40.0)), ("-20.5,8", (-20.5, 8.0))]
)
def test_shadows_may_tell_the_sun(shadows: str, sun: tuple[float, float] | None) -> None:
    settings = RunSettings(shadows=shadows)
    assert settings.sun == sun
    assert RunSettings.from_json(settings.to_json()) == settings


@pytest.mark.parametrize("shadows", ["on", "135", "135,0", "135,91", "1,2,3", "nan,40", ""])
def test_a_sun_that_is_none_is_refused(shadows: str) -> None:
    with pytest.raises(SettingsError, match="135,40"):
        RunSettings(shadows=shadows)


def test_orders_are_known_by_name() -> None:
    assert RunSettings(order="forward").order == "forward"
    with pytest.raises(SettingsError, match="reverse"):
        RunSettings(order="sideways")


def test_keyframes_are_kept_and_need_an_order() -> None:
    settings = RunSettings(keyframes=("3", "0009"))
    assert RunSettings.from_json(settings.to_json()) == settings
    with pytest.raises(SettingsError, match="keyframes"):
        RunSettings(keyframes=("3",), order="independent")


def test_networks_are_named_by_files_wherever_one_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    settings = RunSettings(inpainter="lama.onnx", reference_inpainter=str(tmp_path / "refill.ONNX"))
    assert settings.networks == {"inpainter": tmp_path / "lama.onnx", "reference_inpainter": tmp_path / "refill.ONNX"}
    assert RunSettings.from_json(settings.to_json()) == settings
    assert RunSettings().networks == {} and RunSettings(inpainter="fsr").inpainter == "fsr"
    for wrong in ({"inpainter": "lama.pt"}, {"inpainter": "lama"}, {"reference_inpainter": "exemplar"}):
        with pytest.raises(SettingsError, match="FILE.onnx"):
            RunSettings(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "recorded",
    [
        [],
        {"splatz": 1},
        {"splats": "many"},
        {"remove": "car"},
        {"remove": [3]},
        {"instances": [1.5]},
        {"seed": True},
        {"adapt": 1},
        {"inpainter": None},
        {"scale": {}},
    ],
)
def test_settings_that_a_stranger_s_workspace_records_are_one_line(recorded: Any) -> None:
    with pytest.raises(SettingsError, match="the workspace records"):
        RunSettings.from_json(recorded)


@pytest.mark.parametrize(
    "entry", ["3", "3:grow", "3:grow=-1", "3:grow=201", "3:grow=9999999999", ":grow=3", "x:grow=3", "3:shadow=off"]
)
def test_settings_of_single_objects_are_checked(entry: str) -> None:
    with pytest.raises(SettingsError, match="Not a setting of an object"):
        RunSettings(per_object=(entry,))
    told = RunSettings(per_object=("3:grow=8", "12:shadow=keep", "4:grow=0"))
    assert told.grown_px == {3: 8} and told.shadows_that_stay == {12}
    assert RunSettings.from_json(told.to_json()) == told
