"""The tile kernels are vector code: losing that costs a factor of four and breaks nothing else."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest
import torch
from numba import njit, typeof

from tests.raster.scenes import camera, random_surfels, with_gradients
from unveil_core.parallel import FAST
from unveil_core.raster.api import PLANES, render
from unveil_core.raster.cpu.groups import KERNELS

ARITHMETIC = re.compile(r"= (fadd|fsub|fmul|fdiv) (?:\w+ )*(float|double|<\d+ x float>|<\d+ x double>)")
# What is scalar is done once per block. A lane operation that fell apart would count sixteen times.
MOST_SCALARS = {"forward": 15, "backward": 15}
LEAST_PACKED = {"forward": 95, "backward": 150}


def optimized(function: Callable[..., Any], types: tuple[Any, ...]) -> str:
    """The kernel's optimized code; compiled afresh, as a cache hides its code."""
    compiled = njit(**{**FAST, "cache": False})(function)
    compiled.compile(types)
    return str(compiled.inspect_llvm(compiled.signatures[0]))


@pytest.fixture(scope="module")
def argument_types() -> dict[str, tuple[Any, ...]]:
    """Types that the "all" group is called with, seen by rendering once."""
    seen: dict[str, tuple[Any, ...]] = {}
    group = KERNELS["all"]

    def recorded(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            seen[name] = tuple(typeof(a) for a in arguments)
            return function(*arguments)

        return call

    KERNELS["all"] = group._replace(
        forward=recorded("forward", group.forward), backward=recorded("backward", group.backward)
    )
    try:
        out = render(with_gradients(random_surfels(20, 0)), camera(), PLANES, label_count=8)
        torch.autograd.backward([getattr(out, p) for p in PLANES], [torch.ones_like(getattr(out, p)) for p in PLANES])
    finally:
        KERNELS["all"] = group
    return seen


@pytest.mark.parametrize("kind", ["forward", "backward"])
def test_tile_kernels_are_packed(kind: str, argument_types: dict[str, tuple[Any, ...]]) -> None:
    code = optimized(getattr(KERNELS["all"], kind).py_func, argument_types[kind])
    counts = Counter(ARITHMETIC.findall(code))
    assert not [width for _, width in counts if "double" in width], "float64 crept in"
    packed = sum(n for (_, width), n in counts.items() if width != "float")
    scalar = sum(n for (_, width), n in counts.items() if width == "float")
    # Every lane divides once for 1 / q, and in backward once more for 1 / (1 - alpha): never one lane at a time.
    assert ("fdiv", "float") not in counts
    assert packed >= LEAST_PACKED[kind], counts
    assert scalar <= MOST_SCALARS[kind], counts
