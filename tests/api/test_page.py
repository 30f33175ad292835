"""The page and the notebook run as they stand, in a folder with a drive and a finished workspace."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from docs.generate import ROOT

PAGE = (ROOT / "docs/python.md").read_text(encoding="utf-8")
SNIPPETS = re.findall(r"^```python\n(.*?)^```", PAGE, flags=re.MULTILINE | re.DOTALL)


@pytest.fixture
def folder(finished: Path, street: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(street, tmp_path / "street")
    shutil.copytree(finished, tmp_path / "street_empty")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_snippets_of_the_page_run_one_after_the_other(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert len(SNIPPETS) >= 10
    names: dict[str, Any] = {"__name__": "__main__"}
    for snippet in SNIPPETS:
        exec(compile(snippet, "docs/python.md", "exec"), names)
    said = capsys.readouterr().out
    for line in ("done\n", "7 draft\n", "segment started\n", "(300,) [4]\n", "(300,)\n", "check the path", "colmap"):
        assert line in said, line
    assert (folder / "out/colmap/sparse/0/cameras.txt").is_file()


def test_the_notebook_runs_without_jupyter(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    notebook = json.loads((ROOT / "docs/unveil.ipynb").read_text(encoding="utf-8"))
    cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert notebook["nbformat"] == 4 and len(cells) >= 6
    assert all(cell["outputs"] == [] for cell in notebook["cells"] if cell["cell_type"] == "code")
    shutil.rmtree(folder / "street_empty")
    names: dict[str, Any] = {"__name__": "__main__"}
    for number, cell in enumerate(cells):
        exec(compile(cell, f"docs/unveil.ipynb, cell {number}", "exec"), names)
        if number == 0:
            names["UNTIL"] = "choose"  # what comes after takes minutes
    said = capsys.readouterr().out
    assert "4 frames, 400 points" in said and "(300,)" in said and "labels: [" in said
