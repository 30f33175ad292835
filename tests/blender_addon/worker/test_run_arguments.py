"""``scene.unveil`` as options: the command takes them, and records what the add-on expects to find recorded."""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from blender_addon.formats.table.run_settings import ADVANCED, BASIC, CHOSEN, SHOWN
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
from unveil_core.pipeline.options.table import TABLE
from unveil_core.pipeline.settings import RunSettings

PLAIN = {**{s.name: s.start for s in SHOWN}, "sun_azimuth": 0.0, "sun_elevation": 0.5, "made_with": ""}
EVERYTHING = RunSettings(
    remove=("vehicle",), instances=(3, 7), marked="/m.json", per_object=("3:grow=4",), corrections="/c.json",
    shadows="135.123456789,40.5", movers="keep", scene="0061", cameras=("front", "left"), frames="-8:", labels="/labels",
    instance_maps="/ids", label_classes="ade20k", mask_removes="white", sweeps="2", model="1,2", pose_convention="opencv",
    scale=0.123456789012, up="-y", poses="given", quality="high", work_side=640, device="cpu", memory="512M", seed=7,
    iterations=300, splats=9000, sh_degree=0, adapt=False, inpainter="telea", reference_inpainter="/r.onnx", order="forward",
    keyframes=("3", "0009"), baselines=True,
)  # fmt: skip
"""No setting has its default but those that the others exclude."""


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
    anything = settings_of(command_parser().parse_args(["choose", "ws", *selection_arguments([])]), before)
    assert anything == RunSettings()


def test_the_table_is_that_of_the_command() -> None:
    rows = {s.name: s for s in TABLE}
    assert [s.name for s in SHOWN] == [n for n in rows if n not in CHOSEN] and set(CHOSEN) <= set(rows)
    assert all((rows[s.name].option, rows[s.name].expert) == (s.option, s.expert) for s in SHOWN)
    assert {s.name for s in BASIC} & {s.name for s in ADVANCED} == set() and len(BASIC) + len(ADVANCED) == len(SHOWN)
    assert recorded(SimpleNamespace(**PLAIN), selection_arguments([])) == RunSettings().to_json()


@pytest.mark.parametrize(
    "settings",
    [
        RunSettings(),
        EVERYTHING,
        replace(
            EVERYTHING, labels=None, segmenter="/net.onnx", scale=None, camera_height=1.4, shadows="off", sh_degree=3
        ),
    ],
)
def test_no_setting_of_a_workspace_is_lost(settings: RunSettings) -> None:
    """Opened in Blender and run again, whatever was recorded before: the same settings, to the last digit."""
    panel = SimpleNamespace(**PLAIN)
    adopt(panel, settings.to_json())
    for name, value in vars(panel).items():
        if isinstance(value, float):  # as Blender keeps it
            setattr(panel, name, struct.unpack("f", struct.pack("f", value))[0])
    chosen = [
        word
        for name, value in (
            ("--remove", ",".join(settings.remove)),
            ("--instances", ",".join(map(str, settings.instances))),
            ("--marked", settings.marked),
            ("--per-object", ",".join(settings.per_object)),
            ("--corrections", settings.corrections),
        )
        if value
        for word in (name, value)
    ]
    options = [*settings_arguments(panel), *selection_arguments(chosen)]
    before = RunSettings(quality="draft", seed=99, iterations=20, remove=("bus",), up="x", mask_removes="black")
    for known in (before, EVERYTHING):
        assert settings_of(command_parser().parse_args(["run", "d", "-o", "w", *options]), known) == settings
    assert recorded(panel, selection_arguments(chosen)) == settings.to_json()
    if settings.scale is not None:  # a number that somebody changes is his
        panel.scale = 0.5
        assert recorded(panel)["scale"] == 0.5


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
    "told",
    [
        {"seed": "3"},
        {"quality": 3},
        {"adapt": 1},
        {"scale": True},
        {"sweeps": None},
        {"shadows": "1,2,3"},
        {"keyframes": [3]},
        {"frames": 7},
        {"x": 1},
    ],
)
def test_what_is_no_setting_is_left_aside(told: dict[str, object]) -> None:
    found = SimpleNamespace(**PLAIN)
    adopt(found, told)
    assert {**vars(found), "made_with": ""} == PLAIN


def test_another_drive_is_told_from_the_same_one(tmp_path: Path) -> None:
    drive = tmp_path / "street"
    drive.mkdir()
    for same in ("", str(drive), str(drive / "transforms.json"), str(tmp_path / "x/../street")):
        assert other_drive(drive, same) == other_drive(drive / "transforms.json", same) == ""
    assert other_drive(drive, str(tmp_path / "other")) == str(tmp_path / "other")
    assert other_drive(drive / "transforms_train.json", str(drive)) == str(drive)
