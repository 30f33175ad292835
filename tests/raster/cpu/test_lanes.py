"""Vectors inside kernels: every operation against numpy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numba import njit, types

from unveil_core.base.types import Float32
from unveil_core.raster.cpu.lanes import LANES, Vector, add_across, lane_function, lane_type

A = np.linspace(-3, 3, LANES).astype(np.float32)
B = np.cos(np.arange(LANES)).astype(np.float32) * 2


def apply(body: Callable[[Vector, Vector], Vector]) -> Float32:
    """What a function of two vectors makes of A and B, compiled."""

    @lane_function(lambda: types.void)
    def whole(builder, a, b, out, at):  # type: ignore[no-untyped-def]
        out.store(body(a.load(at), b.load(at)), at)

    @njit
    def kernel(a, b, out):  # type: ignore[no-untyped-def]
        whole(a, b, out, np.uint64(0))

    out = np.zeros(LANES, np.float32)
    kernel(A, B, out)
    return out


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (lambda a, b: a + b, A + B),
        (lambda a, b: 1.0 - a * 2.0, 1 - A * 2),
        (lambda a, b: b / (a * a + 1.0), B / (A * A + 1)),
        (lambda a, b: 1.0 / (3.5 + a), 1 / (3.5 + A)),
        (lambda a, b: a.least(b), np.minimum(A, B)),
        (lambda a, b: a.most(0.25), np.maximum(A, 0.25)),
        (lambda a, b: a.magnitude(), np.abs(A)),
        (lambda a, b: ((a > 0.0) & (b <= 1.0)).where(a, -7.0), np.where((A > 0) & (B <= 1), A, -7)),
        (lambda a, b: ((a < -1.0) | (b >= 1.5)).where(1.0, b), np.where((A < -1) | (B >= 1.5), 1, B)),
        (lambda a, b: a.equals(a * 1.0).where(b, a), B),
        (lambda a, b: add_across([a, b, a * b]), np.r_[A.sum(), B.sum(), (A * B).sum(), np.zeros(13)]),
    ],
)
def test_operations(body: Callable[[Vector, Vector], Vector], expected: Float32) -> None:
    np.testing.assert_allclose(apply(body), expected, rtol=2e-6, atol=2e-6)


def test_sixteen_sums_at_once() -> None:
    rows = np.random.default_rng(0).normal(size=(LANES, LANES)).astype(np.float32)

    @lane_function(lambda: types.void)
    def whole(builder, rows, out, at):  # type: ignore[no-untyped-def]
        out.store(add_across([rows.load(at, LANES * k) for k in range(LANES)]), at)

    @njit
    def kernel(rows, out):  # type: ignore[no-untyped-def]
        whole(rows, out, np.uint64(0))

    out = np.zeros(LANES, np.float32)
    kernel(rows, out)
    np.testing.assert_allclose(out, rows.sum(axis=1), atol=1e-5)


def test_truths_as_bits_and_switches_as_constants() -> None:
    @lane_function(lambda Negative: types.uint64)
    def bits(builder, Negative, a, at):  # type: ignore[no-untyped-def]
        return (a.load(at) < 0.0).bits() if Negative else (a.load(at) > 0.0).bits()

    @njit
    def kernel(a):  # type: ignore[no-untyped-def]
        return bits(True, a, np.uint64(0)), bits(False, a, np.uint64(0))

    below, above = kernel(A)
    assert below == sum(1 << k for k in range(LANES) if A[k] < 0)
    assert above == sum(1 << k for k in range(LANES) if A[k] > 0)


def test_vectors_are_values_of_a_kernel() -> None:
    """They go through a loop in a tuple, as the state of a block does."""

    @lane_function(lambda: types.UniTuple(lane_type, 2))
    def start(builder):  # type: ignore[no-untyped-def]
        return Vector.of(builder, 0.0), Vector.of(builder, 1.0)

    @lane_function(lambda: types.UniTuple(lane_type, 2))
    def step(builder, state, a, at):  # type: ignore[no-untyped-def]
        return state[0] + a.load(at), state[1] * 0.5

    @lane_function(lambda: types.void)
    def finish(builder, state, out, at):  # type: ignore[no-untyped-def]
        out.store(state[0] + state[1], at)

    @njit
    def kernel(a, out):  # type: ignore[no-untyped-def]
        state = start()
        for k in range(3):
            state = step(state, a, np.uint64(16 * k))
        finish(state, out, np.uint64(0))

    rows, out = np.arange(48, dtype=np.float32), np.zeros(LANES, np.float32)
    kernel(rows, out)
    np.testing.assert_allclose(out, rows.reshape(3, 16).sum(axis=0) + 0.125)


@pytest.mark.parametrize("spread", [1, 3, 8])
def test_a_block_of_an_image_goes_in_and_comes_back(spread: int) -> None:
    width = 9

    @lane_function(lambda: types.void)
    def there(builder, image, out, first, step, spread, at):  # type: ignore[no-untyped-def]
        rows = [first]
        for _ in range(3):
            rows.append(builder.add(rows[-1], step))
        out.store(image.gather(rows, spread), at)
        image.scatter(image.gather(rows, spread) * -1.0, rows, spread)

    @njit
    def kernel(image, out, first, step, spread):  # type: ignore[no-untyped-def]
        there(image, out, first, step, spread, np.uint64(0))

    image = np.random.default_rng(1).normal(size=(7, width, spread)).astype(np.float32)
    before, out = image.copy(), np.zeros(LANES, np.float32)
    sizes: Any = [np.uint64(v) for v in ((2 * width + 3) * spread + spread - 1, width * spread, spread)]
    kernel(image.reshape(-1), out, *sizes)
    np.testing.assert_array_equal(out.reshape(4, 4), before[2:6, 3:7, spread - 1])
    expected = before.copy()
    expected[2:6, 3:7, spread - 1] *= -1
    np.testing.assert_array_equal(image, expected)
