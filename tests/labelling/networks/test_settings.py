"""The settings of a network, and that the page describes them."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from docs.generate import ROOT
from unveil_core.base.errors import SettingsError
from unveil_core.labelling.networks import settings
from unveil_core.labelling.networks.class_tables import ORDERS
from unveil_core.labelling.networks.settings import CHECKS, NetworkSettings, read_settings

PAGE = (ROOT / "docs/datasets.md").read_text(encoding="utf-8")


def test_the_example_of_the_page_has_every_key(tmp_path: Path) -> None:
    text = re.findall(r"^```toml\n(.*?)^```", PAGE, flags=re.MULTILINE | re.DOTALL)[0]
    assert set(tomllib.loads(text)) == set(CHECKS)
    (tmp_path / "net.toml").write_text(text)
    found = read_settings(tmp_path / "net.onnx")
    assert found.window == (1024, 1024) and found.class_map == {"delivery robot": "car", "57": ""}
    assert all(order in text for order in ORDERS)


def test_the_module_names_every_key() -> None:
    assert all(re.search(rf"^ *\[?{key}\b", settings.__doc__ or "", flags=re.MULTILINE) for key in CHECKS)


def test_without_a_file_nothing_is_set(tmp_path: Path) -> None:
    assert read_settings(tmp_path / "net.onnx") == NetworkSettings(tmp_path / "net.toml")


@pytest.mark.parametrize("content", ["names = " + "[" * 1500 + "]" * 1500, ".".join(["a"] * 20_000) + " = 1"])
def test_a_file_without_measure_is_one_line(content: str, tmp_path: Path) -> None:
    (tmp_path / "net.toml").write_text(content)
    with pytest.raises(SettingsError, match=r"net\.toml: Not readable TOML: it has"):
        read_settings(tmp_path / "net.onnx")
