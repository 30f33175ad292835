"""One table: what the command takes, the add-on shows, Python's keywords are, the pages say and workspace.json records."""

from __future__ import annotations

import json
import re
from dataclasses import fields
from pathlib import Path

import pytest

from docs.generate import FILES, ROOT
from unveil_core.app.parser import command_parser
from unveil_core.base.errors import SettingsError
from unveil_core.pipeline.graph import STAGES
from unveil_core.pipeline.options.keywords import SettingKeywords
from unveil_core.pipeline.options.table import GROUPS, SETTINGS, TABLE
from unveil_core.pipeline.settings import RunSettings
from unveil_core.report.command import SETTINGS as REPORTED

NAMES = {f.name for f in fields(RunSettings)}


def named_in(page: str, heading: str, column: int) -> set[str]:
    """The names in a column of a page's generated tables."""
    part = (
        (ROOT / page).read_text(encoding="utf-8").partition("<!-- generated: settings ")[2].partition("<!-- end -->")[0]
    )
    cells = [re.split(r"(?<!\\)\|", line)[column].strip() for line in part.splitlines() if line.startswith("| `")]
    assert heading in part
    return {cell.strip("`") for cell in cells}


def test_every_place_has_every_setting() -> None:
    verbs = next(a for a in command_parser()._actions if a.dest == "verb")
    options = {a.dest for a in verbs.choices["run"]._actions}  # type: ignore[index, call-overload]
    addon = json.loads((ROOT / "blender_addon/formats/table/settings.json").read_text(encoding="utf-8"))
    assert len(TABLE) == len(SETTINGS) == len(NAMES) and set(SETTINGS) == NAMES
    assert options & NAMES == NAMES
    assert {row["name"] for row in addon["settings"]} == NAMES
    assert set(SettingKeywords.__annotations__) == NAMES
    assert named_in("docs/command.md", "| option | Python |", 2) == NAMES
    assert named_in("docs/workspace.md", "| setting | type |", 1) == set(RunSettings().to_json()) == NAMES
    assert NAMES == REPORTED
    assert {name for stage in STAGES for name in stage.settings} <= NAMES


@pytest.mark.parametrize("name", FILES)
def test_generated_files_are_up_to_date(name: str) -> None:
    assert (ROOT / name).read_text(encoding="utf-8") == FILES[name](), "run `python docs/generate.py`"


def test_rows_are_whole() -> None:
    for setting in TABLE:
        assert setting.group in GROUPS and setting.help and setting.label, setting.name
        assert not setting.help.endswith(".") and setting.help[0].islower() or setting.help.startswith("LiDAR")
        assert setting.said_default not in ("None", "()", ""), setting.name
        assert setting.kind.names or setting.metavar or setting.kind.shape == "flag" or setting.choices, setting.name


@pytest.mark.parametrize("setting", TABLE, ids=lambda s: s.name)
def test_every_setting_can_be_taken_back(setting: object) -> None:
    row = SETTINGS[setting.name]  # type: ignore[attr-defined]
    assert row.parse("auto") == row.take("auto") == row.take(None) == row.default
    if row.kind.shape in ("file", "folder"):
        assert row.parse("none") is None


@pytest.mark.parametrize(
    ("name", "value", "kept"),
    [
        ("remove", ["vehicle", "person"], ("vehicle", "person")),
        ("remove", "car, truck", ("car", "truck")),
        ("remove", {"truck", "car"}, ("car", "truck")),
        ("instances", (3, 7), (3, 7)),
        ("shadows", True, "auto"),
        ("shadows", False, "off"),
        ("shadows", (135, 40.5), "135,40.5"),
        ("per_object", {3: {"grow": 8, "shadow": "keep"}}, ("3:grow=8", "3:shadow=keep")),
        ("frames", slice(0, 80, 2), "0:80:2"),
        ("frames", slice(None, -8), ":-8"),
        ("frames", range(3, 9), "3:9:1"),
        ("frames", [range(0, 4), 7, "40:46"], "0:4:1,7,40:46"),
        ("keyframes", [3, "0009"], ("3", "0009")),
        ("model", [1, 2], "1,2"),
        ("sweeps", 3, "3"),
        ("memory", 512 << 20, "512M"),
        ("memory", 100_000_001, "100000001"),
        ("scale", 3, 3.0),
        ("labels", Path("/labels"), "/labels"),
        ("inpainter", Path("net.onnx"), "net.onnx"),
        ("up", "+y", "y"),
        ("baselines", True, True),
    ],
)
def test_values_of_python(name: str, value: object, kept: object) -> None:
    assert SETTINGS[name].take(value) == kept


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("remove", 3),
        ("remove", [3]),
        ("instances", ["a"]),
        ("instances", [True]),
        ("seed", True),
        ("seed", 1.5),
        ("seed", "many"),
        ("scale", [1]),
        ("shadows", (1, 2, 3)),
        ("shadows", 40),
        ("frames", range(9, 0, -1)),
        ("frames", 1.5),
        ("adapt", 1),
        ("adapt", "perhaps"),
        ("labels", 7),
        ("per_object", {3: 7}),
        ("memory", 1.5),
        ("quality", 3),
    ],
)
def test_what_is_no_value_is_one_line(name: str, value: object) -> None:
    with pytest.raises(SettingsError, match=f"Not a value of {name}.*give "):
        SETTINGS[name].take(value)


def test_limits_are_those_of_the_settings() -> None:
    for setting in TABLE:
        for limit, beyond in ((setting.low, -1), (setting.high, 1)):
            if limit is not None:
                kind = type(limit)
                RunSettings(**{setting.name: limit})  # type: ignore[arg-type]
                outside = kind(limit + beyond) if kind is int else limit * 10.0**beyond
                with pytest.raises(SettingsError):
                    RunSettings(**{setting.name: outside})  # type: ignore[arg-type]
