"""The training step in torch's own operations, as a GPU takes it, against the processor's fused kernels: the same reconstruction.

    python benchmarks/reconstruction/torch_step.py

Both on the processor, so that only the losses, Adam and what lies between differ, `draft` quality, every eighth frame held
out. Each run is a process of its own; results go to benchmarks/results/torch_step.json. It fails where a held-out PSNR differs
by more than 0.1 dB, or the number of steps at all.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from benchmarks.reconstruction.reconstruction import SCENES, measure  # noqa: E402

MOST_DB = 0.1


def row(measured: dict) -> dict[str, object]:
    """What is kept of a run."""
    held, geometry = measured["held_out"], measured["geometry"]
    return {
        "cpu_seconds": measured["cpu_seconds"],
        "surfels": measured["surfels"],
        "psnr": held["psnr"],
        "ssim": held["ssim"],
        "miou": held["miou"],
        "f_score_0.05": geometry["f_score_0.05"],
        "iterations": measured["choices"]["iterations"]["chosen"],
    }


def main() -> None:
    """Both ways on both scenes."""
    found: dict[str, object] = {}
    apart = []
    with tempfile.TemporaryDirectory() as folder:
        for scene in SCENES:
            runs = {
                name: measure(scene, "draft", Path(folder), more)
                for name, more in (("fused", ()), ("torch", ("--variant", "torch")))
            }
            rows = {name: row(measured) for name, measured in runs.items()}
            difference = round(rows["torch"]["psnr"] - rows["fused"]["psnr"], 3)  # type: ignore[operator]
            found[scene] = {**rows, "psnr_difference": difference}
            found["machine"] = runs["torch"]["machine"]
            if abs(difference) > MOST_DB or rows["torch"]["iterations"] != rows["fused"]["iterations"]:
                apart.append(f"{scene}: {difference:+.3f} dB")
            print(scene, f"{difference:+.3f} dB", flush=True)
            (ROOT / "benchmarks/results/torch_step.json").write_text(json.dumps(found, indent=1) + "\n")
    if apart:
        raise SystemExit(f"the two differ: {', '.join(apart)}")


if __name__ == "__main__":
    main()
