"""What the numbers of plates mean, there and back."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest

from unveil_core.base.errors import SettingsError
from unveil_core.base.plates.colours import KNEE, PlateColours
from unveil_core.base.plates.ocio import applied, space_of_file
from unveil_core.base.plates.transfers import TRANSFERS
from unveil_core.base.srgb import srgb_of_linear

AP1 = (0.6954522, 0.1406787, 0.1638691, 0.0447946, 0.8596711, 0.0955343, -0.0055259, 0.0040252, 1.0015007)


@pytest.mark.parametrize("name", TRANSFERS)
def test_encodings_come_back(name: str) -> None:
    to_light, back = TRANSFERS[name]
    codes = np.linspace(0.02, 1, 50)
    np.testing.assert_allclose(back(to_light(codes)), codes, atol=1e-12)


def test_cineons_white_and_grey() -> None:
    to_light, _ = TRANSFERS["log"]
    assert to_light(np.array(685 / 1023)) == pytest.approx(1.0)
    assert to_light(np.array(95 / 1023)) == pytest.approx(0.0, abs=1e-12)
    assert to_light(np.array(470 / 1023)) == pytest.approx(0.18, abs=0.01)
    assert to_light(np.array(1.0)) == pytest.approx(13.5, abs=0.1)


@pytest.mark.parametrize(
    "colours",
    [
        PlateColours(),
        PlateColours(to_rec709=AP1, exposure=4.0, ceiling=2.5),
        PlateColours("log", ceiling=3.0),
        PlateColours("rec709", exposure=0.5),
        PlateColours(ceiling=1.01),
    ],
)
def test_colours_come_back(colours: PlateColours) -> None:
    values = np.random.default_rng(0).uniform(0.1, 0.9, (40, 3))
    values[0] = 1.0
    np.testing.assert_allclose(colours.decoded(colours.encoded(values)), values, rtol=2e-5)
    assert PlateColours.from_json(colours.to_json()) == colours


def test_up_to_white_it_is_srgb() -> None:
    values = np.linspace(0, 1, 30).reshape(10, 3)
    np.testing.assert_allclose(PlateColours().encoded(values), srgb_of_linear(values), atol=1e-7)


def test_the_brightest_comes_out_at_one() -> None:
    colours = PlateColours(ceiling=float(srgb_of_linear(np.array(8.0))))
    levels = colours.encoded(np.repeat(np.array([[0.5], [0.6], [1.0], [8.0], [16.0]]), 3, axis=1))[:, 0]
    assert levels[0] == pytest.approx(float(srgb_of_linear(np.array(0.5)))) and levels[0] < KNEE
    assert levels[3] == pytest.approx(1.0) and levels[4] > 1 and (np.diff(levels) > 0).all()


def test_the_bend_begins_smoothly() -> None:
    colours = PlateColours(ceiling=2.0)
    light = colours.linear(np.array([KNEE - 1e-4, KNEE, KNEE + 1e-4]))
    steps = np.diff(light)
    assert steps[1] == pytest.approx(steps[0], rel=1e-2)


@pytest.mark.parametrize(
    "change", [{"transfer": "pq"}, {"exposure": 0.0}, {"to_rec709": [0.0] * 9}, {"ceiling": math.nan}]
)
def test_colours_that_are_none(change: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="colours of plates|primaries of plates"):
        PlateColours.from_json(PlateColours().to_json() | change)


def test_a_studios_configuration_decides(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("PyOpenColorIO")
    name = "ocio://cg-config-v1.0.0_aces-v1.3_ocio-v2.1"
    assert space_of_file(name, tmp_path / "plate.exr", "openexr") == "ACEScg"
    colours = PlateColours("ocio", configuration=name, space="ACEScg")
    values = np.random.default_rng(0).uniform(0.05, 0.9, (20, 3)).astype(np.float32)
    expected = (
        values
        @ np.array(
            [[1.705051, -0.621792, -0.083259], [-0.130256, 1.140805, -0.010548], [-0.024003, -0.128969, 1.152972]]
        ).T
    )
    np.testing.assert_allclose(applied(values, name, "ACEScg"), expected, atol=1e-4)
    np.testing.assert_allclose(colours.decoded(colours.encoded(values)), values, rtol=1e-4, atol=1e-5)
    with pytest.raises(SettingsError, match="Not a configuration of OpenColorIO"):
        space_of_file(str(tmp_path / "gone.ocio"), tmp_path / "plate.exr", "openexr")


CONFIGURATION = """ocio_profile_version: 2
search_path: .
roles: {scene_linear: lin_rec709, default: lin_rec709}
colorspaces:
  - !<ColorSpace>
    name: lin_rec709
  - !<ColorSpace>
    name: film
    to_scene_reference: !<FileTransform> {src: "of film, 1.spi1d"}
"""


@pytest.mark.parametrize("what", ["street.ocio", "of film, 1.spi1d"])
def test_a_configuration_and_its_tables_are_files(what: str, tmp_path: Path) -> None:
    """Who waits for a pipe waits for ever."""
    pytest.importorskip("PyOpenColorIO")
    named = tmp_path / "street.ocio"
    named.write_text(CONFIGURATION)
    table = tmp_path / "of film, 1.spi1d"
    table.write_text("Version 1\nFrom 0.0 1.0\nLength 2\nComponents 1\n{\n0.0\n0.5\n}\n")
    np.testing.assert_allclose(applied(np.ones((1, 3)), str(named), "film"), 0.5)
    stranger = tmp_path / "stranger"
    stranger.mkdir()
    for path in (named, table):
        (stranger / path.name).write_bytes(path.read_bytes())
    (stranger / what).unlink()
    os.mkfifo(stranger / what)
    with pytest.raises(SettingsError, match="not a file but a pipe or a device") as told:
        applied(np.ones((1, 3)), str(stranger / "street.ocio"), "film")
    assert what in str(told.value) and "\n" not in str(told.value)
