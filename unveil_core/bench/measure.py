"""Delivered frames against the true empty street."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.types import Mask, Picture
from unveil_core.drives.drive import Drive, Frame
from unveil_core.evaluate.detail.scores import DetailScore, StreetDetail, detail_figures
from unveil_core.evaluate.flicker import DepthGrid, measure_flicker, read_depth
from unveil_core.evaluate.metrics import SSIM_WINDOW, psnr_of_mse, rounded, squared_error, ssim_map
from unveil_core.evaluate.pictures import REGIONS, fitted, regions_of, truth_file

__all__ = ["FILM_FIGURES", "FilmFigure", "measure_frames"]


FilmFigure = Callable[[Drive, Sequence[Picture], Sequence[Mask]], Mapping[str, float]]
"""Figures of the delivered frames (H, W, 3) as a film, inside the removed regions (H, W), by name."""


def _flicker(drive: Drive, frames: Sequence[Picture], removed: Sequence[Mask]) -> dict[str, float]:
    """The warping error by the truth's depth, in levels of 255; nothing without that."""
    assert drive.truth_root is not None
    place = {frame: i for i, frame in enumerate(drive.frames)}
    folder = drive.truth_root / "depth"

    def depth_of(frame: Frame) -> DepthGrid | None:
        path = truth_file(folder, frame)
        return None if path is None else read_depth(path, frame.camera)

    found = measure_flicker(drive.frames, depth_of, lambda f: removed[place[f]], lambda f: {"row": frames[place[f]]})
    return {"flicker": found["methods"]["row"]["absolute"]} if found else {}


FILM_FIGURES: tuple[FilmFigure, ...] = (_flicker,)
"""What is measured of each row beside the frames one by one."""


def measure_frames(
    drive: Drive, frames: Sequence[Picture], removed: Sequence[Mask], film: Sequence[FilmFigure] | None = None
) -> dict[str, Any]:
    """Measure delivered frames, pooled over all pixels of each region.

    Args:
        drive: with a truth; frames: (H, W, 3) uint8, one per frame of the drive.
        removed: (H, W) masks of what the run removed, for where the truth has none.
        film: further figures; ``FILM_FIGURES`` by default.
    Returns:
        ``regions``: by name (see ``evaluate.pictures``) PSNR in dB, SSIM, their pixels, and in all but ``whole`` what PSNR forgives
        (see ``evaluate.detail.scores.detail_figures``); ``changed_outside``: the largest difference to the
        photographs outside the masks, which cast shadows may explain; and the film's figures.
    Raises:
        WorkspaceError: the truth shows none of the frames.
    """
    sums: dict[str, list[float]] = defaultdict(lambda: [0.0, 0.0, 0])
    details: dict[str, list[DetailScore]] = defaultdict(list)
    compared: list[Mask] = []
    outside = 0
    for frame, picture, mask_of_run in zip(drive.frames, frames, removed, strict=True):
        photograph = read_image(frame.image_path)
        change = np.abs(picture[~mask_of_run].astype(np.int16) - photograph[~mask_of_run])
        outside = max(outside, int(change.max(initial=0)))
        path = None if drive.truth_root is None else truth_file(drive.truth_root / "images", frame)
        if path is None or drive.truth_root is None:
            compared.append(mask_of_run)
            continue
        street = fitted(read_image(path), picture.shape)
        regions = regions_of(drive.truth_root, frame, picture.shape, removed=mask_of_run, unobserved=None)
        compared.append(regions["removed"])
        for name, score in (
            StreetDetail(drive.truth_root, frame, street, photograph, regions).compare(picture).scores.items()
        ):
            details[name].append(score)
        error = squared_error(picture, street)
        similar = ssim_map(picture, street) if min(picture.shape[:2]) >= SSIM_WINDOW else np.full(error.shape, np.nan)
        for name, mask in regions.items():
            entry = sums[name]
            entry[0] += float(error[mask].sum())
            entry[1] += float(similar[mask].sum())
            entry[2] += int(mask.sum())
    if not sums:
        raise WorkspaceError(
            "has no true images of the empty street to compare with",
            path=drive.truth_root or drive.root,
            mend="put them into truth/images beside the drive",
        )
    figures: dict[str, Any] = {"regions": {}, "changed_outside": outside}
    for name in REGIONS:
        squared, similarity, pixels = sums.get(name, (0.0, 0.0, 0))
        if pixels:
            figures["regions"][name] = {
                "psnr": rounded(psnr_of_mse(squared / pixels)),
                "ssim": rounded(similarity / pixels),
                **(rounded(detail_figures(details[name])) if name in details else {}),
                "pixels": pixels,
            }
    for figure in FILM_FIGURES if film is None else film:
        figures.update({name: rounded(value) for name, value in figure(drive, frames, compared).items()})
    return figures
