"""A workspace measured: against the true empty street where there is one, and against itself where there is none.

Measured on the true removed region (``truth/removed``, or the workspace's own mask where the truth has none), split by
what some frame saw (``truth/unseen``, or the workspace's ``masks/unobserved``), and on cast shadows (``truth/shadow``).
"""

from __future__ import annotations

import math
import os
import time
from collections import defaultdict
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import read_image, write_json_atomic
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Mask, Picture
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.imported import read_imported
from unveil_core.drives.scale import FAR_M, NEAR_M
from unveil_core.evaluate.baselines import BASELINES, with_border
from unveil_core.evaluate.flicker import DepthGrid, measure_flicker, read_depth, rendered_depth
from unveil_core.evaluate.free_views import measure_free_views
from unveil_core.evaluate.metrics import SSIM_WINDOW, psnr_of_mse, squared_error, ssim_map
from unveil_core.evaluate.perceptual import FeatureModel, LpipsModel, frechet_distance
from unveil_core.evaluate.pictures import REGIONS, fitted, own_mask, regions_of, truth_file, truth_mask
from unveil_core.geometry.images import grow
from unveil_core.surfels.ply import read_surfels
from unveil_core.workspace.files import frame_file

__all__ = ["METHODS", "run_evaluation", "write_metrics"]


METHODS: dict[str, str] = {
    "ours": "Unveil", "render": "Unveil, rendered", "input": "input, untouched", "telea": "Telea",
    "shift_map": "shift-map",
}  # fmt: skip
"""Keys of the measured methods and how people call them."""

UNTOUCHED_MARGIN_PX = 2
BASELINE_FRAMES = 40
"""Single-image filling takes seconds a frame: of longer drives, so many evenly spaced frames are filled."""
WORKERS = min(4, os.cpu_count() or 1)


@dataclass
class _Score:
    """Sums of one method over one region of one frame."""

    squared: float
    similarity: float
    pixels: int


@dataclass(frozen=True)
class _Networks:
    """The user's own, each optional."""

    lpips: LpipsModel | None
    features: FeatureModel | None


@dataclass
class _FrameResult:
    """What one frame contributes."""

    name: str
    camera_name: str
    pixels: int
    removed: int = 0
    unobserved: int = 0
    untouched_max: int = 0
    untouched_sum: float = 0.0
    untouched_values: int = 0
    scores: dict[tuple[str, str], _Score] = field(default_factory=dict)
    overlaps: dict[str, tuple[int, int]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    filled: dict[str, Picture] = field(default_factory=dict)
    """Per baseline: (M, 3) colours of the pixels that it filled, see :func:`_hole`."""
    lpips: dict[str, float] = field(default_factory=dict)
    features: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]] = field(default_factory=dict)
    """Per method: of its picture and of the true one."""


def run_evaluation(
    workspace_root: Path,
    truth_root: Path | None = None,
    progress: Progress = no_progress,
    *,
    lpips: Path | None = None,
    fid: Path | None = None,
) -> dict[str, Any]:
    """Measure the delivery of a workspace; nothing is written.

    Args:
        workspace_root: a workspace whose ``frames/`` are there.
        truth_root: folder with ``images/<frame>.png|jpg`` of the empty street and, each optional, ``removed/``,
            ``unseen/`` and ``shadow/`` masks (255). By default the truth that the drive itself names. Truth of another
            size than the imported images is resized by area.
        progress: called once per frame.
        lpips: a network for LPIPS (see :class:`unveil_core.evaluate.perceptual.LpipsModel`), or None.
        fid: a network for FID (see :class:`unveil_core.evaluate.perceptual.FeatureModel`), or None.
    Returns:
        a JSON-able dict: ``coverage``, ``untouched`` (levels of 255), ``per_frame`` and, with truth, ``truth`` with
        ``regions`` (removed, unseen, seen_elsewhere, cast_shadow, whole) of ``methods`` (see :data:`METHODS`), each
        with ``psnr`` (of the pooled error), ``ssim`` (over the pooled pixels), their means over frames, and the number
        of ``frames``, which is smaller for the single-image baselines of a long drive; and with a ``free/`` in the truth
        ``free_views`` (see :func:`unveil_core.evaluate.free_views.measure_free_views`). With their networks the methods
        of the region ``whole`` have ``lpips``, the mean over frames, and ``fid``. ``flicker``
        is what :func:`unveil_core.evaluate.flicker.measure_flicker` finds inside the removed region, of the ``truth``
        itself too, and whose ``depth`` it was warped by: "truth" where that has ``depth/``, else the empty "scene"; without
        truth the single-image baselines are not in it. Floats are rounded to 4 digits;
        what is infinite or undefined is None.
    Raises:
        WorkspaceError: a delivered frame is missing, the truth folder shows none of the frames, or a network has too
            little truth to work on.
        SettingsError: a file of a network that cannot be used.
    """
    workspace_root = Path(workspace_root)
    drive = read_imported(workspace_root / "drive")
    truth = Path(truth_root) if truth_root is not None else drive.truth_root
    if truth_root is not None and not (Path(truth_root) / "images").is_dir():
        raise WorkspaceError(
            "no true images here", path=Path(truth_root) / "images", mend="give a folder that contains images/"
        )
    networks = _Networks(None if lpips is None else LpipsModel(lpips), None if fid is None else FeatureModel(fid))
    if lpips is not None or fid is not None:
        there = 0 if truth is None else sum(truth_file(truth / "images", f) is not None for f in drive.frames)
        if there < (1 if fid is None else 2):
            raise WorkspaceError(
                f"{'FID' if fid is not None else 'LPIPS'} needs true images of the empty street, and has {there}",
                path=workspace_root, mend="give a folder of them with --truth",
            )  # fmt: skip
    results: list[_FrameResult | None] = [None] * len(drive.frames)
    every = max(1, math.ceil(len(drive.frames) / BASELINE_FRAMES))
    # Two neighbours at a time, so that their flicker can be measured.
    filled = {i for i in range(len(drive.frames)) if i % (2 * every) < 2}
    with ThreadPoolExecutor(WORKERS) as pool:
        jobs = {
            pool.submit(_measure_frame, workspace_root, truth, f, i in filled, networks): i
            for i, f in enumerate(drive.frames)
        }
        try:
            for done, job in enumerate(as_completed(jobs)):
                results[jobs[job]] = job.result()
                progress(done + 1, len(drive.frames), "measuring")
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    measured = [r for r in results if r is not None]
    if truth_root is not None and not any(r.scores for r in measured):
        raise WorkspaceError(
            "none of the drive's frames has a true image here", path=Path(truth_root) / "images",
            mend="name the true images like the drive's frames",
        )  # fmt: skip
    metrics = _summary(measured)
    recorded = metrics.get("truth", {}).get("regions", {})
    flicker = _flicker(
        workspace_root, drive, truth, {f: r for f, r in zip(drive.frames, measured, strict=True)}, progress
    )
    free = measure_free_views(workspace_root, drive, truth, recorded, progress)
    for name, found in (("flicker", flicker), ("free_views", free)):
        if found:
            metrics[name] = found
    rounded: dict[str, Any] = _rounded(metrics)
    return rounded


def write_metrics(metrics: dict[str, Any], path: Path) -> None:
    """Write what :func:`run_evaluation` returned as JSON, atomically."""
    write_json_atomic(path, metrics)


# ------------------------------------------------------------------------------------------------------------ one frame


def _measure_frame(
    root: Path, truth: Path | None, frame: Frame, with_baselines: bool, networks: _Networks
) -> _FrameResult:
    photograph = read_image(frame.image_path)
    delivered_path = frame_file(root / "frames", frame)
    if not delivered_path.is_file():
        raise WorkspaceError("this frame was not delivered yet", path=delivered_path, mend="run `unveil reoptimize`")
    delivered = read_image(delivered_path)
    shape = photograph.shape[:2]
    if delivered.shape != photograph.shape:
        raise WorkspaceError(
            f"the delivered frame is {delivered.shape[1]}x{delivered.shape[0]}, the image {shape[1]}x{shape[0]}",
            path=delivered_path, mend="run `unveil reoptimize` again",
        )  # fmt: skip
    empty = np.zeros(shape, dtype=bool)
    removed = own_mask(root / "masks/removed", frame, shape)
    shadows = own_mask(root / "masks/shadows", frame, shape)
    unobserved = own_mask(root / "masks/unobserved", frame, shape)
    result = _FrameResult(frame.name, frame.camera_name, int(np.prod(shape)))
    own_removed = empty if removed is None else removed
    result.removed = int(np.count_nonzero(own_removed))
    result.unobserved = 0 if unobserved is None else int(np.count_nonzero(unobserved))
    untouched = ~grow(own_removed if shadows is None else own_removed | shadows, UNTOUCHED_MARGIN_PX)
    change = np.abs(delivered[untouched].astype(np.int16) - photograph[untouched])
    if change.size:
        result.untouched_max = int(change.max())
        result.untouched_sum, result.untouched_values = float(change.sum(dtype=np.int64)), change.size
    if truth is not None and (true_image := truth_file(truth / "images", frame)) is not None:
        _measure_against_truth(
            result, root, truth, frame, photograph, delivered, true_image, removed, unobserved, with_baselines, networks
        )
    return result


def _measure_against_truth(
    result: _FrameResult, root: Path, truth: Path, frame: Frame, photograph: Picture, delivered: Picture,
    true_image: Path, removed: Mask | None, unobserved: Mask | None, with_baselines: bool, networks: _Networks,
) -> None:  # fmt: skip
    shape = photograph.shape[:2]
    street = fitted(read_image(true_image), shape)
    true_removed = truth_mask(truth / "removed", frame, shape)
    true_unseen = truth_mask(truth / "unseen", frame, shape)
    regions = regions_of(truth, frame, shape, removed=removed, unobserved=unobserved)
    region = regions.get("removed")
    pictures = {"ours": delivered, "input": photograph}
    render_path = frame_file(root / "renders", frame)
    if render_path.is_file():
        pictures["render"] = fitted(read_image(render_path), shape)
    if with_baselines and region is not None and region.any():
        for name, fill in BASELINES.items():
            started = time.perf_counter()
            pictures[name] = fill(photograph, region)
            result.seconds[name] = time.perf_counter() - started
            result.filled[name] = pictures[name][with_border(region)]
    elif with_baselines and region is not None:
        pictures.update(dict.fromkeys(BASELINES, photograph))
        result.filled = dict.fromkeys(BASELINES, photograph[region])
    for method, picture in pictures.items():
        error = squared_error(picture, street)
        similar = ssim_map(picture, street) if min(shape) >= SSIM_WINDOW else np.full(shape, np.nan)
        for name, mask in regions.items():
            count = int(np.count_nonzero(mask))
            if count:
                score = _Score(float(error[mask].sum()), float(similar[mask].sum()), count)
                result.scores[name, method] = score
    if networks.lpips is not None:
        result.lpips = {method: networks.lpips(picture, street) for method, picture in pictures.items()}
    if networks.features is not None:
        true_features = networks.features(street)
        result.features = {m: (networks.features(picture), true_features) for m, picture in pictures.items()}
    for name, own, true in (("unobserved", unobserved, true_unseen), ("removed", removed, true_removed)):
        if own is not None and true is not None:
            result.overlaps[name] = (int(np.count_nonzero(own & true)), int(np.count_nonzero(own | true)))


# -------------------------------------------------------------------------------------------------------------- flicker


def _flicker(
    root: Path, drive: Drive, truth: Path | None, results: Mapping[Frame, _FrameResult], progress: Progress
) -> dict[str, Any]:
    """Empty where nothing says how far away the street is."""
    exact = truth is not None and any(truth_file(truth / "depth", f) is not None for f in drive.frames)
    if not exact and not (root / "surfels/empty.ply").is_file():
        return {}
    scene = None if exact else read_surfels(root / "surfels/empty.ply")

    def depth_of(frame: Frame) -> DepthGrid | None:
        if scene is not None:
            return rendered_depth(scene, frame.camera, near=NEAR_M, far=FAR_M)
        path = None if truth is None else truth_file(truth / "depth", frame)
        return None if path is None else read_depth(path, frame.camera)

    def region_of(frame: Frame) -> Mask | None:
        shape = (frame.camera.height, frame.camera.width)
        true = None if truth is None else truth_mask(truth / "removed", frame, shape)
        return own_mask(root / "masks/removed", frame, shape) if true is None else true

    def pictures_of(frame: Frame) -> dict[str, Picture]:
        shape = (frame.camera.height, frame.camera.width)
        pictures = {"ours": read_image(frame_file(root / "frames", frame))}
        if (render_path := frame_file(root / "renders", frame)).is_file():
            pictures["render"] = fitted(read_image(render_path), shape)
        if truth is not None and (true_image := truth_file(truth / "images", frame)) is not None:
            pictures["truth"] = fitted(read_image(true_image), shape)
        region = region_of(frame)
        assert region is not None
        for name, colors in results[frame].filled.items():
            pictures[name] = read_image(frame.image_path)
            pictures[name][with_border(region)] = colors
        return pictures

    found = measure_flicker(drive.frames, depth_of, region_of, pictures_of, progress)
    return {"depth": "truth" if exact else "scene", **found} if found else {}


# -------------------------------------------------------------------------------------------------------------- pooling


def _summary(results: list[_FrameResult]) -> dict[str, Any]:
    pixels = sum(r.pixels for r in results)
    removed = sum(r.removed for r in results)
    unobserved = sum(r.unobserved for r in results)
    values = sum(r.untouched_values for r in results)
    metrics: dict[str, Any] = {
        "frames": len(results),
        "coverage": {
            "removed": removed / max(pixels, 1),
            "unobserved_of_removed": unobserved / removed if removed else None,
            "seen_elsewhere_of_removed": 1 - unobserved / removed if removed else None,
        },
        "untouched": {
            "max": max((r.untouched_max for r in results), default=0),
            "mean": sum(r.untouched_sum for r in results) / max(values, 1),
            "pixels": values // 3,
        },
    }
    with_truth = [r for r in results if r.scores]
    if with_truth:
        metrics["truth"] = _truth_summary(with_truth)
    metrics["per_frame"] = [_frame_summary(r) for r in results]
    return metrics


def _truth_summary(results: list[_FrameResult]) -> dict[str, Any]:
    grouped: dict[str, dict[str, list[_Score]]] = defaultdict(lambda: defaultdict(list))
    for result in results:
        for (region, method), score in result.scores.items():
            grouped[region][method].append(score)
    regions: dict[str, Any] = {}
    for region in REGIONS:
        if region not in grouped:
            continue
        by_method = grouped[region]
        regions[region] = {
            "pixels": sum(s.pixels for s in by_method["input"]),
            "frames": len(by_method["input"]),
            "methods": {m: _pooled(by_method[m]) for m in METHODS if m in by_method},
        }
    for method, values in regions["whole"]["methods"].items():
        values.update(_perceptual(results, method))
    summary: dict[str, Any] = {"frames": len(results), "regions": regions}
    for name in ("unobserved", "removed"):
        overlaps = [r.overlaps[name] for r in results if name in r.overlaps]
        union = sum(o[1] for o in overlaps)
        if union:
            summary[f"{name}_mask_iou"] = sum(o[0] for o in overlaps) / union
    timed = {name: [r.seconds[name] for r in results if name in r.seconds] for name in BASELINES}
    summary["baseline_seconds_per_frame"] = {n: sum(s) / len(s) for n, s in timed.items() if s}
    return summary


def _perceptual(results: list[_FrameResult], method: str) -> dict[str, float]:
    """LPIPS and FID of a method, as far as there are networks for them."""
    found: dict[str, float] = {}
    distances = [r.lpips[method] for r in results if method in r.lpips]
    if distances:
        found["lpips"] = sum(distances) / len(distances)
    pairs = [r.features[method] for r in results if method in r.features]
    if pairs:
        own, true = (np.stack(features) for features in zip(*pairs, strict=True))
        found["fid"] = frechet_distance(own, true) if len(pairs) > 1 else math.nan
    return found


def _pooled(scores: list[_Score]) -> dict[str, float | int]:
    pixels = sum(s.pixels for s in scores)
    return {
        "psnr": psnr_of_mse(sum(s.squared for s in scores) / pixels),
        "psnr_frame_mean": _finite_mean(psnr_of_mse(s.squared / s.pixels) for s in scores),
        "ssim": sum(s.similarity for s in scores) / pixels,
        "ssim_frame_mean": _finite_mean(s.similarity / s.pixels for s in scores),
        "frames": len(scores),
    }


def _frame_summary(result: _FrameResult) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "frame": result.name, "camera": result.camera_name, "removed_pixels": result.removed,
        "unobserved_pixels": result.unobserved, "untouched_max": result.untouched_max,
    }  # fmt: skip
    scored = {m: result.scores["removed", m] for m in METHODS if ("removed", m) in result.scores}
    if scored:
        entry["psnr"] = {m: psnr_of_mse(s.squared / s.pixels) for m, s in scored.items()}
        entry["ssim"] = {m: s.similarity / s.pixels for m, s in scored.items()}
    return entry


def _finite_mean(values: Iterable[float]) -> float:
    """Frames that agree exactly have infinite decibels and would hide all others: the mean is over the finite ones."""
    everything = list(values)
    finite = [v for v in everything if math.isfinite(v)]
    return sum(finite) / len(finite) if finite else (everything[0] if everything else float("nan"))


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _rounded(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_rounded(v) for v in value]
    if isinstance(value, float):
        return round(value, 4) if math.isfinite(value) else None
    return value
