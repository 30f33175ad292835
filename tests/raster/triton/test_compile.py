"""The kernels compile for GPUs without a spill: Triton makes machine code for a processor that need not be there."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from unveil_core.bench.compiled import compiled

pytest.importorskip("triton")

LAUNCH = """
import sys
import numpy as np
import torch
from triton.backends.compiler import GPUTarget
from triton.runtime import driver
from triton.runtime.jit import JITFunction

class Absent:
    # A GPU that is not there: Triton asks which one it is, and compiles for it.
    def get_current_target(self):
        return GPUTarget("cuda", 86, 32)
    def get_current_device(self):
        return 0
    def get_current_stream(self, device):
        return 0

def compile_only(self, *arguments, grid, warmup, **options):
    made = run(self, *arguments, grid=grid, warmup=True, **options)
    print(self.__name__, len(made.asm["cubin"]), options.get("enable_fp_fusion"))

driver.set_active(Absent())
run, JITFunction.run = JITFunction.run, compile_only
# What the kernels would have filled: a tile for each surfel.
torch.empty = torch.ones

from tests.raster.scenes import random_surfels
from unveil_core.geometry.camera import Camera
from unveil_core.raster.passes import Settings
from unveil_core.raster.triton import backend

surfels, view = random_surfels(1, 1, degree=0), Camera(1, 1, 30.0, 30.0, 0.5, 0.5, np.eye(4))
inputs = (surfels.means, surfels.quats, surfels.log_scales, surfels.opacity_logits, surfels.sh)
done = backend.forward_pass(inputs, surfels.labels, view, Settings("all", 1, 1, 0.2, 100.0), keep=True)
backend.backward_pass(done, {name: torch.ones(plane.shape) for name, plane in done.planes.items()}, inputs)
"""


def test_tile_kernels_fit_the_registers_of_old_and_new_gpus() -> None:
    rows = compiled((80, 100, 120), "forward|backward")
    assert len(rows) == 33 and {row["capability"] for row in rows} == {80, 100, 120}
    for row in rows:
        assert row["spilled"] == 0 and 0 < row["registers"] <= 255, row
        # At least four tiles at a time on one multiprocessor of 64 K registers.
        assert row["registers"] * 32 * row["warps"] * 4 <= 65_536, row


def test_every_kernel_compiles_as_the_backend_calls_it() -> None:
    """One surfel and one pixel: Triton takes arguments that are 1 for constants, which is code of its own."""
    environment = {k: v for k, v in os.environ.items() if k != "TRITON_INTERPRET"}
    command = [sys.executable, "-W", "ignore", "-c", LAUNCH]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment)
    assert done.returncode == 0, done.stderr[-2000:]
    names = [line.split()[0] for line in done.stdout.splitlines()]
    # Each says how it rounds, for Triton's default is changing; both kernels that list tiles must round alike.
    apart = {line.split()[0] for line in done.stdout.splitlines() if line.split()[2] != "True"}
    assert apart == {"count_tiles", "list_tiles"}
    passes = "project count_tiles list_tiles forward label_keys label_forward backward label_backward sum_rows chain"
    assert names == passes.split()
