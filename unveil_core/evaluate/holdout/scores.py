"""The restored street behind the virtual cars against the photographs: errors, flicker, and pictures to look at."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.files import write_image_atomic
from unveil_core.base.frame_cache import subset
from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Mask, Picture
from unveil_core.drives.drive import Drive, Frame
from unveil_core.evaluate.baselines import BASELINE_FRAMES, BASELINES, with_border, with_neighbours
from unveil_core.evaluate.delivered import read_delivered
from unveil_core.evaluate.detail.scores import SPECTRUM_FIGURES, DetailScore, detail_figures
from unveil_core.evaluate.detail.spectrum import Spectrum
from unveil_core.evaluate.flicker import DepthGrid, measure_flicker
from unveil_core.evaluate.holdout.compared import LEAST_PX, Compared, PartSums, Photograph, crop_around
from unveil_core.evaluate.holdout.full_size import FullSize
from unveil_core.evaluate.holdout.placement import CarPixels, SceneView
from unveil_core.evaluate.holdout.virtual_cars import VirtualCar
from unveil_core.evaluate.metrics import rounded
from unveil_core.evaluate.perceptual import LpipsModel
from unveil_core.evaluate.pictures import fitted, workspace_mask
from unveil_core.geometry.images import border_px, grow
from unveil_core.workspace.files import frame_file

__all__ = ["PARTS", "HoldoutFrame", "References", "measure_holdout", "write_strips"]

_Sums = dict[tuple[str, str], PartSums]
"""By part, of all cars (as in :data:`PARTS`) or of one ("car 3 unseen"), and by method."""
References = Mapping[str, Callable[[Picture], Picture]]
"""By name, what further methods make of a photograph (H, W, 3), to be measured inside the cars beside what was delivered."""

PARTS = ("removed", "unseen", "seen_elsewhere")
"""Names of the parts of the cars' pixels, in the order of tables."""
LPIPS_FRAMES = 12
"""Of a car's frames, about so many evenly spaced ones are given to the network: neighbours show nearly the same crop, and one of a
quarter of the frame takes a processor a tenth of a second."""
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

    def parts(self, number: int | None = None) -> dict[str, Mask]:
        """(H, W) by name in :data:`PARTS`, of one car or of all."""
        region = self.region if number is None else self.region & (self.cars.number == number)
        return {"removed": region, "unseen": region & ~self.elsewhere, "seen_elsewhere": region & self.elsewhere}


def measure_holdout(
    frames: Sequence[HoldoutFrame],
    cars: Sequence[VirtualCar],
    drive: Drive,
    root: Path,
    *,
    references: References | None = None,
    baseline_frames: int = BASELINE_FRAMES,
    lpips: LpipsModel | None = None,
    progress: Progress = no_progress,
) -> dict[str, Any]:
    """Compare what was delivered for the drive with virtual cars with the real photographs.

    Args:
        frames: all frames of the drive, asked for one by one; cars: the cars in them.
        drive: with the cars, as imported; root: its workspace, up to ``frames/``.
        references: further methods.
        baseline_frames: about so many frames are filled by single-image inpainters, too; shift-map takes up to 20 seconds for one.
        lpips: a network, for LPIPS in crops around each car with the result pasted into the photograph.
    Returns:
        a JSON-able dict. ``regions`` (removed, unseen, seen_elsewhere) have ``pixels`` and per method of ``methods``
        ``psnr`` (of the pooled error), ``ssim`` (over the pooled pixels), ``frames``, ``gradient``, ``line_recall``,
        ``false_lines`` and ``tint`` (distance of the ground's mean colours in a* and b* of CIELAB), and with a network ``lpips``:
        of a car the mean over frames, here the mean over cars. ``cars`` has each
        car's place (metres along and left of the path), frames, pixels, PSNR by method, and its own ``regions``. ``flicker`` is
        as of :func:`unveil_core.evaluate.flicker.measure_flicker`, the photographs themselves as ``truth``.
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
    with_baselines = with_neighbours(shown, baseline_frames)
    looked_at = {} if lpips is None else _looked_at(frames, shown, cars)
    sums: _Sums = defaultdict(PartSums)
    filled: dict[Frame, dict[str, Picture]] = {}
    spectra: dict[str, list[DetailScore]] = defaultdict(list)
    references = references or {}
    full = FullSize()
    both = either = changed = outside = 0
    change = 0.0
    for done, i in enumerate(shown):
        held = frames[i]
        photograph = read_image(held.frame.image_path)
        if i in with_baselines:
            filled[held.frame] = _baselines(held, read_image(drive.frames[i].image_path))
        pictures = _pictures(held, root, photograph, filled, references)
        truth = Photograph.of(photograph, held.region, held.ground)
        compared = {method: Compared.of(truth, picture) for method, picture in pictures.items()}
        _add(sums, held, cars, compared, {n: lpips for n, of in looked_at.items() if i in of} if lpips else {})
        spectrum = Spectrum(truth.inside)
        true_energies = spectrum.energies(photograph)
        for method, picture in pictures.items():
            spectra[method].append(DetailScore(0, 0.0, 0.0, 0, 0, 0, 0, 0, *spectrum.energies(picture), *true_energies))
        touched = (held.cars.number > 0) | held.view.excluded
        if held.frame.footage is not None:
            full.add(held.frame, held.region, touched, root)
        unobserved = workspace_mask(root / "masks/unobserved", held.frame, held.removed.shape)
        if unobserved is not None:
            unseen = held.parts()["unseen"]
            both += int((unobserved & unseen).sum())
            either += int(((unobserved & held.region) | unseen).sum())
        elsewhere = ~grow(touched, 2 * border_px(photograph.shape[1]))
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

    details = {m: detail_figures(sums["removed", m].details) for part, m in sums if part == "removed"}
    lines = details if any(frames[i].ground is not None for i in shown[:1]) else {}
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
            part: {
                "pixels": sums[part, "ours"].pixels,
                "methods": _methods(sums, part, references, _mean_over_cars(sums, cars, part)),
            }
            for part in PARTS
            if (part, "ours") in sums
        },
        "unobserved_mask_iou": round(both / either, 4) if either else None,
        "outside": {
            "changed": round(changed / max(outside, 1), 5),
            "mean": round(change / max(changed, 1), 2),
        },
        **{
            name: rounded({method: found[name] for method, found in of.items()})
            for name, of in (("gradient", details), ("line_recall", lines), ("false_lines", lines))
        },
        **{
            name: rounded({method: detail_figures(scores)[name] for method, scores in spectra.items()})
            for name in SPECTRUM_FIGURES
        },
        **full.figures(),
        "flicker": rounded(flicker),
    }


def _looked_at(frames: Sequence[HoldoutFrame], shown: Sequence[int], cars: Sequence[VirtualCar]) -> dict[int, set[int]]:
    """By number of a car, the frames of which the network gets a crop around it."""
    found: dict[int, set[int]] = {}
    areas = [np.bincount(f.cars.number[f.region], minlength=len(cars) + 1) for f in subset(frames, shown)]
    for car in cars:
        own = [i for i, area in zip(shown, areas, strict=True) if area[car.number] >= LEAST_PX]
        found[car.number] = set(own[:: max(1, math.ceil(len(own) / LPIPS_FRAMES))])
    return found


def _add(
    sums: _Sums,
    held: HoldoutFrame,
    cars: Sequence[VirtualCar],
    compared: Mapping[str, Compared],
    lpips: Mapping[int, LpipsModel],
) -> None:
    """Add a frame: all cars together, and each of them, by part and method; lpips: by number of the cars that it looks at here."""
    for part, mask in held.parts().items():
        for method, one in compared.items() if mask.any() else ():
            sums[part, method].add(one, mask)
    for car in cars:
        parts = held.parts(car.number)
        if not parts["removed"].any():
            continue
        around, network = crop_around(parts["removed"]), lpips.get(car.number)
        for method, one in compared.items():
            for part, mask in parts.items():
                if mask.any():
                    # What is rendered is not what is delivered.
                    asked = network is not None and method != "render" and np.count_nonzero(mask) >= LEAST_PX
                    distance = network(*one.crop(mask, around)) if network is not None and asked else None
                    sums[f"car {car.number} {part}", method].add(one, mask, distance)


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


def _methods(sums: _Sums, name: str, references: References, distances: Mapping[str, float]) -> dict[str, Any]:
    """Figures by method of a part, by its name in ``sums``; distances: LPIPS by method, where it is no mean over frames."""
    return {
        method: sums[name, method].figures(distances.get(method))
        for method in ("ours", "render", *BASELINES, *references)
        if (name, method) in sums
    }


def _mean_over_cars(sums: _Sums, cars: Sequence[VirtualCar], part: str) -> dict[str, float]:
    """LPIPS by method: the mean over the cars that have one."""
    of_cars: dict[str, list[float]] = defaultdict(list)
    names = {f"car {car.number} {part}" for car in cars}
    for (name, method), found in sums.items():
        if name in names and found.distances:
            of_cars[method].append(found.lpips)
    return {method: sum(values) / len(values) for method, values in of_cars.items()}


def _of_car(car: VirtualCar, shown: Sequence[HoldoutFrame], sums: _Sums, references: References) -> dict[str, Any]:
    by_part = ((part, f"car {car.number} {part}") for part in PARTS)
    parts: dict[str, dict[str, Any]] = {
        part: {"pixels": sums[name, "ours"].pixels, "methods": _methods(sums, name, references, {})}
        for part, name in by_part
        if (name, "ours") in sums
    }
    names = [f.frame.name for f in shown if (f.region & (f.cars.number == car.number)).any()]
    whole = parts.get("removed", {"pixels": 0, "methods": {}})
    return {
        "number": car.number,
        "along_m": round(car.s, 2),
        "left_m": round(car.t, 2),
        "first_frame": names[0] if names else None,
        "last_frame": names[-1] if names else None,
        "pixels": whole["pixels"],
        "psnr": {method: values["psnr"] for method, values in whole["methods"].items()},
        "regions": parts,
    }


# ----------------------------------------------------------------------------------------------------------------- pictures


def write_strips(
    frames: Sequence[HoldoutFrame],
    cars: Sequence[VirtualCar],
    drive: Drive,
    root: Path,
    folder: Path,
    each: int = 2,
    methods: Sequence[str] = STRIP_METHODS,
) -> list[Path]:
    """Pictures side by side, photograph, with the cars, delivered, and filled by shift-map, of the frames that show most.

    Args:
        each: number of frames per car: the one where it is largest, where it has half of that area, and so on.
        methods: shown beside photograph and cars.
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
        filled = {held.frame: _baselines(held, painted)} if set(methods) & set(BASELINES) else {}
        pictures = _pictures(held, root, photograph, filled, {})
        shown = [photograph, painted, *(pictures[m] for m in methods)]
        gap = np.full((photograph.shape[0], GAP_PX, 3), 255, dtype=np.uint8)
        strip = np.concatenate([part for picture in shown for part in (picture, gap)][:-1], axis=1)
        paths.append(folder / f"{held.frame.camera_name}_{held.frame.name}.png")
        write_image_atomic(paths[-1], strip)
    return paths
