"""The scores of one frame of a workspace."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.types import Labels, Mask, Picture
from unveil_core.drives.drive import Frame
from unveil_core.evaluate.baselines import BASELINES, with_border
from unveil_core.evaluate.delivered import read_delivered
from unveil_core.evaluate.detail.scores import DetailScore, StreetDetail
from unveil_core.evaluate.metrics import SSIM_WINDOW, squared_error, ssim_map
from unveil_core.evaluate.perceptual import FeatureModel, LpipsModel
from unveil_core.evaluate.pictures import fitted, regions_of, truth_file, truth_mask, workspace_mask
from unveil_core.evaluate.provenance import ProvenanceScore, score_provenance
from unveil_core.geometry.images import grow
from unveil_core.semantics.labels import frame_instances
from unveil_core.workspace.files import frame_file

__all__ = ["FrameScores", "Networks", "Score", "Sources", "score_frame"]

UNTOUCHED_MARGIN_PX = 2
"""Pixels within this distance of a mask are not compared with the photograph."""


@dataclass
class Score:
    """Sums of one method over one region of one frame: squared error, structural similarity, and the number of pixels."""

    squared: float
    similarity: float
    pixels: int


@dataclass(frozen=True)
class Networks:
    """Networks that the user provides, each optional."""

    lpips: LpipsModel | None
    features: FeatureModel | None


@dataclass(frozen=True)
class Sources:
    """What all frames are measured with.

    Attributes:
        root: the workspace.
        truth: folder of the true empty street, or None.
        networks: for perceptual metrics.
        kept: ids of objects in the drive's instance images that stay in the street.
    """

    root: Path
    truth: Path | None
    networks: Networks
    kept: frozenset[int] = frozenset()


@dataclass
class FrameScores:
    """Scores and counts of one frame.

    Attributes:
        name, camera_name: of the frame; pixels: how many it has.
        removed, unobserved: pixels of the workspace's masks.
        untouched_max, untouched_sum, untouched_values: difference between delivered frame and photograph outside the masks.
        scores, details: by region and method.
        objects: pixels of the delivered frame that still show an object, and those that it and its shadow cover, by id.
        overlaps: intersection and union, pixels, of the workspace's masks with the true ones, by mask.
        seconds: per baseline, of its filling.
        filled: per baseline, (M, 3) colours of the pixels that it filled, see :func:`unveil_core.evaluate.baselines.with_border`.
        lpips: per method.
        features: per method, of its picture and of the true one.
        provenance: where its pixels come from, and how sure they are; None where the workspace does not tell.
    """

    name: str
    camera_name: str
    pixels: int
    removed: int = 0
    unobserved: int = 0
    untouched_max: int = 0
    untouched_sum: float = 0.0
    untouched_values: int = 0
    scores: dict[tuple[str, str], Score] = field(default_factory=dict)
    details: dict[tuple[str, str], DetailScore] = field(default_factory=dict)
    objects: dict[int, tuple[int, int]] = field(default_factory=dict)
    overlaps: dict[str, tuple[int, int]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    filled: dict[str, Picture] = field(default_factory=dict)
    lpips: dict[str, float] = field(default_factory=dict)
    features: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]] = field(default_factory=dict)
    provenance: ProvenanceScore | None = None


@dataclass(frozen=True, eq=False)
class _Delivery:
    """A frame as the workspace delivers it: photograph and result (H, W, 3), and its masks (H, W), None where missing."""

    frame: Frame
    photograph: Picture
    delivered: Picture
    removed: Mask | None
    shadows: Mask | None
    unobserved: Mask | None


def score_frame(sources: Sources, frame: Frame, with_baselines: bool) -> FrameScores:
    """Measure one frame, against its photograph outside the masks and against the truth where there is one.

    Args:
        with_baselines: whether the single-image baselines are run on it, too.
    Raises:
        WorkspaceError: the frame was not delivered, or in another size.
    """
    delivery = _read_delivery(sources.root, frame)
    shape = delivery.photograph.shape[:2]
    result = FrameScores(frame.name, frame.camera_name, int(np.prod(shape)))
    removed = np.zeros(shape, dtype=bool) if delivery.removed is None else delivery.removed
    result.removed = int(np.count_nonzero(removed))
    result.unobserved = 0 if delivery.unobserved is None else int(np.count_nonzero(delivery.unobserved))
    masked = removed if delivery.shadows is None else removed | delivery.shadows
    untouched = ~grow(masked, UNTOUCHED_MARGIN_PX)
    change = np.abs(delivery.delivered[untouched].astype(np.int16) - delivery.photograph[untouched])
    if change.size:
        result.untouched_max = int(change.max())
        result.untouched_sum, result.untouched_values = float(change.sum(dtype=np.int64)), change.size
    true_image = None if sources.truth is None else truth_file(sources.truth / "images", frame)
    street = None
    if sources.truth is not None and true_image is not None:
        street = fitted(read_image(true_image), shape)
        _score_against_truth(result, sources, sources.truth, delivery, street, with_baselines)
    result.provenance = score_provenance(sources.root, frame, delivery.delivered, street)
    return result


def _read_delivery(root: Path, frame: Frame) -> _Delivery:
    photograph = read_image(frame.image_path)
    delivered = read_delivered(root, frame)
    shape = photograph.shape[:2]
    removed, shadows, unobserved = (
        workspace_mask(root / "masks" / name, frame, shape) for name in ("removed", "shadows", "unobserved")
    )
    return _Delivery(frame, photograph, delivered, removed, shadows, unobserved)


def _removed_instances(frame: Frame, kept: frozenset[int]) -> Labels | None:
    """(H, W) ids of the removed objects, 0 none; None where the drive has no instance image of this frame."""
    instances = frame_instances(frame)
    return None if instances is None else np.where(np.isin(instances, list(kept)), 0, instances)


def _score_against_truth(
    result: FrameScores, sources: Sources, truth: Path, delivery: _Delivery, street: Picture, with_baselines: bool
) -> None:
    """Add to ``result`` the scores of each method against the true ``street`` (H, W, 3)."""
    frame, photograph, shape = delivery.frame, delivery.photograph, delivery.photograph.shape[:2]
    regions = regions_of(truth, frame, shape, removed=delivery.removed, unobserved=delivery.unobserved)
    region = regions.get("removed")
    pictures = {"ours": delivery.delivered, "input": photograph}
    render_path = frame_file(sources.root / "renders", frame)
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
    detail = StreetDetail(truth, frame, street, photograph, regions)
    gone = _removed_instances(frame, sources.kept)
    for method, picture in pictures.items():
        found = detail.compare(picture)
        result.details.update({(name, method): score for name, score in found.scores.items()})
        if method == "ours" and gone is not None:
            result.objects = detail.residue_by_object(found.residue, gone)
        error = squared_error(picture, street)
        similar = ssim_map(picture, street) if min(shape) >= SSIM_WINDOW else np.full(shape, np.nan)
        for name, mask in regions.items():
            count = int(np.count_nonzero(mask))
            if count:
                score = Score(float(error[mask].sum()), float(similar[mask].sum()), count)
                result.scores[name, method] = score
    networks = sources.networks
    if networks.lpips is not None:
        result.lpips = {method: networks.lpips(picture, street) for method, picture in pictures.items()}
    if networks.features is not None:
        true_features = networks.features(street)
        result.features = {m: (networks.features(picture), true_features) for m, picture in pictures.items()}
    for name, folder, ours in (
        ("unobserved", "unseen", delivery.unobserved),
        ("removed", "removed", delivery.removed),
    ):
        true = truth_mask(truth / folder, frame, shape)
        if ours is not None and true is not None:
            result.overlaps[name] = (int(np.count_nonzero(ours & true)), int(np.count_nonzero(ours | true)))
