"""benchmarks/machine/gpu.py in a tiny size, whole: each part that a card is asked, in Triton's interpreter."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("triton")
from benchmarks.machine import gpu, gpu_parts
from tests.bench.test_gpu_script import tiny
from unveil_core.raster.api import PLANES


def test_every_part_gives_what_the_pages_show(tmp_path: Path) -> None:
    found = tiny(tmp_path / "gpu.json", "--seconds", "900")
    assert set(gpu.known_parts(tmp_path, True)) <= set(found)
    for backend in ("triton", "cpu"):
        errors = found["checks"][backend]
        assert list(errors) == list(PLANES) and all(e["value"] < 2e-5 and e["gradient"] < 2e-5 for e in errors.values())
    assert found["step"][0]["step_ms"] > 0 and found["kernels"][0]["registers"] > 0
    runs = {**found["sample"], **found["sample on the processor"]}
    assert set(runs) == {"draft on cuda", "standard on cuda", "draft on cpu"}
    for run in (*runs.values(), found["drive"]):
        assert list(run["stages"]) == ["import", "objects"] and run["seconds"] > 0 and "cut_off" not in run
    assert found["drive"]["frames"] == gpu_parts.TINY.frames
