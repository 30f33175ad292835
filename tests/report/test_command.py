"""The command that the page gives to repeat a run is understood by the program, and means the same settings."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
from dataclasses import fields
from typing import Any

import pytest

from unveil_core.app.parser import command_parser
from unveil_core.pipeline.settings import RunSettings
from unveil_core.report.command import SETTINGS, name_of_path, repeating_command


def named(settings: RunSettings) -> dict[str, object]:
    """The settings, with files by their names alone."""
    return {k: name_of_path(v) if isinstance(v, str) else v for k, v in settings.to_json().items()}


def state_of(settings: RunSettings, drive: str = "/drives/a street") -> dict[str, Any]:
    return {"drive": drive, "settings": settings.to_json()}


@pytest.mark.parametrize(
    "settings",
    [
        RunSettings(),
        RunSettings(remove=("vehicle", "human"), instances=(3, 7), quality="draft", seed=4, adapt=False),
        RunSettings(up="-y", scale=0.5, frames="-8:", cameras=("left", "right"), keyframes=("3", "7"), memory="512M"),
        RunSettings(device="cuda", baselines=True),
        RunSettings(shadows="135,40", movers="keep", work_side=640, iterations=100, splats=9000, sh_degree=1),
        RunSettings(
            segmenter="/nets/a b.onnx", marked="/marked.json", reference_inpainter="/r.onnx", inpainter="telea"
        ),
    ],
)
def test_it_repeats_the_run(settings: RunSettings) -> None:
    command = repeating_command(state_of(settings), "my workspace")
    assert command is not None
    program, *words = shlex.split(" ".join(command))
    given = vars(command_parser().parse_args(words))
    assert program == "unveil" and given["verb"] == "run"
    assert str(given["drive"]) == "a street" and str(given["output"]) == "my workspace"
    known = {name: given[name] for name in settings.to_json() if name in given}
    # Where files lie is for the one who repeats it to say.
    assert named(RunSettings(**known)) == named(settings)


@pytest.mark.parametrize(
    "state",
    [
        {},
        {"drive": "/d"},
        {"settings": {}},
        {"drive": "/d\nrm -rf ~", "settings": {}},
        {"drive": "/d", "settings": {"a b; c": 1}},
        {"drive": "/d", "settings": {"scene": "a\u202eb"}},
    ],
)
def test_of_what_is_no_run_there_is_none(state: dict[str, Any]) -> None:
    assert repeating_command(state, "workspace") is None


WORDS = ("a street", "Bob's street; rm -rf & co <x> | (y)", "-o", "straße", "#1", "*?[a]", "{a,b}", "a^b")


@pytest.mark.skipif(os.name == "nt", reason="a POSIX shell")
@pytest.mark.parametrize("word", WORDS)
def test_shells_read_words_as_words(word: str) -> None:
    command = repeating_command({"drive": word, "settings": {"scene": word}}, word)
    assert command is not None
    safe = f"./{word}" if word.startswith("-") else word
    wanted = ["run", safe, "-o", safe, f"--scene={word}"]
    assert shlex.split(" ".join(command)) == ["unveil", *wanted]
    line = "unveil() { printf '%s\\n' \"$@\"; }; " + " ".join(command)
    assert subprocess.run(["sh", "-c", line], capture_output=True, text=True).stdout.splitlines() == wanted
    # cmd.exe and PowerShell know double quotes alone, and what they expand within them is not there.
    assert all(w[0] == '"' == w[-1] or re.fullmatch(r"[\w./:,=+@-]+", w) for w in command)
    assert not set(" ".join(command)) & set("$`%!\\")


@pytest.mark.parametrize("word", ["$(reboot)", "`x`", 'a" & calc & "', "%PATH%", "a!b", "a\nb", "$HOME"])
def test_what_some_shell_would_run_is_no_command(word: str) -> None:
    assert repeating_command({"drive": word, "settings": {}}, "workspace") is None
    assert repeating_command({"drive": "d", "settings": {"scene": word}}, "workspace") is None
    assert repeating_command({"drive": "d", "settings": {}}, word) is None


@pytest.mark.parametrize("setting", ["output", "until", "json", "debug", "preview", "no_adaptation"])
def test_what_is_no_setting_gives_no_command(setting: str) -> None:
    assert repeating_command({"drive": "d", "settings": {setting: "/home/victim"}}, "workspace") is None


def test_the_settings_are_those_of_a_run() -> None:
    assert {f.name for f in fields(RunSettings)} == SETTINGS


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("/home/alice/clients/x/street", "street"),
        ("/home/alice/street/", "street"),
        ("/home/alice/street/transforms.json", "street/transforms.json"),
        ("C:\\Users\\alice\\street", "street"),
        ("\\\\server\\alice\\street", "street"),
        ("C:/Users/alice/net.onnx", "net.onnx"),
        ("~/street", "street"),
        ("../../alice/street", "street"),
        ("2011_09_26/drive_0005", "2011_09_26/drive_0005"),
        ("telea", "telea"),
        ("-8:", "-8:"),
        ("/", ""),
    ],
)
def test_paths_are_told_without_their_folders(path: str, name: str) -> None:
    assert name_of_path(path, of_drive=True) == name
    assert name_of_path(path) == name.split("/")[-1] or name == path
