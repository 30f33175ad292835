"""Reconstructions of the truth scenes against views they have not seen, true labels and the true surface.

    python benchmarks/reconstruction/reconstruction.py [QUALITY...]

Each run is a process of its own; results go to benchmarks/results/reconstruction.json. Beside the qualities: `standard` as a
fixed recipe, which takes all that the limits allow, and with 5 % of the label pixels wrong.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SCENES = ("parked_street", "country_road")
RUNS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("standard", ()),
    ("standard", ("--variant", "fixed")),
    ("draft", ()),
    ("standard", ("--salt", "0.05")),
    ("high", ()),
)


def measure(scene: str, quality: str, folder: Path, more: Sequence[str] = ()) -> dict[str, object]:
    """One reconstruction, without every eighth frame."""
    target = folder / "measured.json"
    drive = ROOT / "sample_scenes" / scene
    command = [sys.executable, "-m", "unveil_core", "bench", "reconstruction", str(drive), "--quality", quality, *more]
    subprocess.run([*command, "-o", str(target)], check=True, stdout=subprocess.DEVNULL)
    measured = json.loads(target.read_text())
    measured["choices"].pop("looks", None)
    held, geometry = measured["held_out"], measured["geometry"]
    shown = {k: held[k] for k in ("psnr", "miou", "label_error")} | {
        k: geometry.get(k) for k in ("f_score_0.25", "f_score_0.05", "chamfer_m", "unobserved_iou")
    }
    print(scene, quality, *more, measured["seconds"], measured["surfels"], shown, flush=True)
    return dict(measured)


def main() -> None:
    """Measure all runs, or those of the qualities named on the command line; others that were measured before are kept."""
    target = ROOT / "benchmarks/results/reconstruction.json"
    runs: list[dict[str, object]] = json.loads(target.read_text())["runs"] if target.is_file() else []
    with tempfile.TemporaryDirectory() as folder:
        for quality, more in RUNS:
            for scene in SCENES if quality in sys.argv[1:] or not sys.argv[1:] else ():
                measured = measure(scene, quality, Path(folder), more)
                runs = [r for r in runs if any(r[k] != measured[k] for k in ("drive", "quality", "variant", "salt"))]
                runs.append(measured)
                target.write_text(json.dumps({"runs": runs}, indent=1) + "\n")


if __name__ == "__main__":
    main()
