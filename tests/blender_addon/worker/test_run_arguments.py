"""``scene.unveil`` as options: the command takes them, and records what the add-on expects to find recorded."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import pytest

from blender_addon.worker.run_arguments import (
    adopt,
    default_workspace,
    other_drive,
    recorded,
    selection_arguments,
    settings_arguments,
)
from unveil_core.app.given_settings import settings_of
from unveil_core.app.parser import command_parser
from unveil_core.pipeline.settings import RunSettings

PLAIN = {
    "quality": "standard",
    "device": "auto",
    "seed": 0,
    "shadows": "auto",
    "sun_azimuth": 0.0,
    "sun_elevation": 0.5,
    "movers": "auto",
    "order": "reverse",
    "keyframes": "",
    "inpainter": "exemplar",
    "reference_inpainter": "",
    "work_side": 0,
    "cameras": "",
    "frames": "",
}


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"quality": "high", "device": "cpu", "seed": 12, "movers": "keep", "order": "forward", "work_side": 640},
        {"shadows": "off"},
        {"shadows": "given", "sun_azimuth": math.radians(135), "sun_elevation": math.radians(40.5)},
        {"keyframes": "3, 7", "inpainter": "telea"},
        {"keyframes": " auto "},
        {"inpainter": "//lama.onnx", "reference_inpainter": "/networks/leftrefill.onnx"},
    ],
)
def test_the_command_records_what_the_add_on_compares_with(changed: dict[str, object]) -> None:
    settings = SimpleNamespace(**{**PLAIN, **changed})

    def absolute(path: str) -> str:
        return path.replace("//", "/blend/")

    selection = ["--remove", "car,person", "--instances", "3,7"]
    options = settings_arguments(settings, absolute)
    for verb in (["run", "drive", "-o", "ws"], ["inpaint", "ws"]):
        given = settings_of(command_parser().parse_args([*verb, *options, *selection])).to_json()
        expected = recorded(settings, selection, absolute)
        assert {name: given[name] for name in expected} == expected
    assert given["shadows"] in ("auto", "off", "135,40.5")


@pytest.mark.parametrize(
    ("chosen", "goes"),
    [
        (["--remove", "car,person"], (["car", "person"], [], None)),
        (["--instances", "3,7"], ([], [3, 7], None)),
        (["--remove", "car", "--marked", "/ws/marked.json"], (["car"], [], "/ws/marked.json")),
        (
            ["--instances", "3", "--corrections", "/ws/c.json", "--per-object", "3:grow=4,3:shadow=keep"],
            ([], [3], None),
        ),
    ],
)
def test_a_choice_replaces_the_one_before(chosen: list[str], goes: tuple[object, ...]) -> None:
    """Also of the kinds that it does not name: a stage keeps what is recorded unless it is told."""
    options = selection_arguments(chosen)
    before = RunSettings(
        remove=("truck",), instances=(9,), marked="/old.json", corrections="/old.json", per_object=("9:grow=1",)
    )
    given = settings_of(command_parser().parse_args(["choose", "ws", *options]), before).to_json()
    assert (given["remove"], given["instances"], given["marked"]) == goes
    expected = recorded(SimpleNamespace(**PLAIN), options)
    assert (expected["remove"], expected["instances"], expected["marked"]) == goes
    assert {name: given[name] for name in expected if name in ("corrections", "per_object")} == {
        name: expected[name] for name in ("corrections", "per_object")
    }
    assert "/old.json" not in given.values() and given["per_object"] != ["9:grow=1"]
    assert selection_arguments([]) == []


def test_nothing_recorded_before_comes_through() -> None:
    """Every setting that the panel has is said, whatever a workspace has recorded."""
    chosen = selection_arguments(["--remove", "car"])
    options = [*settings_arguments(SimpleNamespace(**PLAIN)), *chosen]
    assert {o[2:].replace("-", "_") for o in options[::2]} == set(recorded(SimpleNamespace(**PLAIN), chosen))


def test_where_results_go_if_nobody_says() -> None:
    assert default_workspace("/data/street/transforms.json") == Path("/data/street_unveiled")
    assert default_workspace("/data/street") == Path("/data/street_unveiled")
    assert default_workspace("/data/street", "/work/shot.blend") == Path("/work/street_unveiled")


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"quality": "high", "seed": 12, "movers": "keep", "order": "forward", "work_side": 640, "frames": "::2"},
        {"shadows": "off", "cameras": "front,left", "keyframes": "3,7"},
        {"shadows": "given", "sun_azimuth": math.radians(135), "sun_elevation": math.radians(40.5)},
    ],
)
def test_what_a_workspace_was_made_with_is_taken_over(changed: dict[str, object]) -> None:
    """A run then has the same settings, so that nothing is stale."""
    made = SimpleNamespace(**{**PLAIN, **changed})
    told = recorded(made)
    found = SimpleNamespace(
        **{**PLAIN, "quality": "draft", "seed": 3, "work_side": 99, "frames": "1:2", "cameras": "x"}
    )
    adopt(found, told)
    assert recorded(found) == told


@pytest.mark.parametrize(
    "told", [{"seed": "3"}, {"quality": 3}, {"shadows": "1,2,3"}, {"keyframes": [3]}, {"frames": 7}, {"x": 1}]
)
def test_what_is_no_setting_is_left_aside(told: dict[str, object]) -> None:
    found = SimpleNamespace(**PLAIN)
    adopt(found, told)
    assert vars(found) == PLAIN


def test_another_drive_is_told_from_the_same_one(tmp_path: Path) -> None:
    drive = tmp_path / "street"
    drive.mkdir()
    for same in ("", str(drive), str(drive / "transforms.json"), str(tmp_path / "x/../street")):
        assert other_drive(drive, same) == other_drive(drive / "transforms.json", same) == ""
    assert other_drive(drive, str(tmp_path / "other")) == str(tmp_path / "other")
    assert other_drive(drive / "transforms_train.json", str(drive)) == str(drive)
