"""What this machine has: versions, cores, memory, GPU, and whether the rasterizer works here."""

from __future__ import annotations

import os
import platform
import shutil
import time
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

__all__ = ["examine"]

_PACKAGES = (
    "torch",
    "numpy",
    "numba",
    "opencv-contrib-python-headless",
    "scipy",
    "scikit-image",
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
    found["cpus"] = os.cpu_count()
    found["gpu"] = _gpu()
    with suppress(ValueError, OSError, AttributeError):
        found["memory_gb"] = round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1)
    found["disk_free_gb"] = round(shutil.disk_usage(".").free / 2**30, 1)
    try:
        found.update(_render_once())
        found["ok"] = True
    except Exception as error:  # whatever it is, the doctor says it instead of failing
        found["ok"], found["problem"] = False, f"{type(error).__name__}: {error}"
    return found


def _gpu() -> str:
    """The NVIDIA GPU that the triton backend of ``render`` could use."""
    try:
        import torch

        return torch.cuda.get_device_name(0) if torch.cuda.is_available() else "none that torch can use"
    except (ImportError, RuntimeError) as error:
        return f"not known: {error}"


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
