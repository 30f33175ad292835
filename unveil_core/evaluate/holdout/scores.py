"""The restored street behind the virtual cars against the photographs: errors, flicker, and pictures to look at."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from unveil_core.base.files import write_image_atomic
from unveil_core.base.frame_cache import subset
from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float32, Mask, Picture
from unveil_core.delivery.lens import work_positions
from unveil_core.drives.drive import Drive, Frame
from unveil_core.evaluate.baselines import BASELINES, with_border, with_neighbours
from unveil_core.evaluate.delivered import read_delivered
from unveil_core.evaluate.detail.lines import find_edges, match_lines
from unveil_core.evaluate.detail.scores import SPECTRUM_FIGURES, DetailScore, detail_figures
from unveil_core.evaluate.detail.spectrum import Spectrum
from unveil_core.evaluate.flicker import DepthGrid, measure_flicker
from unveil_core.evaluate.holdout.placement import CarPixels, SceneView
from unveil_core.evaluate.holdout.virtual_cars import VirtualCar
from unveil_core.evaluate.metrics import SSIM_WINDOW, gradient, psnr_of_mse, rounded, squared_error, ssim_map
from unveil_core.evaluate.pictures import fitted, workspace_mask
from unveil_core.geometry.images import border_px, grow
from unveil_core.workspace.files import frame_file

__all__ = ["HoldoutFrame", "References", "measure_holdout", "write_strips"]

References = Mapping[str, Callable[[Picture], Picture]]
"""By name, what further methods make of a photograph (H, W, 3), to be measured inside the cars beside what was delivered."""

STRIP_METHODS = ("ours", "shift_map")
GAP_PX = 4


@dataclass(frozen=True, eq=False)
class HoldoutFrame:
    """One frame of the check.

    Attributes:
        frame: of the original drive, whose photograph is the truth.
        view: the real scene in it; cars: the virtual cars in it.
        removed: (H, W) what is really removed there.
        elsewhere: (H, W) of the cars' pixels those behind which another frame shows the street.
        ground: (H, W) of the cars' pixels those behind which the photograph shows the ground; None where no ground is known.
    """

    frame: Frame
    view: SceneView
    cars: CarPixels
    removed: Mask
    elsewhere: Mask
    ground: Mask | None = None

    @property
    def region(self) -> Mask:
        """(H, W) pixels of the cars behind which the photograph shows the empty street."""
        return (self.cars.number > 0) & ~self.view.excluded


def measure_holdout(
    frames: Sequence[HoldoutFrame],
    cars: Sequence[VirtualCar],
    drive: Drive,
    root: Path,
    *,
    references: References | None = None,
    progress: Progress = no_progress,
) -> dict[str, Any]:
    """Compare what was delivered for the drive with virtual cars with the real photographs.

    Args:
        frames: all frames of the drive, asked for one by one; cars: the cars in them.
        drive: with the cars, as imported; root: its workspace, up to ``frames/``.
        references: further methods.
    Returns:
        a JSON-able dict. ``regions`` (removed, unseen, seen_elsewhere) have ``pixels`` and per method of ``methods``
        ``psnr`` (of the pooled error), ``ssim`` (over the pooled pixels) and ``frames``. ``cars`` has each car's
        place (metres along and left of the path), frames, pixels and PSNR by method. ``flicker`` is as of
        :func:`unveil_core.evaluate.flicker.measure_flicker`, the photographs themselves as ``truth``.
        ``gradient`` has per method the mean gradient inside the cars as a share of the photographs', ``spectrum_4px`` and
        so on that of the bands of the spectrum (see :mod:`unveil_core.evaluate.detail.spectrum`), ``line_recall`` the share of
        the photographs' lines on the ground that were found there, and ``false_lines`` the share of the method's that are
        at no edge of the photographs (see :mod:`unveil_core.evaluate.detail.lines`); None where there are none.
        ``full_size``, where the footage is larger than the working size, has PSNR and gradient of the delivered frames against
        it, and how many pixels changed elsewhere. ``unobserved_mask_iou`` compares the workspace's masks of unobserved pixels
        with what really no frame shows. ``outside`` has the share of ``changed`` pixels and their ``mean`` change (levels of
        255) beyond cars, removed objects and their shadows, where nothing should.
    """
    shown = [i for i, f in enumerate(frames) if f.region.any()]
    with_baselines = with_neighbours(shown)
    sums: dict[tuple[str, str], list[float]] = defaultdict(lambda: [0.0, 0.0, 0.0, 0.0])
    filled: dict[Frame, dict[str, Picture]] = {}
    textures: dict[str, list[DetailScore]] = defaultdict(list)
    lines: dict[str, list[DetailScore]] = defaultdict(list)
    references = references or {}
    full = _FullSize()
    both = either = changed = outside = 0
    change = 0.0
    for done, i in enumerate(shown):
        held = frames[i]
        photograph = read_image(held.frame.image_path)
        if i in with_baselines:
            filled[held.frame] = _baselines(held, read_image(drive.frames[i].image_path))
        pictures = _pictures(held, root, photograph, filled, references)
        regions = {"removed": held.region, "seen_elsewhere": held.region & held.elsewhere}
        regions["unseen"] = held.region & ~held.elsewhere
        regions |= {f"car {car.number}": held.region & (held.cars.number == car.number) for car in cars}
        for method, picture in pictures.items():
            _add(sums, method, regions, picture, photograph)
        for method, score in _textures(held, pictures, photograph).items():
            textures[method].append(score)
        for method, score in _lines(held, pictures, photograph).items():
            lines[method].append(score)
        if held.frame.footage is not None:
            _add_full_size(full, held, root)
        unobserved = workspace_mask(root / "masks/unobserved", held.frame, held.removed.shape)
        if unobserved is not None:
            both += int((unobserved & regions["unseen"]).sum())
            either += int(((unobserved & held.region) | regions["unseen"]).sum())
        margin = 2 * border_px(photograph.shape[1])
        elsewhere = ~grow((held.cars.number > 0) | held.view.excluded, margin)
        difference = np.abs(pictures["ours"][elsewhere].astype(np.int16) - photograph[elsewhere])
        outside, changed = outside + len(difference), changed + int((difference > 0).any(axis=1).sum())
        change += float(difference.mean(axis=1).sum())
        progress(done + 1, len(shown), "comparing with the photographs")
    real = [f.frame for f in frames]
    order, with_region = {frame: i for i, frame in enumerate(real)}, set(shown)

    def depth_of(frame: Frame) -> DepthGrid:
        depth = frames[order[frame]].view.depth
        return DepthGrid(frame.camera, np.where(np.isfinite(depth), depth, 0))

    def pictures_of(frame: Frame) -> dict[str, Picture]:
        photograph = read_image(frame.image_path)
        return {"truth": photograph} | _pictures(frames[order[frame]], root, photograph, filled, references)

    flicker = measure_flicker(
        real,
        depth_of,
        lambda f: frames[order[f]].region if order[f] in with_region else None,
        pictures_of,
        progress,
    )
    return {
        "frames": len(shown),
        "cars": [_of_car(car, subset(frames, shown), sums, references) for car in cars],
        "regions": {
            region: {"pixels": int(sums[region, "ours"][2]), "methods": _methods(sums, region, references)}
            for region in ("removed", "unseen", "seen_elsewhere")
            if sums[region, "ours"][2]
        },
        "unobserved_mask_iou": round(both / either, 4) if either else None,
        "outside": {
            "changed": round(changed / max(outside, 1), 5),
            "mean": round(change / max(changed, 1), 2),
        },
        **{
            name: rounded({method: detail_figures(scores)[name] for method, scores in of.items()})
            for names, of in ((("gradient", *SPECTRUM_FIGURES), textures), (("line_recall", "false_lines"), lines))
            for name in names
        },
        **_of_full_size(full),
        "flicker": rounded(flicker),
    }


def _textures(held: HoldoutFrame, pictures: Mapping[str, Picture], photograph: Picture) -> dict[str, DetailScore]:
    """By method, gradient and spectrum inside the cars of a frame, without the seam, which is no texture."""
    inside = ~grow(~held.region, 1)
    spectrum = Spectrum(inside)
    true_slope, true_energies = float(gradient(photograph)[inside].sum()), spectrum.energies(photograph)
    found = {}
    for method, picture in pictures.items():
        slope, energies = float(gradient(picture)[inside].sum()), spectrum.energies(picture)
        found[method] = DetailScore(0, slope, true_slope, 0, 0, 0, 0, 0, *energies, *true_energies)
    return found


def _lines(held: HoldoutFrame, pictures: Mapping[str, Picture], photograph: Picture) -> dict[str, DetailScore]:
    """By method, pixels of lines on the ground inside the cars: of a frame, without the seam, which is no line."""
    if held.ground is None:
        return {}
    where = held.ground & ~grow(~held.region, 1)
    truth, found = find_edges(photograph), {}
    for method, picture in pictures.items():
        match = match_lines(truth, find_edges(picture), where)
        counts = (int(np.count_nonzero(m)) for m in (match.found, match.missed, match.right, match.false))
        found[method] = DetailScore(0, 0.0, 0.0, *counts)
    return found


@dataclass
class _FullSize:
    """Sums over the delivered frames against their footage: inside the cars the squared error, in levels, the gradients of both and
    the pixels; outside, the pixels that changed."""

    squared: float = 0.0
    gradient: float = 0.0
    true_gradient: float = 0.0
    pixels: int = 0
    changed: int = 0


def _add_full_size(full: _FullSize, held: HoldoutFrame, root: Path) -> None:
    """Add a frame."""
    footage = held.frame.footage
    assert footage is not None
    delivered, truth = read_image(frame_file(root / "frames", held.frame)), read_image(footage.path)
    at = work_positions(footage, held.frame.camera) - 0.5

    def enlarged(mask: Mask) -> Float32:
        return cv2.remap(mask.astype(np.float32), at[..., 0], at[..., 1], cv2.INTER_LINEAR)

    inside = enlarged(held.region) >= 1
    full.squared += float(((delivered[inside].astype(np.float64) - truth[inside]) ** 2).mean(axis=1).sum())
    full.gradient += float(gradient(delivered)[inside].sum())
    full.true_gradient += float(gradient(truth)[inside].sum())
    full.pixels += int(inside.sum())
    margin = 2 * border_px(held.frame.camera.width)
    outside = enlarged(grow((held.cars.number > 0) | held.view.excluded, margin)) == 0
    full.changed += int((delivered[outside] != truth[outside]).any(axis=1).sum())


def _of_full_size(full: _FullSize) -> dict[str, Any]:
    """The figures of :func:`_add_full_size`; none where the footage is no larger than the working size."""
    if not full.pixels:
        return {}
    figures = {
        "psnr": psnr_of_mse(full.squared / full.pixels / 255**2),
        "gradient": full.gradient / max(full.true_gradient, 1e-9),
        "changed_pixels": full.changed,
    }
    return {"full_size": rounded(figures)}


def _pictures(
    held: HoldoutFrame,
    root: Path,
    photograph: Picture,
    filled: Mapping[Frame, Mapping[str, Picture]],
    references: References,
) -> dict[str, Picture]:
    """What each method shows in place of the cars."""
    pictures = {"ours": read_delivered(root, held.frame)}
    render_path = frame_file(root / "renders", held.frame)
    if render_path.is_file():
        pictures["render"] = fitted(read_image(render_path), photograph.shape)
    hole = _hole(held)
    for name, colors in filled.get(held.frame, {}).items():
        pictures[name] = photograph.copy()
        pictures[name][hole] = colors
    for name, made in references.items():
        pictures[name] = np.where(held.region[..., None], made(photograph), photograph)
    return pictures


def _hole(held: HoldoutFrame) -> Mask:
    """(H, W) what the single-image methods fill: really removed objects too, or they would be continued into the hole."""
    return with_border((held.cars.number > 0) | held.removed)


def _baselines(held: HoldoutFrame, painted: Picture) -> dict[str, Picture]:
    """(M, 3) colours of the filled pixels by method, from the photograph with the cars in it."""
    hole = _hole(held)
    return {name: fill(painted, (held.cars.number > 0) | held.removed)[hole] for name, fill in BASELINES.items()}


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


def _methods(sums: Mapping[tuple[str, str], list[float]], region: str, references: References) -> dict[str, Any]:
    return {
        method: rounded({"psnr": psnr_of_mse(e / n), "ssim": s / n, "frames": int(count)})
        for method in ("ours", "render", *BASELINES, *references)
        for e, s, n, count in [sums.get((region, method), [0, 0, 0, 0])]
        if n
    }


def _of_car(
    car: VirtualCar,
    shown: Sequence[HoldoutFrame],
    sums: Mapping[tuple[str, str], list[float]],
    references: References,
) -> dict[str, Any]:
    methods = _methods(sums, f"car {car.number}", references)
    names = [f.frame.name for f in shown if (f.region & (f.cars.number == car.number)).any()]
    return {
        "number": car.number,
        "along_m": round(car.s, 2),
        "left_m": round(car.t, 2),
        "first_frame": names[0] if names else None,
        "last_frame": names[-1] if names else None,
        "pixels": int(sums.get((f"car {car.number}", "ours"), [0, 0, 0, 0])[2]),
        "psnr": {method: values["psnr"] for method, values in methods.items()},
    }


# ----------------------------------------------------------------------------------------------------------------- pictures


def write_strips(
    frames: Sequence[HoldoutFrame], cars: Sequence[VirtualCar], drive: Drive, root: Path, folder: Path, each: int = 2
) -> list[Path]:
    """Pictures side by side, photograph, with the cars, delivered, and filled by shift-map, of the frames that show most.

    Args:
        each: number of frames per car: the one where it is largest, where it has half of that area, and so on.
    """
    chosen: dict[int, None] = {}
    for car in cars:
        areas = np.array([int((f.region & (f.cars.number == car.number)).sum()) for f in frames])
        for k in range(each):
            chosen[int(np.abs(areas - areas.max() / 2**k).argmin())] = None
    paths = []
    for i in sorted(chosen):
        held = frames[i]
        photograph, painted = read_image(held.frame.image_path), read_image(drive.frames[i].image_path)
        pictures = _pictures(held, root, photograph, {held.frame: _baselines(held, painted)}, {})
        shown = [photograph, painted, *(pictures[m] for m in STRIP_METHODS)]
        gap = np.full((photograph.shape[0], GAP_PX, 3), 255, dtype=np.uint8)
        strip = np.concatenate([part for picture in shown for part in (picture, gap)][:-1], axis=1)
        paths.append(folder / f"{held.frame.camera_name}_{held.frame.name}.png")
        write_image_atomic(paths[-1], strip)
    return paths
