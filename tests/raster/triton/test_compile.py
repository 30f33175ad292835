"""The kernels compile for GPUs without a spill: Triton makes machine code for a processor that need not be there."""

from __future__ import annotations

import pytest

from unveil_core.base.errors import UnveilError
from unveil_core.bench.compiled import compiled

pytest.importorskip("triton")


def test_tile_kernels_fit_the_registers_of_old_and_new_gpus() -> None:
    rows = compiled((80, 120), "forward|backward|tiles|label|sum")
    assert len(rows) == 32 and {row["capability"] for row in rows} == {80, 120}
    for row in rows:
        assert row["spilled"] == 0 and 0 < row["registers"] <= 255, row
        # At least four tiles at a time on one multiprocessor of 64 K registers.
        assert row["registers"] * 32 * row["warps"] * 4 <= 65_536, row


def test_kernels_of_single_surfels_compile() -> None:
    (row,) = compiled((86,), "count_tiles")
    assert row["kernel"] == "count_tiles" and row["spilled"] == 0


def test_an_unknown_capability_is_said_in_one_line() -> None:
    with pytest.raises(UnveilError, match="the kernels do not compile: ") as caught:
        compiled((13,), "label_keys")
    assert "\n" not in str(caught.value)
