"""What is measured on a GPU, as far as the interpreter can: errors against float64, tiles that are reached."""

from __future__ import annotations

import pytest
import torch

pytest.importorskip("triton")
from unveil_core.bench.gpu import backend_errors, reached_tiles
from unveil_core.bench.scenes import corridor, corridor_camera
from unveil_core.raster.api import PLANES
from unveil_core.raster.triton import backend

# Numbers too large for float32 in masked lanes: the interpreter is numpy, which remarks on them.
pytestmark = pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")


def test_errors_are_those_of_float32_and_a_wrong_gradient_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    surfels, camera = corridor(150), corridor_camera(16, 16)
    errors = backend_errors(surfels, camera, "cpu", backend="cpu")
    assert list(errors) == list(PLANES)
    assert all(0 < e["value"] < 2e-5 and 0 < e["gradient"] < 2e-5 for e in errors.values())
    from unveil_core.raster.cpu import backend as cpu

    right = cpu.backward_pass
    monkeypatch.setattr(cpu, "backward_pass", lambda *a: [g * 1.001 for g in right(*a)])
    wrong = backend_errors(surfels, camera, "cpu", backend="cpu")
    assert all(5e-4 < e["gradient"] < 2e-3 for e in wrong.values())


@pytest.mark.skipif(torch.cuda.is_available(), reason="counts in Triton's interpreter")
def test_tiles_reached_are_the_entries_of_the_lists() -> None:
    surfels, camera = corridor(60), corridor_camera(48, 32)
    boxes, reached = reached_tiles(surfels, camera)
    settings = backend.Settings("colour", 8, 1, 0.2, 100.0)
    inputs = (surfels.means, surfels.quats, surfels.log_scales, surfels.opacity_logits, surfels.sh)
    done = backend.forward_pass(inputs, surfels.labels, camera, settings, keep=True)
    assert done.lists is not None and reached == len(done.lists.ids) < boxes
