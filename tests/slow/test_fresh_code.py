"""The same program with kernels that it compiles itself and with kernels from the cache: the same bits."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

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


def test_freshly_compiled_and_cached_code_give_the_same_bits(tmp_path: Path) -> None:
    """A process that compiles the kernels prints what one prints that loads them."""
    lines = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", RENDER],
            capture_output=True,
            text=True,
            timeout=240,
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        )
        assert done.returncode == 0, done.stderr
        lines.append(done.stdout)
    assert list(tmp_path.rglob("*.nbc"))
    assert lines[0] == lines[1]
