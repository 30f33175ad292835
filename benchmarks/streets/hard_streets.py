"""Cases that are hard to unveil, each a small drive with a known truth: an ordinary `draft` run, measured and shown.

    python benchmarks/streets/hard_streets.py [CASES...]

Writes benchmarks/results/hard_streets.json, where cases measured before are kept, and hard_streets.jpg: a row a case, what went in,
what came out, what is true. `UNVEIL_KEEP=DIR` keeps drives and workspaces, to be looked at.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.streets.staged_streets import Box, Car, GlassFront, Person, Staged, empty_street, stage  # noqa: E402
from unveil_core.base.errors import UnveilError  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.base.pictures.decoding import read_image, read_label_image  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402
from unveil_core.evaluate import run_evaluation  # noqa: E402
from unveil_core.evaluate.detail.scores import DETAIL_FIGURES  # noqa: E402
from unveil_core.evaluate.holdout.virtual_cars import VirtualCar  # noqa: E402
from unveil_core.evaluate.metrics import psnr_of_mse, squared_error, ssim_map  # noqa: E402
from unveil_core.pipeline.run import run  # noqa: E402
from unveil_core.pipeline.settings import RunSettings  # noqa: E402

RESULTS = ROOT / "benchmarks/results/hard_streets.json"
FIGURES = ("psnr", "ssim", *DETAIL_FIGURES)
"""Of the removed region, of other methods; of ours, whose PSNR and SSIM are in all regions, the details."""
BLACK = 8
"""A pixel all of whose channels are below this is black; the true street has hardly any."""


@dataclass(frozen=True, eq=False)
class Case:
    """A drive: the sample's frames, what stands there, and how it is removed; ``shown`` is the frame of the picture."""

    what: str
    frames: range
    objects: tuple[Staged, ...]
    shown: int
    glass: GlassFront | None = None
    by_instance: bool = False

    def settings(self) -> RunSettings:
        """Of the run: the classes of what goes, or its ids."""
        gone = [o for o in self.objects if o.goes]
        if self.by_instance:
            return RunSettings(instances=tuple(o.instance for o in gone), quality="draft")
        return RunSettings(remove=tuple(sorted({o.kind for o in gone})), quality="draft")


def box(frame: int, ahead: float, left: float, size: tuple[float, float, float]) -> Box:
    """A box whose rear is so far ahead of a frame's camera."""
    floor, axes = empty_street().place(frame, ahead + size[0] / 2, left)
    return Box(floor, axes, size)


def car(frame: int, ahead: float, left: float, number: int) -> Car:
    """A car in the direction of travel."""
    floor, axes = empty_street().place(frame, ahead, left)
    return Car(VirtualCar(floor, axes, number, 0.0, 0.0))


def glass_front() -> GlassFront:
    """A shop front of glass on the house at the right of the ninth frame, 4 cm before its wall."""
    view = empty_street().views[8]
    near, far = (view.camera.unproject(view.depth)[90, column] for column in (352, 312))
    along = (far - near) * (1, 1, 0)
    along /= np.linalg.norm(along)
    out = np.cross((0, 0, 1), along)
    out *= np.sign((view.camera.centre - near) @ out)
    corner = near + 0.04 * out
    corner[2] = empty_street().place(8, (near - view.camera.centre) @ view.camera.world_to_camera[2, :3], -6)[0][2]
    return GlassFront(corner, along, out, (6.0, 3.4))


def cases() -> dict[str, Case]:
    """All cases, by name."""
    glass = glass_front()
    passer = glass.corner + 1.2 * glass.along + 1.0 * glass.out
    return {
        "border": Case(
            "a bus beside the path, cut by the border of the image in all frames", range(8, 16),
            (Staged(box(8, 2.2, -3.4, (13.0, 2.5, 3.0)), "bus", 1),), 11,
        ),
        "huge": Case(
            "a lorry ahead that fills more than half of the image in the end", range(8, 17),
            (Staged(box(16, 2.6, 0.3, (7.0, 2.5, 3.4)), "truck", 1),), 15,
        ),
        "overlapping": Case(
            "two cars, the nearer one goes, the one that it partly hides stays", range(8, 17),
            (
                Staged(car(8, 14.0, -2.6, 1), "car", 1),
                Staged(car(8, 20.0, -3.0, 2), "car", 2, goes=False),
            ), 11, by_instance=True,
        ),
        "overlapping, behind": Case(
            "two cars, the one that is partly hidden goes, the nearer one stays", range(8, 17),
            (
                Staged(car(8, 14.0, -2.6, 1), "car", 1, goes=False),
                Staged(car(8, 20.0, -3.0, 2), "car", 2),
            ), 11, by_instance=True,
        ),
        "glass": Case(
            "a person before a glass front, which mirrors the street", range(1, 11), (Staged(Person(passer), "person", 1),),
            6, glass,
        ),
        "whole frame": Case(
            "a lorry ahead that fills the whole last image", range(8, 17),
            (Staged(box(16, 0.8, 0.0, (7.0, 2.6, 3.4)), "truck", 1),), 16,
        ),
        "passing": Case(
            "a bus close before the camera in one frame only, which it fills", range(8, 17),
            (Staged(box(12, 0.9, 0.0, (2.5, 9.0, 3.4)), "bus", 1, frames=frozenset({12})),), 12,
        ),
        "few frames": Case(
            "a car beside the start, seen in the first frames only", range(8, 18), (Staged(car(8, 5.0, -3.2, 3), "car", 1),), 8
        ),
        "speck": Case(
            "a car of which one frame shows a few pixels", range(8, 17),
            (Staged(car(8, 1.45, -3.3, 3), "car", 1),), 8,
        ),
        "no surroundings": Case(
            "lorries along the whole right side: the hole reaches the border and no view shows what lies beyond it",
            range(8, 16),
            tuple(Staged(box(8 + 6 * k, -3.0, -3.6, (6.7, 2.4, 3.3)), "truck", k + 1) for k in range(4)), 10,
        )
    }


def measure(case: Case, drive: Path, workspace: Path) -> dict[str, Any]:
    """Run a case and hold what came out against the truth."""
    for folder in (drive, workspace):
        shutil.rmtree(folder, ignore_errors=True)
    stage(drive, case.frames, case.objects, case.glass)
    begun = time.perf_counter()
    run(drive, workspace, case.settings(), until="deliver")
    seconds = time.perf_counter() - begun
    measured = run_evaluation(workspace)
    methods = measured["truth"]["regions"]["removed"]["methods"]
    sums: dict[str, list[tuple[float, float, int]]] = {}
    changed = black = gone_pixels = bare = bare_unchanged = 0
    largest, worst = 0.0, (1.0, "")
    for number in case.frames:
        name = f"{number:04d}.png"
        photograph, true = read_image(drive / "images" / name), read_image(drive / "truth" / "images" / name)
        clean = read_image(next((workspace / "frames").rglob(name)))
        gone = read_label_image(drive / "truth" / "removed" / name) > 127
        kept = read_label_image(drive / "truth" / "kept" / name) > 127
        error, similar = squared_error(clean, true), ssim_map(clean, true)
        differs = (clean != photograph).any(axis=2)
        for region, mask in (
            ("gone", gone), ("beside", ~gone), ("beside, changed", differs & ~gone),
            ("kept, behind what goes", kept & gone), ("kept, seen", kept & ~gone)
        ):
            sums.setdefault(region, []).append((error[mask].sum(), similar[mask].sum(), int(mask.sum())))
        changed += int((differs & ~gone).sum())
        black += int(((clean < BLACK).all(axis=2) & ~(true < BLACK).all(axis=2) & gone).sum())
        gone_pixels += int(gone.sum())
        largest = max(largest, float(gone.mean()))
        if gone.any():
            worst = min(worst, (float(similar[gone].mean()), str(number)))
        else:
            bare, bare_unchanged = bare + 1, bare_unchanged + (not differs.any())
    pixels = sum(p for *_, p in sums["beside"])
    return {
        "what": case.what,
        "frames": len(case.frames),
        "seconds": round(seconds, 1),
        "largest_share_of_a_frame": round(largest, 3),
        "regions": {name: _figures(parts) for name, parts in sums.items() if sum(p for *_, p in parts)},
        "details_in_the_gone_region": {k: methods["ours"].get(k) for k in DETAIL_FIGURES},
        "others_in_the_gone_region": {m: {k: v.get(k) for k in FIGURES} for m, v in methods.items() if m != "ours"},
        "changed_beside_share": round(changed / max(1, pixels), 5),
        "untouched": measured["untouched"],
        "black_pixels_in_the_gone_region": black,
        "frames_without_it": bare,
        "of_these_unchanged": bare_unchanged,
        "frame_of_least_ssim": worst[1],
    }


def _figures(parts: list[tuple[float, float, int]]) -> dict[str, float | int | None]:
    squared, similar, pixels = (sum(p[k] for p in parts) for k in range(3))
    decibels = psnr_of_mse(squared / pixels)
    return {
        "psnr": None if not np.isfinite(decibels) else round(decibels, 2),
        "ssim": round(similar / pixels, 4),
        "pixels": int(pixels),
    }


def picture(case: Case, drive: Path, workspace: Path) -> np.ndarray:
    """A row of the strip: input, clean frame, truth."""
    name = f"{case.shown:04d}.png"
    files = (drive / "images" / name, next((workspace / "frames").rglob(name)), drive / "truth" / "images" / name)
    return np.hstack([np.pad(read_image(f), ((2, 2), (2, 2), (0, 0)), constant_values=255) for f in files])


def nothing_chosen(drive: Path, folder: Path) -> dict[str, str]:
    """What is said where the choice is of nothing that any frame shows."""
    said = {}
    for name, settings in (
        ("a class that does not occur", RunSettings(remove=("train",))),
        ("an instance that does not occur", RunSettings(instances=(99,))),
    ):
        try:
            run(drive, folder / "nothing", settings)
            said[name] = "no error"
        except UnveilError as error:
            said[name] = str(error)
        assert not (folder / "nothing").exists()
    return said


def main() -> None:
    """Measure all cases, or those named on the command line."""
    every = cases()
    names = sys.argv[1:] or list(every)
    measured = json.loads(RESULTS.read_text()) if RESULTS.is_file() else {"machine": {}, "cases": {}}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(os.environ.get("UNVEIL_KEEP", temporary))
        for name in names:
            drive, workspace = folder / name.replace(" ", "_") / "drive", folder / name.replace(" ", "_") / "workspace"
            row = measure(every[name], drive, workspace)
            measured["cases"][name] = row
            measured["nothing_chosen"] = nothing_chosen(drive, folder)
            write_json_atomic(RESULTS, {**measured, "machine": machine()})
            shown = ("seconds", "regions", "details_in_the_gone_region", "black_pixels_in_the_gone_region")
            print(name, *(row[key] for key in shown), flush=True)
        homes = [folder / n.replace(" ", "_") for n in every]
        if all((home / "workspace").is_dir() for home in homes):
            rows = [picture(c, h / "drive", h / "workspace") for c, h in zip(every.values(), homes, strict=True)]
            strip = cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR)
            small = cv2.resize(strip, None, fx=0.75, fy=0.75, interpolation=cv2.INTER_AREA)
            cv2.imwrite(str(RESULTS.with_suffix(".jpg")), small, [cv2.IMWRITE_JPEG_QUALITY, 82])


if __name__ == "__main__":
    main()
