"""The command that the page gives to repeat a run is understood by the program, and means the same settings."""

from __future__ import annotations

import shlex
from typing import Any

import pytest

from unveil_core.app.parser import command_parser
from unveil_core.pipeline.settings import RunSettings
from unveil_core.report.command import repeating_command


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
    assert str(given["drive"]) == "/drives/a street" and str(given["output"]) == "my workspace"
    known = {name: given[name] for name in settings.to_json() if name in given}
    assert RunSettings(**known) == settings


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


def test_a_shell_reads_words_as_words() -> None:
    evil = "$(reboot) `x` 'y' ; \"z\""
    command = repeating_command({"drive": evil, "settings": {"scene": evil}}, evil)
    assert command is not None
    assert shlex.split(" ".join(command)) == ["unveil", "run", evil, "-o", evil, f"--scene={evil}"]
