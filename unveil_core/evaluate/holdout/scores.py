"""What came back behind the virtual cars, against the photographs: errors, flicker, and pictures to look at."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.files import read_image, write_image_atomic
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Mask, Picture
from unveil_core.drives.drive import Drive, Frame
from unveil_core.evaluate.baselines import BASELINES, with_border
from unveil_core.evaluate.flicker import DepthGrid, measure_flicker
from unveil_core.evaluate.holdout.placement import CarPixels, Sight
from unveil_core.evaluate.holdout.virtual_cars import VirtualCar
from unveil_core.evaluate.metrics import SSIM_WINDOW, psnr_of_mse, squared_error, ssim_map
from unveil_core.evaluate.pictures import fitted, own_mask
from unveil_core.geometry.images import border_px, grow
from unveil_core.workspace.files import frame_file

__all__ = ["HoldoutFrame", "measure_holdout", "write_strips"]


BASELINE_FRAMES = 40
"""Of longer drives, so many frames are filled by the single-image methods."""
STRIP_METHODS = ("ours", "shift_map")
GAP_PX = 4


@dataclass(frozen=True, eq=False)
class HoldoutFrame:
    """One frame of the check.

    Attributes:
        frame: of the original drive, whose photograph is the truth.
        sight: what it really shows; cars: the virtual cars in it.
        removed: (H, W) what really goes there.
        elsewhere: (H, W) of the cars' pixels those whose street another frame shows.
    """

    frame: Frame
    sight: Sight
    cars: CarPixels
    removed: Mask
    elsewhere: Mask

    @property
    def region(self) -> Mask:
        """(H, W) pixels of the cars behind which the photograph shows the empty street."""
        return (self.cars.number > 0) & ~self.sight.barred


def measure_holdout(
    frames: Sequence[HoldoutFrame], cars: Sequence[VirtualCar], drive: Drive, root: Path, *,
    progress: Progress = no_progress,
) -> dict[str, Any]:  # fmt: skip
    """Compare what was delivered for the drive with virtual cars with the real photographs.

    Args:
        frames: all frames of the drive; cars: the cars in them.
        drive: with the cars, as imported; root: its workspace, up to ``frames/``.
    Returns:
        a JSON-able dict. ``regions`` (removed, unseen, seen_elsewhere) have ``pixels`` and per method of ``methods``
        ``psnr`` (of the pooled error), ``ssim`` (over the pooled pixels) and ``frames``. ``cars`` tells each car's
        place (metres along and left of the path), frames, pixels and PSNR by method. ``flicker`` is as of
        :func:`unveil_core.evaluate.flicker.measure_flicker`, the photographs themselves as ``truth``.
        ``unobserved_mask_iou`` compares the workspace's masks of what nobody saw with what nobody did see. ``outside``
        has the share of ``changed`` pixels and their ``mean`` change (levels of 255) beyond cars, removed objects and their
        shadows, where nothing should.
    """
    shown = [i for i, f in enumerate(frames) if f.region.any()]
    every = max(1, -(-len(shown) // BASELINE_FRAMES))
    # Two neighbours at a time, so that their flicker can be measured.
    with_baselines = {i for k, i in enumerate(shown) if k % (2 * every) < 2}
    sums: dict[tuple[str, str], list[float]] = defaultdict(lambda: [0.0, 0.0, 0.0, 0.0])
    filled: dict[Frame, dict[str, Picture]] = {}
    both = either = changed = outside = 0
    change = 0.0
    for done, i in enumerate(shown):
        own = frames[i]
        photograph = read_image(own.frame.image_path)
        if i in with_baselines:
            filled[own.frame] = _baselines(own, read_image(drive.frames[i].image_path))
        pictures = _pictures(own, root, photograph, filled)
        regions = {"removed": own.region, "seen_elsewhere": own.region & own.elsewhere}
        regions["unseen"] = own.region & ~own.elsewhere
        regions |= {f"car {car.number}": own.region & (own.cars.number == car.number) for car in cars}
        for method, picture in pictures.items():
            _add(sums, method, regions, picture, photograph)
        unobserved = own_mask(root / "masks/unobserved", own.frame, own.removed.shape)
        if unobserved is not None:
            both += int((unobserved & regions["unseen"]).sum())
            either += int(((unobserved & own.region) | regions["unseen"]).sum())
        margin = 2 * border_px(photograph.shape[1])
        elsewhere = ~grow((own.cars.number > 0) | own.sight.barred, margin)
        difference = np.abs(pictures["ours"][elsewhere].astype(np.int16) - photograph[elsewhere])
        outside, changed = outside + len(difference), changed + int((difference > 0).any(axis=1).sum())
        change += float(difference.mean(axis=1).sum())
        progress(done + 1, len(shown), "comparing with the photographs")
    by_frame = {f.frame: f for f in frames}
    flicker = measure_flicker(
        [f.frame for f in frames],
        lambda f: DepthGrid(f.camera, np.where(np.isfinite(by_frame[f].sight.depth), by_frame[f].sight.depth, 0)),
        lambda f: by_frame[f].region if by_frame[f].region.any() else None,
        lambda f: (
            {"truth": (photograph := read_image(f.image_path))} | _pictures(by_frame[f], root, photograph, filled)
        ),
        progress,
    )
    return {
        "frames": len(shown),
        "cars": [_of_car(car, frames, sums) for car in cars],
        "regions": {
            region: {"pixels": int(sums[region, "ours"][2]), "methods": _methods(sums, region)}
            for region in ("removed", "unseen", "seen_elsewhere") if sums[region, "ours"][2]
        },
        "unobserved_mask_iou": round(both / either, 4) if either else None,
        "outside": {
            "changed": round(changed / max(outside, 1), 5), "mean": round(change / max(changed, 1), 2),
        },
        "flicker": _rounded(flicker),
    }  # fmt: skip


def _pictures(
    own: HoldoutFrame, root: Path, photograph: Picture, filled: Mapping[Frame, Mapping[str, Picture]]
) -> dict[str, Picture]:
    """What each method shows in place of the cars."""
    pictures = {"ours": read_image(frame_file(root / "frames", own.frame))}
    render_path = frame_file(root / "renders", own.frame)
    if render_path.is_file():
        pictures["render"] = fitted(read_image(render_path), photograph.shape)
    hole = _hole(own)
    for name, colors in filled.get(own.frame, {}).items():
        pictures[name] = photograph.copy()
        pictures[name][hole] = colors
    return pictures


def _hole(own: HoldoutFrame) -> Mask:
    """(H, W) what the single-image methods fill: what really goes too, or they would continue it into the hole."""
    return with_border((own.cars.number > 0) | own.removed)


def _baselines(own: HoldoutFrame, painted: Picture) -> dict[str, Picture]:
    """(M, 3) colours of the filled pixels by method, from the photograph with the cars in it."""
    hole = _hole(own)
    return {name: fill(painted, (own.cars.number > 0) | own.removed)[hole] for name, fill in BASELINES.items()}


def _add(
    sums: dict[tuple[str, str], list[float]], method: str, regions: Mapping[str, Mask], picture: Picture, truth: Picture
) -> None:
    """Add squared errors, similarities, pixels and frames of a frame."""
    error = squared_error(picture, truth)
    similar = ssim_map(picture, truth) if min(error.shape) >= SSIM_WINDOW else np.full(error.shape, np.nan)
    for name, mask in regions.items():
        if mask.any():
            entry = sums[name, method]
            for k, value in enumerate((error[mask].sum(), similar[mask].sum(), mask.sum(), 1)):
                entry[k] += float(value)


def _methods(sums: Mapping[tuple[str, str], list[float]], region: str) -> dict[str, Any]:
    return {
        method: _rounded({"psnr": psnr_of_mse(e / n), "ssim": s / n, "frames": int(count)})
        for method in ("ours", "render", *BASELINES) for e, s, n, count in [sums.get((region, method), [0, 0, 0, 0])] if n
    }  # fmt: skip


def _of_car(
    car: VirtualCar, frames: Sequence[HoldoutFrame], sums: Mapping[tuple[str, str], list[float]]
) -> dict[str, Any]:
    methods = _methods(sums, f"car {car.number}")
    names = [f.frame.name for f in frames if (f.region & (f.cars.number == car.number)).any()]
    return {
        "number": car.number, "along_m": round(car.s, 2), "left_m": round(car.l, 2),
        "first_frame": names[0] if names else None, "last_frame": names[-1] if names else None,
        "pixels": int(sums.get((f"car {car.number}", "ours"), [0, 0, 0, 0])[2]),
        "psnr": {method: values["psnr"] for method, values in methods.items()},
    }  # fmt: skip


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _rounded(v) for k, v in value.items()}
    return (round(value, 4) if np.isfinite(value) else None) if isinstance(value, float) else value


# ----------------------------------------------------------------------------------------------------------------- pictures


def write_strips(
    frames: Sequence[HoldoutFrame], cars: Sequence[VirtualCar], drive: Drive, root: Path, folder: Path,
    each: int = 2,
) -> list[Path]:  # fmt: skip
    """Pictures side by side, photograph, with the cars, delivered, and filled by shift-map, of the frames that show most.

    Args:
        each: so many frames of each car: where it is largest, and where it has half of that.
    """
    chosen: dict[int, None] = {}
    for car in cars:
        areas = np.array([int((f.region & (f.cars.number == car.number)).sum()) for f in frames])
        for k in range(each):
            chosen[int(np.abs(areas - areas.max() / 2**k).argmin())] = None
    paths = []
    for i in sorted(chosen):
        own = frames[i]
        photograph, painted = read_image(own.frame.image_path), read_image(drive.frames[i].image_path)
        pictures = _pictures(own, root, photograph, {own.frame: _baselines(own, painted)})
        shown = [photograph, painted, *(pictures[m] for m in STRIP_METHODS)]
        gap = np.full((photograph.shape[0], GAP_PX, 3), 255, dtype=np.uint8)
        strip = np.concatenate([part for picture in shown for part in (picture, gap)][:-1], axis=1)
        paths.append(folder / f"{own.frame.camera_name}_{own.frame.name}.png")
        write_image_atomic(paths[-1], strip)
    return paths
