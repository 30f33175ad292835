"""What the Triton kernels need of a GPU: registers, shared memory and spills, from machine code made without one.

``python -m unveil_core.bench.compiled 80 90`` prints one JSON object a line for each kernel and compute capability. It must
be a process of its own where Triton's interpreter is switched on, as the switch is read when the kernels are defined.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from unveil_core.base.errors import UnveilError
from unveil_core.base.surroundings.guarded_imports import own_this_process

__all__ = ["CAPABILITIES", "compiled"]

CAPABILITIES = {80: "A100", 86: "RTX 30", 89: "RTX 40, L4", 90: "H100, H200", 100: "B200", 120: "RTX 50"}
"""Compute capabilities times ten, and cards that have them."""
DEGREES = (1, 16)
"""Coefficients of the spherical harmonics of degree 0 and 3."""
KINDS = {
    **dict.fromkeys(
        ("count_rows", "offsets", "ids", "place", "by_label", "turn", "ended", "start", "owners", "keys"), "*i32"
    ),
    **dict.fromkeys(("surfels", "width", "height", "tiles_x", "count_surfels", "total"), "i32"),
    **dict.fromkeys(("visible", "touched"), "*u8"),
    **dict.fromkeys(("boxes", "tiles"), "*i16"),
    **dict.fromkeys(("c1", "inv_near"), "fp32"),
    "pose": "*fp64",
    "labels": "*i64",
}
"""Types of the kernels' arguments; all others are pointers to float32."""


def compiled(capabilities: Collection[int], only: str = "") -> list[dict[str, Any]]:
    """Compile the kernels as the backend calls them.

    Args:
        capabilities: compute capabilities times ten, such as 89. only: regular expression of kernels' names.
    Returns:
        for each: kernel, variant, capability, warps, registers (of a thread), shared and spilled bytes (of a block and of a
        thread).
    Raises:
        UnveilError: Triton or its tools cannot make code for one of them.
    """
    environment = {k: v for k, v in os.environ.items() if k != "TRITON_INTERPRET"}
    command = [sys.executable, "-P", "-W", "ignore", "-m", __name__, *map(str, capabilities), only]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode:
        raise UnveilError(
            f"the kernels do not compile: {done.stderr.strip().splitlines()[-1]}",
            mend="install the version of triton that requirements name",
        )
    return [json.loads(line) for line in done.stdout.splitlines()]


def _kernels(capability: int) -> Iterator[tuple[Any, str, dict[str, Any], dict[str, Any]]]:
    """Kernel, variant, its constants, and options of the compiler; ``capability`` times ten."""
    from unveil_core.raster.passes import TILE
    from unveil_core.raster.triton import backend as b
    from unveil_core.raster.triton import backward, binning, ellipsoids, forward, label_distortion, per_surfel
    from unveil_core.raster.triton.memory import KEPT, KEPT_FLAT, SUMS

    for rows in DEGREES:
        degree = {"COEFFICIENTS": rows, "SH_ROWS": rows, "BLOCK": b.BLOCK}
        yield per_surfel.project, f"{rows} coefficients", {**degree, "TILE": TILE}, {"num_warps": 4, **b.FUSED}
        yield per_surfel.chain, f"{rows} coefficients", {**degree, "SUMS": SUMS}, {"num_warps": 4, **b.FUSED}
    degree = {"COEFFICIENTS": 1, "SH_ROWS": 1, "BLOCK": b.BLOCK}
    yield ellipsoids.project_ellipsoids, "1 coefficient", {**degree, "TILE": TILE}, {"num_warps": 4, **b.FUSED}
    yield ellipsoids.chain_ellipsoids, "1 coefficient", {**degree, "SUMS": SUMS}, {"num_warps": 4, **b.FUSED}
    for kernel in (binning.count_tiles, binning.list_tiles):
        yield kernel, "", {"BLOCK": binning.BLOCK}, {"num_warps": 1, "enable_fp_fusion": False}
    for name, geometry, labels in (
        ("colour", False, 0),
        ("8 labels", False, 8),
        ("geometry", True, 0),
        ("geometry, 8 labels", True, 8),
        ("geometry, 19 labels", True, 19),
    ):
        planes = {"GEOMETRY": geometry, "KEPT_PLANES": KEPT if geometry else KEPT_FLAT}
        options = {"num_warps": b.FORWARD_WARPS, "maxnreg": b.forward_registers(labels, capability // 10), **b.FUSED}
        yield forward.forward, name, {**planes, "LABELS": labels, "KEEP": True}, options
        if labels < 19:
            row = {**planes, "SEMANTICS": labels > 0, "ROW": 20 if geometry else 16}
            yield backward.backward, name.replace("8 labels", "labels"), row, {"num_warps": b.BACKWARD_WARPS, **b.FUSED}
    for row_size in (16, 20):
        yield backward.sum_rows, f"{row_size} numbers", {"ROW": row_size, "SUMS": SUMS}, {"num_warps": 1, **b.FUSED}
    kept = {"KEPT_PLANES": KEPT}
    yield label_distortion.label_keys, "", {"LABELS": 19, "BLOCK": 256}, {"num_warps": 4, **b.FUSED}
    yield label_distortion.label_forward, "", kept, {"num_warps": b.LABEL_WARPS, **b.FUSED}
    yield label_distortion.label_backward, "", {**kept, "ROW": 20}, {"num_warps": b.LABEL_WARPS, **b.FUSED}


def _build(kernel: Any, constants: dict[str, Any], options: dict[str, Any], capability: int) -> dict[str, Any]:
    import triton
    from triton.backends.compiler import GPUTarget
    from triton.compiler import ASTSource

    types = {n: "constexpr" if n in constants else KINDS.get(n, "*fp32") for n in kernel.arg_names}
    # Arrays begin at multiples of 16 bytes, as torch's do.
    aligned = {(i,): [["tt.divisibility", 16]] for i, n in enumerate(kernel.arg_names) if types[n].startswith("*")}
    source = ASTSource(fn=kernel, signature=types, constexprs=constants, attrs=aligned)
    made = triton.compile(source, target=GPUTarget("cuda", capability, 32), options=options)
    tool = Path(triton.__file__).parent / "backends/nvidia/bin/cuobjdump"
    with tempfile.NamedTemporaryFile(suffix=".cubin") as file:
        file.write(made.asm["cubin"])
        file.flush()
        said = subprocess.run([tool, "-res-usage", file.name], capture_output=True, text=True, check=True)
    found = re.search(r"REG:(\d+) STACK:(\d+) SHARED:\d+ LOCAL:(\d+)", said.stdout + said.stderr)
    if found is None or f"sm_{capability}" not in made.asm["ptx"]:
        raise UnveilError(f"no code for compute capability {capability / 10}", mend="install a newer triton")
    registers, stack, local = map(int, found.groups())
    return {"registers": registers, "shared": made.metadata.shared, "spilled": stack + local}


def _main(capabilities: list[str], only: str) -> None:
    for capability in map(int, capabilities):
        for kernel, variant, constants, options in _kernels(capability):
            if not re.search(only, kernel.__name__):
                continue
            row = {"kernel": kernel.__name__, "variant": variant, "capability": capability}
            row["warps"] = options["num_warps"]
            print(json.dumps({**row, **_build(kernel, constants, options, capability)}), flush=True)


if __name__ == "__main__":
    own_this_process()
    _main(sys.argv[1:-1], sys.argv[-1])
