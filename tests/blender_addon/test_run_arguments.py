"""``scene.unveil`` as options: the command takes them, and records what the add-on expects to find recorded."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import pytest

from blender_addon.run_arguments import default_workspace, recorded, settings_arguments
from unveil_core.cli import _parser, _settings

PLAIN = {
    "quality": "standard", "device": "auto", "seed": 0, "shadows": "auto", "sun_azimuth": 0.0, "sun_elevation": 0.5,
    "movers": "auto", "order": "reverse", "keyframes": "", "inpainter": "exemplar", "reference_inpainter": "", "max_side": 0,
}  # fmt: skip


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"quality": "high", "device": "cpu", "seed": 12, "movers": "keep", "order": "forward", "max_side": 640},
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
        given = _settings(_parser().parse_args([*verb, *options, *selection])).to_json()
        expected = recorded(settings, selection, absolute)
        assert {name: given[name] for name in expected} == expected
    assert given["shadows"] in ("auto", "off", "135,40.5")


def test_nothing_recorded_before_comes_through() -> None:
    """Every setting that the panel has is said, whatever a workspace has recorded."""
    options = settings_arguments(SimpleNamespace(**PLAIN))
    assert {o[2:].replace("-", "_") for o in options[::2]} == set(recorded(SimpleNamespace(**PLAIN)))


def test_where_results_go_if_nobody_says() -> None:
    assert default_workspace("/data/street/transforms.json") == Path("/data/street_unveiled")
    assert default_workspace("/data/street") == Path("/data/street_unveiled")
    assert default_workspace("/data/street", "/work/shot.blend") == Path("/work/street_unveiled")
