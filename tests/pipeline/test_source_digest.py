"""A result is current only for the code that made it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from unveil_core.pipeline.graph import STAGES
from unveil_core.pipeline.source_digest import ROOT, modules_behind

DIGESTS = """
import sys
from unveil_core.pipeline.graph import STAGES
from unveil_core.pipeline.source_digest import code_digest
for stage in STAGES:
    print(stage.name, code_digest(stage.run))
"""


@pytest.mark.parametrize("name", ["import_", "reconstruct", "inpaint", "report"])
def test_everything_that_is_imported_counts(name: str) -> None:
    module = f"unveil_core.pipeline.steps.{name}"
    # What the package itself needs to be imported computes nothing.
    assert imported_with(module) - imported_with("unveil_core") <= set(modules_behind(module))


def imported_with(module: str) -> set[str]:
    """Modules of the package that are there once one is imported."""
    program = f"import sys, {module}; print(*(m for m in sys.modules if m.split('.')[0] == 'unveil_core'))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT.parent)
    return set(done.stdout.split())


def test_what_is_imported_by_name_when_it_is_needed_counts_too() -> None:
    behind = modules_behind("unveil_core.pipeline.steps.reconstruct")
    assert {"unveil_core.raster.cpu.backend", "unveil_core.raster.triton.backend"} <= set(behind)
    assert not any(
        m.startswith(("unveil_core.app", "unveil_core.report", "unveil_core.inpaint.frames")) for m in behind
    )


def test_a_changed_line_is_seen_by_the_stages_that_run_it_and_by_no_other(tmp_path: Path) -> None:
    shutil.copytree(ROOT, tmp_path / "unveil_core", ignore=shutil.ignore_patterns("__pycache__"))

    def digests() -> dict[str, str]:
        done = subprocess.run([sys.executable, "-c", DIGESTS], capture_output=True, text=True, check=True, cwd=tmp_path)
        return dict(line.split() for line in done.stdout.splitlines())

    before = digests()
    assert list(before) == [s.name for s in STAGES]
    for file, stages in (
        ("mesh/tsdf.py", {"mesh", "report"}),
        ("report/page.css", {"report"}),
        ("inpaint/frames/propagate.py", {"inpaint"}),
    ):
        path = tmp_path / "unveil_core" / file
        path.write_text(path.read_text() + "\n\n")
        after = digests()
        changed = {name for name in before if before[name] != after[name]}
        assert stages >= changed and changed, (file, changed)
        before = after
