"""A workspace measured: against the true empty street where there is one, and against itself where there is none.

Measured on the true removed region (``truth/removed``, or the workspace's own mask where the truth has none), split by
what some frame saw (``truth/unseen``, or the workspace's ``masks/unobserved``), and on cast shadows (``truth/shadow``).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import write_json_atomic
from unveil_core.base.parallel import in_context
from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.resume.checkpoint import Checkpoint, Kept
from unveil_core.base.types import Mask, Picture
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.imported import read_imported
from unveil_core.evaluate.baselines import with_border, with_neighbours
from unveil_core.evaluate.delivered import read_delivered
from unveil_core.evaluate.detail.objects import read_object_names
from unveil_core.evaluate.flicker import DepthGrid, measure_flicker, read_depth
from unveil_core.evaluate.frame_scores import FrameScores, Networks, Sources, score_frame
from unveil_core.evaluate.free_views import measure_free_views
from unveil_core.evaluate.kept_scores import scores_from_arrays, scores_to_arrays
from unveil_core.evaluate.metrics import rounded
from unveil_core.evaluate.perceptual import FeatureModel, LpipsModel
from unveil_core.evaluate.pictures import fitted, truth_file, truth_mask, workspace_mask
from unveil_core.evaluate.summary import METHODS, summary
from unveil_core.surfels.ply import read_surfels
from unveil_core.view.surface import scene_depth
from unveil_core.workspace.files import frame_file

__all__ = ["METHODS", "run_evaluation", "write_metrics"]


WORKERS = min(4, os.cpu_count() or 1)
"""Frames measured at a time; each holds a few float64 images."""
TOGETHER = 16
"""Frames whose scores are kept together: at 1920x1080 the single-image baselines take a minute for them."""


def run_evaluation(
    workspace_root: Path,
    truth_root: Path | None = None,
    progress: Progress = no_progress,
    *,
    lpips: Path | None = None,
    fid: Path | None = None,
    baselines: bool = True,
    kept: Kept | None = None,
) -> dict[str, Any]:
    """Measure the delivery of a workspace; of the workspace nothing is written.

    Args:
        workspace_root: a workspace whose ``frames/`` are there.
        truth_root: folder with ``images/<frame>.png|jpg`` of the empty street and, each optional, ``removed/``,
            ``unseen/`` and ``shadow/`` masks (255). By default the truth that the drive itself names. Truth of another
            size than the imported images is resized by area.
        progress: called once per frame.
        lpips: a network for LPIPS (see :class:`unveil_core.evaluate.perceptual.LpipsModel`), or None.
        fid: a network for FID (see :class:`unveil_core.evaluate.perceptual.FeatureModel`), or None.
        baselines: whether the single-image baselines are measured, too: they take most of the time.
        kept: where measured frames are kept, so that a call that was interrupted goes on; of the same workspace and arguments.
    Returns:
        a JSON-able dict: ``coverage``, ``untouched`` (levels of 255), ``provenance`` and ``certainty`` (see
        :func:`unveil_core.evaluate.provenance.provenance_figures`), ``per_frame`` and, with truth, ``truth`` with
        ``regions`` (removed, unseen, seen_elsewhere, cast_shadow, whole) of ``methods`` (see :data:`METHODS`), each
        with ``psnr`` (of the pooled error), ``ssim`` (over the pooled pixels), their means over frames, and the number
        of ``frames``, which is smaller for the single-image baselines of a long drive; the methods of all regions but ``whole``
        have what PSNR forgives, too (see :func:`unveil_core.evaluate.detail.scores.detail_figures`): ``gradient``,
        ``spectrum_4px`` to ``spectrum_16px``, ``line_recall``, ``false_lines``, ``residue``. ``residue_by_object`` has what is
        left of each removed object, worst first. And with a ``free/`` in the truth ``free_views`` (see
        :func:`unveil_core.evaluate.free_views.measure_free_views`). With their networks the methods of the region ``whole``
        have ``lpips``, the mean over frames, and ``fid``. ``flicker``
        is what :func:`unveil_core.evaluate.flicker.measure_flicker` finds inside the removed region, of the ``truth``
        itself too, and whose ``depth`` it was warped by: "truth" where that has ``depth/``, else the empty "scene"; without
        truth the single-image baselines are not in it. Floats are rounded to 4 digits;
        what is infinite or undefined is None.
    Raises:
        WorkspaceError: a delivered frame is missing, the truth folder shows none of the frames, instances.json is damaged, or a
            network has too little truth to work on.
        SettingsError: a file of a network that cannot be used.
    """
    workspace_root = Path(workspace_root)
    drive = read_imported(workspace_root / "drive", points=False)
    truth = Path(truth_root) if truth_root is not None else drive.truth_root
    if truth_root is not None and not (Path(truth_root) / "images").is_dir():
        raise WorkspaceError(
            "no true images here", path=Path(truth_root) / "images", mend="give a folder that contains images/"
        )
    networks = Networks(None if lpips is None else LpipsModel(lpips), None if fid is None else FeatureModel(fid))
    _check_networks(networks, drive, truth, workspace_root)
    names = read_object_names(workspace_root)
    kept = kept or Kept()
    filled = with_neighbours(range(len(drive.frames))) if baselines else set[int]()
    sources = Sources(workspace_root, truth, networks, names.kept)
    scores = _score_frames(sources, drive, filled, kept.within("scores"), progress)
    if truth_root is not None and not any(s.scores for s in scores):
        raise WorkspaceError(
            "none of the drive's frames has a true image here",
            path=Path(truth_root) / "images",
            mend="name the true images like the drive's frames",
        )
    metrics = summary(scores, names.classes)
    recorded = metrics.get("truth", {}).get("regions", {})
    by_frame = {f: s for f, s in zip(drive.frames, scores, strict=True)}
    flicker = _flicker(workspace_root, drive, truth, by_frame, kept.checkpoint("flicker"), progress)
    free = measure_free_views(workspace_root, drive, truth, recorded, progress)
    for name, found in (("flicker", flicker), ("free_views", free)):
        if found:
            metrics[name] = found
    result: dict[str, Any] = rounded(metrics)
    return result


def _check_networks(networks: Networks, drive: Drive, truth: Path | None, root: Path) -> None:
    """Whether there is as much truth as the networks need."""
    if networks.lpips is None and networks.features is None:
        return
    there = 0 if truth is None else sum(truth_file(truth / "images", f) is not None for f in drive.frames)
    if there < (1 if networks.features is None else 2):
        raise WorkspaceError(
            f"{'FID' if networks.features is not None else 'LPIPS'} needs true images of the empty street, and has {there}",
            path=root,
            mend="give a folder of them with --truth",
        )


def _score_frames(
    sources: Sources, drive: Drive, filled: set[int], kept: Kept, progress: Progress
) -> list[FrameScores]:
    """The scores of all frames, in their order.

    Args:
        filled: frames that the single-image baselines fill, too.
    """
    frames, scores = drive.frames, []
    for first in range(0, len(frames), TOGETHER):
        some = range(first, min(first + TOGETHER, len(frames)))

        def make(some: range = some) -> dict[str, NDArray[Any]]:
            results: dict[int, FrameScores] = {}
            with ThreadPoolExecutor(WORKERS) as pool:
                jobs = {pool.submit(in_context(score_frame), sources, frames[i], i in filled): i for i in some}
                try:
                    for done, job in enumerate(as_completed(jobs)):
                        results[jobs[job]] = job.result()
                        progress(some.start + done + 1, len(frames), "measuring")
                except BaseException:
                    pool.shutdown(cancel_futures=True)
                    raise
            return scores_to_arrays([results[i] for i in some])

        scores += scores_from_arrays(kept.once(f"{first:06d}", make))
    return scores


def write_metrics(metrics: dict[str, Any], path: Path) -> None:
    """Write what :func:`run_evaluation` returned as JSON, atomically."""
    write_json_atomic(path, metrics)


def _flicker(
    root: Path,
    drive: Drive,
    truth: Path | None,
    results: Mapping[Frame, FrameScores],
    checkpoint: Checkpoint,
    progress: Progress,
) -> dict[str, Any]:
    """Flicker of each method; empty where no depth of the street is known."""
    exact = truth is not None and any(truth_file(truth / "depth", f) is not None for f in drive.frames)
    if not exact and not (root / "surfels/empty.ply").is_file():
        return {}
    scene = None if exact else read_surfels(root / "surfels/empty.ply")

    def depth_of(frame: Frame) -> DepthGrid | None:
        if scene is not None:
            return DepthGrid(frame.camera, scene_depth(scene, frame.camera))
        path = None if truth is None else truth_file(truth / "depth", frame)
        return None if path is None else read_depth(path, frame.camera)

    def region_of(frame: Frame) -> Mask | None:
        shape = (frame.camera.height, frame.camera.width)
        true = None if truth is None else truth_mask(truth / "removed", frame, shape)
        return workspace_mask(root / "masks/removed", frame, shape) if true is None else true

    def pictures_of(frame: Frame) -> dict[str, Picture]:
        shape = (frame.camera.height, frame.camera.width)
        pictures = {"ours": read_delivered(root, frame)}
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

    found = measure_flicker(drive.frames, depth_of, region_of, pictures_of, progress, checkpoint)
    return {"depth": "truth" if exact else "scene", **found} if found else {}
