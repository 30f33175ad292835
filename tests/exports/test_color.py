"""Linear light by OpenColorIO: a studio's configuration decides, and what it cannot do is one line."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest

from tests.exports.conftest import Street
from unveil_core.app.cli import main
from unveil_core.base.errors import SettingsError
from unveil_core.base.pictures.colours import SRGB
from unveil_core.exports.color import LINEAR, linear_light

ocio = pytest.importorskip("PyOpenColorIO")
ACES = "ocio://cg-config-v2.2.0_aces-v1.3_ocio-v2.4"
TO_ACESCG = np.array(
    [[0.61309732, 0.33952285, 0.04737928], [0.07019422, 0.91635557, 0.01345259], [0.02061560, 0.10956983, 0.86981512]]
)
"""From linear Rec. 709 to AP1 with Bradford's adaptation, as the ACES project publishes it."""


def test_without_a_configuration_it_is_rec_709(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OCIO", raising=False)
    light = linear_light()
    assert light.name_for(SRGB) == LINEAR and light.configuration is None
    np.testing.assert_allclose(light.of(np.array([[[0.0, 0.5, 1.0]]])), [[[0, 0.21404114, 1]]], rtol=1e-6)


def test_plates_are_in_the_configuration_s_scene_linear(
    street: Street, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OCIO", ACES)
    assert main(["export", str(street.root), "--to", "exr", "-o", str(tmp_path)]) == 0
    assert json.loads((tmp_path / "exr/export.json").read_text())["opencolorio"] == ACES
    with OpenEXR.File(str(tmp_path / "exr/front/front.1002.exr"), separate_channels=True) as file:
        found = np.stack([file.channels()[c].pixels for c in "RGB"], axis=2).astype(np.float64)
        header = dict(file.header())
    assert header["unveil:colorspace"] == "ACEScg"
    assert header.get("colorInteropID", "") != LINEAR
    srgb = cv2.imread(str(street.root / "frames/front/0001.png"), cv2.IMREAD_UNCHANGED)[..., ::-1] / 65535
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(found, linear @ TO_ACESCG.T, atol=1e-3)


BARE = """ocio_profile_version: 2
roles: {default: raw}
file_rules: [!<Rule> {name: Default, colorspace: raw}]
displays: {screen: [!<View> {name: Raw, colorspace: raw}]}
active_displays: []
active_views: []
colorspaces: [!<ColorSpace> {name: raw, isdata: true}]
"""


@pytest.mark.parametrize(
    ("content", "message"), [(None, "Not a configuration of OpenColorIO"), (BARE, "has no role scene_linear")]
)
def test_a_configuration_that_does_not_do_is_one_line(
    content: str | None, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "config.ocio"
    if content is not None:
        path.write_text(content)
    monkeypatch.setenv("OCIO", str(path))
    with pytest.raises(SettingsError, match=message) as caught:
        linear_light()
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_missing_library_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OCIO", ACES)
    monkeypatch.setitem(sys.modules, "PyOpenColorIO", None)
    with pytest.raises(SettingsError, match="Not installed: OpenColorIO"):
        linear_light()
