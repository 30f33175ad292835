"""The same program with kernels that it compiles itself and with kernels from the cache: the same bits."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

RENDER = """
import hashlib, torch
from tests.raster.scenes import GRADIENTS, camera, random_surfels, with_gradients
from unveil_core.raster import render
s = with_gradients(random_surfels(1500, 2, degree=2))
out = render(s, camera(150, 90, 110.0), ("rgb", "alpha"))
g = torch.Generator().manual_seed(1)
torch.autograd.backward([out.rgb, out.alpha], [torch.randn(v.shape, generator=g) for v in (out.rgb, out.alpha)])
bits = [out.rgb, out.alpha, *(getattr(s, n).grad for n in GRADIENTS)]
print(hashlib.sha256(b"".join(b.detach().numpy().tobytes() for b in bits)).hexdigest())
"""
SWEEP = """
import hashlib, numpy as np
from tests.surfels.test_sweep import camera_at, photograph
from unveil_core.surfels.sweep import SweepSettings, sweep_depth
cameras = [camera_at(x) for x in (0.0, -0.3, 0.3)]
ladder = 1.0 / np.linspace(1 / 2.0, 1 / 40.0, 40)
planes = sweep_depth(
    cameras[0], photograph(cameras[0]), [(c, photograph(c)) for c in cameras[1:]], ladder, SweepSettings()
)
print(hashlib.sha256(b"".join(plane.tobytes() for plane in planes)).hexdigest())
"""


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> list[list[str]]:
    """What both programs print in a process that compiles the kernels, and in one that loads them."""
    cache, lines = tmp_path_factory.mktemp("kernels"), []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", RENDER + SWEEP],
            capture_output=True,
            text=True,
            timeout=240,
            env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
        )
        assert done.returncode == 0, done.stderr
        lines.append(done.stdout.splitlines())
    assert list(cache.rglob("*.nbc")) and all(len(said) == 2 for said in lines)
    return lines


@pytest.mark.parametrize(("number", "program"), [(0, "render"), (1, "sweep")])
def test_freshly_compiled_and_cached_code_give_the_same_bits(
    printed: list[list[str]], number: int, program: str
) -> None:
    fresh, cached = (said[number] for said in printed)
    assert fresh == cached, program
