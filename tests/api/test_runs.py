"""Runs by keywords, with values of Python, over what a workspace was made with."""

from __future__ import annotations

from pathlib import Path

import pytest

import unveil_core as unveil
from unveil_core.base.errors import SettingsError


def test_keywords_are_settings(street: Path, tmp_path: Path) -> None:
    made = unveil.run(
        street,
        tmp_path / "w",
        remove=["vehicle"],
        frames=slice(None, None, 2),
        shadows=(135, 40.5),
        memory=512 << 20,
        cameras=None,
        until="objects",
    )
    assert isinstance(made, unveil.Workspace) and made.root == tmp_path / "w"
    told = made.settings
    assert (told.remove, told.frames, told.shadows, told.memory) == (("vehicle",), "::2", "135,40.5", "512M")
    assert len(made.frames()) == 2 and made.status()["objects"] == "done"


def test_a_workspace_keeps_its_settings_and_says_so(street: Path, tmp_path: Path) -> None:
    unveil.run(street, tmp_path / "w", work_side=32, movers="keep", seed=5, until="import")
    events: list[dict[str, object]] = []
    again = unveil.run(street, tmp_path / "w", seed=None, until="import", reporter=events.append)
    assert (again.settings.work_side, again.settings.movers, again.settings.seed) == (32, "keep", 0)
    assert "Keeping the settings" in str(events[0]["message"]) and events[-1]["message"] == "up to date"
    assert again.run(until="import", movers="auto").settings.movers == "auto"
    assert unveil.run(street, tmp_path / "w", until="import", reset=True).settings == unveil.RunSettings()
    given = unveil.RunSettings(seed=9)
    assert unveil.run(street, tmp_path / "w", given, quality="draft", until="import").settings.seed == 9


def test_wrong_values_and_names_are_one_line(street: Path, tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="Not a value of remove: 3"):
        unveil.run(street, tmp_path / "w", remove=3)  # type: ignore[arg-type]
    with pytest.raises(SettingsError, match="did you mean quality"):
        unveil.run(street, tmp_path / "w", qualty="draft")  # type: ignore[call-arg]
    with pytest.raises(SettingsError, match="Not a stage: 'polish'.*deliver"):
        unveil.run(street, tmp_path / "w", until="polish")
    with pytest.raises(unveil.UnveilError):
        unveil.run(tmp_path / "nowhere", tmp_path / "w")
    assert not (tmp_path / "w").exists()
