"""The tile kernels are vector code: losing that costs a factor of four and breaks nothing else."""

from __future__ import annotations

import re
from collections import Counter

import pytest
import torch
from numba import njit

from tests.raster.scenes import camera, random_surfels, with_gradients
from unveil_core.base.parallel import FAST
from unveil_core.raster.api import PLANES, render
from unveil_core.raster.cpu.groups import kernels_for

ARITHMETIC = re.compile(r"= (fadd|fsub|fmul|fdiv) (?:\w+ )*(float|double|<\d+ x float>|<\d+ x double>)")
# What is scalar is done once per block. A lane operation that fell apart would count sixteen times.
MOST_SCALARS = {"forward": 30, "backward": 30}
LEAST_PACKED = {"forward": 95, "backward": 150}


@pytest.mark.parametrize("kind", ["forward", "backward"])
def test_tile_kernels_are_packed(kind: str) -> None:
    out = render(with_gradients(random_surfels(20, 0)), camera(), PLANES, label_count=8)
    torch.autograd.backward([getattr(out, p) for p in PLANES], [torch.ones_like(getattr(out, p)) for p in PLANES])
    used = getattr(kernels_for("all", 5), kind)
    # Compiled afresh for the same types, as a cache hides its code.
    fresh = njit(**{**FAST, "cache": False})(used.py_func)
    fresh.compile(used.signatures[0])
    code = fresh.inspect_llvm(fresh.signatures[0])
    counts = Counter(ARITHMETIC.findall(code))
    assert not [width for _, width in counts if "double" in width], "float64 crept in"
    packed = sum(n for (_, width), n in counts.items() if width != "float")
    scalar = sum(n for (_, width), n in counts.items() if width == "float")
    # Every lane divides once for 1 / q, and in backward once more for 1 / (1 - alpha): never one lane at a time.
    assert ("fdiv", "float") not in counts
    assert packed >= LEAST_PACKED[kind], counts
    assert scalar <= MOST_SCALARS[kind], counts
