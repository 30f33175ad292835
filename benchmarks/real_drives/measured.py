"""What a run makes of a planted drive: figures by car, and of the drive as a whole."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2

from benchmarks.real_drives.paired import Estimate, Figures, estimate, paired
from benchmarks.real_drives.planted import KeptRound
from benchmarks.real_drives.trees import Run
from unveil_core.base.files import write_json_atomic
from unveil_core.base.types import Picture
from unveil_core.evaluate.baselines import BASELINES
from unveil_core.evaluate.holdout.scores import PARTS, measure_holdout, write_strips
from unveil_core.evaluate.perceptual import LpipsModel
from unveil_core.pipeline.source_digest import code_digest

__all__ = ["BLUR_PX", "FIGURES", "Measured", "blurred", "measure", "means_of"]

BLUR_PX = 4.0
"""Standard deviation of the blur, pixels of the working size, as in planted_holes.py: what a guess may be off by to look right."""
RIVAL_FRAMES = 10
"""About so many frames of a drive are filled by OpenCV's methods: shift-map takes up to 20 seconds of processor for one."""
MOST_GRADIENT = 4.0
"""Ratio of gradients above which a car counts as having this one: behind some cars the photograph is clipped and has none, and
a ratio of hundreds would be all that a mean tells."""
FIGURES = ("psnr", "ssim", "lpips", "gradient", "line_recall", "false_lines", "tint")
METHODS = ("ours", *BASELINES, "blurred")


def blurred(photograph: Picture) -> Picture:
    """A photograph (H, W, 3) without its grain and fine lines."""
    return cv2.GaussianBlur(photograph, (0, 0), BLUR_PX)


@dataclass(frozen=True)
class Measured:
    """A run on a planted drive.

    Attributes:
        found: what the program's check found, see :func:`unveil_core.evaluate.holdout.scores.measure_holdout`.
        rivals: the same of some run on this drive, with the methods that do not depend on the run.
        hidden_psnr: of frames hidden from the reconstruction, dB, as its last look found it; None where it did not look.
        stages: seconds by stage; seconds: of the whole run; load: of the machine when it began.
    """

    found: Mapping[str, Any]
    rivals: Mapping[str, Any]
    hidden_psnr: float | None
    stages: Mapping[str, float]
    seconds: float
    load: float

    def cars(self, prefix: str, method: str = "ours") -> dict[str, Figures]:
        """Figures by car, the car's key beginning with ``prefix``; of parts with their name before, as ``unseen psnr``."""
        return {
            f"{prefix}{car['number']}": {
                f"{part} {name}": _bounded(name, row["methods"][method].get(name))
                for part, row in car["regions"].items()
                if method in row["methods"]
                for name in FIGURES
            }
            for car in (self.found if method == "ours" else self.rivals)["cars"]
        }

    def of_drive(self) -> dict[str, float | None]:
        """Figures of the drive as a whole: what changed outside, flicker, the reconstruction, seconds by stage."""
        flicker = self.found["flicker"].get("methods", {})
        return {
            "outside changed": self.found["outside"]["changed"],
            "outside mean": self.found["outside"]["mean"],
            **{f"flicker {m}": flicker[m]["absolute"] for m in ("ours", "truth") if m in flicker},
            "hidden psnr": self.hidden_psnr,
            "full size psnr": self.found.get("full_size", {}).get("psnr"),
            "full size gradient": self.found.get("full_size", {}).get("gradient"),
            **{f"{stage} s": seconds for stage, seconds in self.stages.items()},
            "all s": self.seconds,
        }


def _bounded(name: str, value: float | None) -> float | None:
    return value if name != "gradient" or value is None else min(value, MOST_GRADIENT)


def measure(kept: KeptRound, run: Run, lpips: Path | None) -> Measured:
    """Measure a run, or take what was measured of it by the same code and network.

    The rivals, which do not depend on the run, are measured once on a planted drive.
    """
    digest = hashlib.blake2b(code_digest(measure_holdout).encode(), digest_size=6)
    digest.update(b"" if lpips is None else lpips.read_bytes())
    name = f"measured_{digest.hexdigest()}.json"
    path, rivals = run.folder / name, kept.folder / f"rivals_{digest.hexdigest()}.json"
    if not path.is_file():
        network = None if lpips is None else LpipsModel(lpips)
        frames, drive, first = kept.frames(), kept.planted_drive(), not rivals.is_file()
        found = measure_holdout(
            frames,
            kept.cars,
            drive,
            run.workspace,
            references={"blurred": blurred} if first else {},
            baseline_frames=RIVAL_FRAMES if first else 0,
            lpips=network,
        )
        if first:
            write_json_atomic(rivals, found)
        write_strips(frames, kept.cars, drive, run.workspace, run.folder / "pictures", methods=("ours",))
        write_json_atomic(path, found)
    stages = json.loads((run.workspace / "workspace.json").read_text())["stages"]
    return Measured(
        json.loads(path.read_text()),
        json.loads(rivals.read_text()),
        hidden_psnr(stages),
        {name: round(stage["seconds"], 1) for name, stage in stages.items() if "seconds" in stage},
        run.seconds,
        run.load,
    )


def hidden_psnr(stages: Mapping[str, Any]) -> float | None:
    """PSNR of hidden frames at the last look of the fine phase of reconstruction, mean over blocks; None where none was taken."""
    choices = stages.get("reconstruct", {}).get("choices") or {}
    blocks = choices if isinstance(choices, list) else choices.get("blocks", [choices])
    last = [[look["psnr"] for look in block.get("looks", ()) if look["phase"] == "fine"][-1:] for block in blocks]
    values = [psnr for block in last for psnr in block]
    return sum(values) / len(values) if values else None


def means_of(measured: Sequence[Measured]) -> dict[str, Any]:
    """A drive's row: by part and method the means over the cars of all rounds with their errors, what ours has beyond the best
    OpenCV row, paired over cars (``gain``), and the drive's own figures.

    Args:
        measured: of each round.
    """
    by_method: dict[str, dict[str, Figures]] = {}
    for k, one in enumerate(measured, 1):
        for method in METHODS:
            by_method.setdefault(method, {}).update(one.cars(f"{k}.", method))
    parts: dict[str, Any] = {}
    for part in PARTS:
        rows = {
            method: {name: value.to_json() for name, value in _estimates(cars.values(), part).items()}
            for method, cars in by_method.items()
        }
        rivals = [m for m in BASELINES if "psnr" in rows[m]]
        best = max(rivals, key=lambda m: rows[m]["psnr"]["mean"], default=None)
        parts[part] = {"ours": rows["ours"], "blurred": rows["blurred"], "best_opencv": rows[best] if best else None}
        parts[part]["best_opencv_is"] = best
        gain = paired(by_method["ours"], by_method[best]) if best else {}
        parts[part]["gain"] = {n: gain[f"{part} {n}"].to_json() for n in FIGURES if f"{part} {n}" in gain}
    wholes = [one.of_drive() for one in measured]
    whole = {name: estimate([row.get(name) for row in wholes]) for name in dict.fromkeys(n for w in wholes for n in w)}
    return {
        "parts": parts,
        "of_drive": {name: None if value is None else round(value.mean, 5) for name, value in whole.items()},
        "cars": by_method["ours"],
    }


def _estimates(cars: Any, part: str) -> dict[str, Estimate]:
    found = {name: estimate([car.get(f"{part} {name}") for car in cars]) for name in FIGURES}
    return {name: value for name, value in found.items() if value is not None}
