"""Reconstructions of the truth scenes against views they have not seen, true labels and the true surface.

    python benchmarks/reconstruction.py [draft standard high]

Each run is a process of its own; results go to benchmarks/results/reconstruction.json.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
SCENES = ("parked_street", "country_road")


def measure(scene: str, quality: str, folder: Path) -> dict[str, object]:
    """One reconstruction, without every eighth frame."""
    target = folder / f"{scene}_{quality}.json"
    drive = HERE.parent / "sample_scenes" / scene
    command = [sys.executable, "-m", "unveil_core", "bench", "reconstruction", str(drive), "--quality", quality]
    subprocess.run([*command, "-o", str(target)], check=True, stdout=subprocess.DEVNULL)
    told = json.loads(target.read_text())
    print(
        scene,
        quality,
        told["seconds"],
        told["held_out"]["psnr"],
        told["held_out"]["miou"],
        told["geometry"],
        flush=True,
    )
    return dict(told)


def main() -> None:
    """Measure the qualities named on the command line, draft and standard by default."""
    with tempfile.TemporaryDirectory() as folder:
        runs = [
            measure(scene, quality, Path(folder))
            for scene in SCENES
            for quality in sys.argv[1:] or ("draft", "standard")
        ]
    (HERE / "results" / "reconstruction.json").write_text(json.dumps({"runs": runs}, indent=1) + "\n")


if __name__ == "__main__":
    main()
