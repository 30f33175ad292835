"""The error of each backend on each hard case, against float64.

    python benchmarks/reconstruction/hard_cases.py

Writes benchmarks/results/hard_cases.json. Without an NVIDIA GPU the Triton kernels run in Triton's interpreter.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import torch

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
if not torch.cuda.is_available():
    os.environ.setdefault("TRITON_INTERPRET", "1")

from tests.raster.hard_cases import CASES, SIZES, HardCase  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402
from unveil_core.raster.api import PLANES, render  # noqa: E402
from unveil_core.surfels.surfels import Surfels  # noqa: E402

LEAVES = ("means", "quats", "log_scales", "opacity_logits", "sh")
TRITON_SIZE = (17, 14)


def run(surfels: Surfels, case: HardCase, size: tuple[int, int], backend: str) -> tuple[dict, dict]:
    """Planes, and the gradients of their sum."""
    device = "cuda" if backend == "triton" and torch.cuda.is_available() else "cpu"
    leaves = {n: getattr(surfels, n).to(device).clone().requires_grad_(True) for n in LEAVES}
    view = case.camera(*size, true=surfels is case.true_surfels)
    labelled = Surfels(**leaves, labels=surfels.labels.to(device))
    out = render(labelled, view, PLANES, label_count=case.label_count, backend=backend)
    sum(getattr(out, p).sum() for p in PLANES).backward()
    planes = {p: getattr(out, p).detach().cpu().double() for p in PLANES}
    return planes, {n: v.grad.cpu().double() for n, v in leaves.items()}


def errors(case: HardCase, size: tuple[int, int], backend: str) -> dict[str, float]:
    """Worst plane and worst gradient, as the hard cases define an error."""
    true = case.surfels if case.true_surfels is None else case.true_surfels
    planes, gradients = run(case.surfels, case, size, backend)
    truth, reference = run(true, case, size, "reference")
    clear = truth["alpha"] > 1.5 / 255 if case.why else torch.ones_like(truth["alpha"], dtype=torch.bool)
    worst = 0.0
    for p in PLANES:
        error = (planes[p] - truth[p])[clear].abs()
        worst = max(worst, float(error.max()) / max(1.0, float(truth[p].abs().max())) if error.numel() else 0.0)
    largest = max((float(g.norm()) for g in reference.values()), default=0.0)
    by_leaf = [
        float((gradients[n] - reference[n]).norm()) / max(float(reference[n].norm()), 0.1 * largest, 1e-30)
        for n in LEAVES
    ]
    return {"plane": float(f"{worst:.2g}"), "gradient": float(f"{max(by_leaf):.2g}")}


def main() -> None:
    """All cases, all sizes, all backends that are there."""
    rows = []
    for name, case in CASES.items():
        row = {"case": name, "limit": case.limit, "why": case.why, "cpu": {}}
        for size in SIZES:
            row["cpu"]["{}x{}".format(*size)] = errors(case, size, "cpu")
        if name != "a thousand thin layers":
            row["triton"] = {"{}x{}".format(*TRITON_SIZE): errors(case, TRITON_SIZE, "triton")}
        rows.append(row)
        print(name, row["cpu"], row.get("triton"), flush=True)
    target = ROOT / "benchmarks/results/hard_cases.json"
    target.write_text(json.dumps({"machine": machine(), "cases": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
