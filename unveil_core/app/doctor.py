"""What this machine has: versions, cores, memory, GPU, and whether the rasterizer works here."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import time
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from unveil_core.base.kernels.device import gpu_problem

__all__ = ["examine"]

_PACKAGES = (
    "torch",
    "numpy",
    "numba",
    "opencv-contrib-python-headless",
    "scipy",
    "pillow",
    "trimesh",
    "fast-simplification",
    "onnxruntime",
    "triton",
    "bpy",
)


def examine() -> dict[str, object]:
    """A JSON-able report; ``ok``: whether Unveil can run."""
    from unveil_core import __version__

    found: dict[str, object] = {
        "unveil": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
    }
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    found["cpu"], found["cpus"] = _cpu(), os.cpu_count()
    found.update(_gpu())
    with suppress(ImportError, OSError):
        import psutil

        found["memory_gb"] = round(psutil.virtual_memory().total / 2**30, 1)
    found["disk_free_gb"] = round(shutil.disk_usage(".").free / 2**30, 1)
    try:
        found.update(_render_once())
        found["ok"] = True
    except Exception as error:  # whatever it is, the doctor says it instead of failing
        found["ok"], found["problem"] = False, f"{type(error).__name__}: {error}"
    return found


def _cpu() -> str:
    """The name of the processor, as its maker has it."""
    with suppress(OSError):
        if sys.platform.startswith("linux"):
            lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
            named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
            if named:
                return named[0]
        elif sys.platform == "darwin":
            asked = subprocess.run(
                ["/usr/sbin/sysctl", "-n", "machdep.cpu.brand_string"], capture_output=True, text=True
            )
            if asked.stdout.strip():
                return asked.stdout.strip()
    return platform.processor() or platform.machine()


def _gpu() -> dict[str, object]:
    """The NVIDIA GPU that torch sees, and whether runs use it.

    ``runs_use_gpu``: what ``--device auto`` means here; ``gpu_problem``: if not, what is missing and the mend; ``gpu_unused``: the
    machine has a GPU, by its driver, and this torch is a build without CUDA.
    """
    try:
        import torch

        found: dict[str, object] = {"gpu": "none that torch can use"}
        if torch.cuda.is_available():
            memory = torch.cuda.get_device_properties(0).total_memory
            found = {"gpu": torch.cuda.get_device_name(0), "gpu_memory_gb": round(memory / 2**30, 1)}
        else:
            found["gpu_unused"] = torch.version.cuda is None and shutil.which("nvidia-smi") is not None
        problem = gpu_problem()
        found["runs_use_gpu"] = problem is None
        if problem is not None:
            found["gpu_problem"] = f"{problem[0]} ({problem[1]})"
        return found
    except (ImportError, RuntimeError) as error:
        return {"gpu": f"not known: {error}", "runs_use_gpu": False}


def _render_once() -> dict[str, object]:
    """A real forward and backward pass on a handful of surfels."""
    import numpy as np
    import torch

    from unveil_core.base.parallel import thread_count
    from unveil_core.geometry.camera import Camera
    from unveil_core.raster import render
    from unveil_core.surfels.surfels import Surfels

    camera = Camera(32, 32, 30.0, 30.0, 16.0, 16.0, np.eye(4))
    means = torch.tensor([[0.0, 0.0, 2.0], [0.3, 0.1, 3.0]], requires_grad=True)
    surfels = Surfels(
        means,
        torch.tensor([[1.0, 0, 0, 0]] * 2),
        torch.full((2, 2), -1.0),
        torch.ones(2),
        torch.zeros(2, 1, 3),
        torch.zeros(2, dtype=torch.int64),
    )
    started = time.monotonic()
    out = render(surfels, camera, ("rgb", "alpha", "depth"))
    assert out.alpha is not None and out.depth is not None
    out.depth.sum().backward()  # type: ignore[no-untyped-call]
    if not (
        float(out.alpha.detach().max()) > 0.5 and means.grad is not None and bool(torch.isfinite(means.grad).all())
    ):
        raise RuntimeError("the rasterizer gives wrong values")
    return {
        "rasterizer_first_call_s": round(time.monotonic() - started, 2),
        "threads": thread_count(),
        "cuda": torch.cuda.is_available(),
    }
