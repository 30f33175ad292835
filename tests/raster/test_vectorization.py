"""LLVM must vectorize the loops over a block's 16 lanes: losing it breaks nothing and costs a factor of four."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest
import torch
from numba import njit, typeof

from tests.raster.scenes import camera, random_surfels, with_gradients
from unveil_core.raster.api import PLANES, render
from unveil_core.raster.cpu import kernels

ARITHMETIC = re.compile(r"= (fadd|fsub|fmul|fdiv) (?:\w+ )*(float|double|<\d+ x float>|<\d+ x double>)")
# Set-up per tile and per surfel is scalar: 24 operations forward and 103 backward; 102 and 409 are packed (with 8 lanes
# instead of 16 the backward pass has 286). The lane loop alone has some hundred operations, so losing it cannot hide
# under these limits.
MOST_SCALARS = {"forward": 45, "backward": 125}
LEAST_PACKED = {"forward": 80, "backward": 230}


def arithmetic(function: Callable[..., Any], types: tuple[Any, ...]) -> dict[tuple[str, str], int]:
    """How often each (operation, type) stands in the optimized code; compiled afresh, as a cache hides its code."""
    compiled = njit(**{**kernels.FAST, "cache": False})(function)
    compiled.compile(types)
    return Counter(ARITHMETIC.findall(compiled.inspect_llvm(compiled.signatures[0])))


@pytest.fixture(scope="module")
def argument_types() -> dict[str, tuple[Any, ...]]:
    """Types that the "all" group is called with, seen by rendering once."""
    seen: dict[str, tuple[Any, ...]] = {}
    *switches, forward, backward = kernels.GROUPS["all"]

    def recorded(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            seen[name] = tuple(typeof(a) for a in arguments)
            return function(*arguments)

        return call

    kernels.GROUPS["all"] = (*switches, recorded("forward", forward), recorded("backward", backward))
    try:
        out = render(with_gradients(random_surfels(20, 0)), camera(), PLANES, label_count=8)
        torch.autograd.backward([getattr(out, p) for p in PLANES], [torch.ones_like(getattr(out, p)) for p in PLANES])
    finally:
        kernels.GROUPS["all"] = (*switches, forward, backward)
    return seen


@pytest.mark.parametrize("kind", ["forward", "backward"])
def test_lane_loops_are_packed(kind: str, argument_types: dict[str, tuple[Any, ...]]) -> None:
    function = kernels.GROUPS["all"][3 if kind == "forward" else 4]
    counts = arithmetic(function.py_func, argument_types[kind])
    assert not [width for _, width in counts if "double" in width], "float64 crept in"
    packed = sum(n for (_, width), n in counts.items() if width != "float")
    scalar = sum(n for (_, width), n in counts.items() if width == "float")
    # Every lane divides once for 1 / q, and in backward once more for 1 / (1 - alpha): never one lane at a time.
    assert ("fdiv", "float") not in counts
    assert packed >= LEAST_PACKED[kind]
    assert scalar <= MOST_SCALARS[kind]
