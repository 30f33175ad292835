"""The kernels compile for GPUs: Triton makes machine code for a processor that need not be there."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

pytest.importorskip("triton")

COMPILE = """
import sys
import triton
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource
from unveil_core.raster.triton import per_surfel, tiles

KINDS = dict(
    pose="*fp64", labels="*i64", boxes="*i16", visible="*u8", touched="*u8", surfel_start="*i64", offsets="*i64",
    ids="*i32", place="*i64", count="i32", width="i32", height="i32", tiles_x="i32", label_count="i32", c1="fp32",
    inv_near="fp32",
)
def build(kernel, capability, **constants):
    types = {n: "constexpr" if n in constants else KINDS.get(n, "*fp32") for n in kernel.arg_names}
    source = ASTSource(fn=kernel, signature=types, constexprs=constants)
    made = triton.compile(source, target=GPUTarget("cuda", capability, 32))
    assert made.asm["cubin"] and f"sm_{capability}" in made.asm["ptx"], kernel
    print(kernel.__name__, capability, len(made.asm["cubin"]))

for capability in map(int, sys.argv[1:]):
    build(per_surfel.project, capability, COEFFICIENTS=16, SH_ROWS=16, TILE=16, BLOCK=128)
    build(per_surfel.sum_rows, capability, ROW=20, USED=19)
    build(per_surfel.chain, capability, COEFFICIENTS=4, SH_ROWS=16, BLOCK=128)
    for on in (False, True):
        switches = dict(GEOMETRY=on, SEMANTICS=on, LABELS=on)
        build(tiles.forward, capability, **switches)
        build(tiles.backward, capability, **switches, ROW=20 if on else 16)
"""


def test_kernels_compile_for_old_and_new_gpus() -> None:
    environment = {k: v for k, v in os.environ.items() if k != "TRITON_INTERPRET"}
    command = [sys.executable, "-W", "ignore", "-c", COMPILE, "80", "90"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment)
    assert done.returncode == 0, done.stderr[-2000:]
    assert len(done.stdout.splitlines()) == 14
