"""Flow-propagating video inpainting, the row of ProPainter.

Xu et al., *Deep Flow-Guided Video Inpainting* (CVPR 2019), Gao et al., *Flow-edge Guided Video Completion* (ECCV 2020) and Zhou et
al., *ProPainter* (ICCV 2023) share one idea: optical flow is completed inside the holes, known pixels are carried along it
from both directions of time, and what no frame shows is invented in one frame and carried likewise. Here the flow is OpenCV's
DIS (Kroeger et al., ECCV 2016), the completion a thin plate, the inventor the configured single-image model; a learned completion
and a transformer, which the last paper adds, need weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float32, Mask, Picture
from unveil_core.bench.rows.footage import Footage, deliver, fill_around
from unveil_core.drives.drive import tracks
from unveil_core.geometry.images import grow
from unveil_core.inpaint.single_image.registry import SingleImageInpainter

__all__ = ["Carried", "bilinear", "carry", "complete_smoothly", "flow", "inpaint_along_flow", "optical_flow"]


PLATE_SIDE = 256
"""Longer side at which flow is completed: a thin plate has no finer detail."""
RING_PX, STIFFNESS, TENSION = 12, 30.0, 1e-3
"""Known flow so near the hole holds the plate (pixels at that side); weights of bending and of tension against its data."""
MARGIN_PX = 3
"""Flow so near a hole is not the street's alone. Holes are grown already; a wider margin costs more than it spares (0.9 dB)."""
LEAST_PX = 40
"""Fewer pixels than this are invented in each frame for itself."""


def complete_smoothly(fields: Float32, hole: Mask) -> Float32:
    """Continue fields (H, W, C) into a hole (H, W) as thin plates: bent as little as possible, with a little tension.

    Linear fields are continued exactly but for the tension, also to the image's border, where nothing bends the plate.
    """
    height, width = hole.shape
    rows, columns = np.nonzero(grow(hole, RING_PX + 1))
    if not hole.any() or hole.all():
        return fields.copy()
    top, left = int(rows.min()), int(columns.min())
    window = np.s_[top : int(rows.max()) + 1, left : int(columns.max()) + 1]
    part, data = hole[window], fields[window].astype(np.float64)
    known = ~part & grow(part, RING_PX)
    free = part | known
    number = np.full(part.shape, -1, np.int64)
    number[free] = np.arange(int(free.sum()))

    def differences(steps: Sequence[tuple[int, int, float]]) -> sparse.csr_matrix:
        """One row for each place at which all pixels of a stencil (row, column, weight) are free."""
        reach_r, reach_c = max(s[0] for s in steps), max(s[1] for s in steps)
        h, w = part.shape[0] - reach_r, part.shape[1] - reach_c
        if h <= 0 or w <= 0:
            return sparse.csr_matrix((0, int(free.sum())))
        ids = np.stack([number[r : r + h, c : c + w].ravel() for r, c, _ in steps], axis=1)
        ids = ids[(ids >= 0).all(axis=1)]
        row = np.repeat(np.arange(len(ids)), len(steps))
        value = np.tile([s[2] for s in steps], len(ids))
        return sparse.csr_matrix((value, (row, ids.ravel())), shape=(len(ids), int(free.sum())))

    bend = [
        (differences([(0, 0, 1.0), (0, 1, -2.0), (0, 2, 1.0)]), 1.0),
        (differences([(0, 0, 1.0), (1, 0, -2.0), (2, 0, 1.0)]), 1.0),
        (differences([(0, 0, 1.0), (0, 1, -1.0), (1, 0, -1.0), (1, 1, 1.0)]), 2.0),
    ]
    stretch = [differences([(0, 0, -1.0), (0, 1, 1.0)]), differences([(0, 0, -1.0), (1, 0, 1.0)])]
    held = known[free].astype(np.float64)
    system = sparse.diags(held + 1e-9)
    for d, weight in bend:
        system = system + STIFFNESS * weight * (d.T @ d)
    for d in stretch:
        system = system + TENSION * (d.T @ d)
    solved = splu(system.tocsc()).solve(held[:, None] * data[free])
    result = fields.copy()
    filled = data.astype(np.float32)
    filled[free] = solved
    result[window] = np.where(part[..., None], filled, fields[window])
    return result


def optical_flow(images: Sequence[Picture], holes: Sequence[Mask]) -> tuple[list[Float32], list[Float32]]:
    """Flow of consecutive frames, completed inside the holes.

    Returns:
        forward (T-1 of (H, W, 2)), from each frame to the next in pixels (x, y); backward, from each frame but the first to
        the one before.
    """
    method = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    gray = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in images]
    ahead = [method.calc(gray[t], gray[t + 1], None).astype(np.float32) for t in range(len(images) - 1)]
    back = [method.calc(gray[t + 1], gray[t], None).astype(np.float32) for t in range(len(images) - 1)]
    height, width = holes[0].shape
    factor = min(1.0, PLATE_SIDE / max(height, width))
    small = (max(8, round(width * factor)), max(8, round(height * factor)))
    for t, hole in enumerate(holes):
        wide = grow(hole, MARGIN_PX)
        of_frame = ([ahead[t]] if t < len(ahead) else []) + ([back[t - 1]] if t else [])
        if not of_frame or not hole.any():
            continue
        both = np.concatenate(of_frame, axis=2)
        # By nearest: an average over the hole's border would carry the object's flow out of it.
        coarse = cv2.resize(both, small, interpolation=cv2.INTER_NEAREST).reshape(small[1], small[0], -1)
        covered = cv2.resize(wide.astype(np.float32), small, interpolation=cv2.INTER_AREA) > 0
        plate = complete_smoothly(coarse, covered)
        whole = cv2.resize(plate, (width, height), interpolation=cv2.INTER_LINEAR).reshape(height, width, -1)
        for field, own in zip(of_frame, np.split(whole, len(of_frame), axis=2), strict=True):
            field[wide] = own[wide]
    return ahead, back


def bilinear(picture: NDArray[np.generic], places: NDArray[np.floating]) -> Float32:
    """Values (N, C) of a picture (H, W, C) at places (N, 2), x and y in pixels from the first pixel's centre; beyond the
    border, the border's."""
    height, width = picture.shape[:2]
    x, y = (np.clip(places[:, i].astype(np.float64), 0, n - 1) for i, n in ((0, width), (1, height)))
    column, row = np.minimum(x.astype(int), max(0, width - 2)), np.minimum(y.astype(int), max(0, height - 2))
    u, v = (x - column)[:, None], (y - row)[:, None]
    right, below = np.minimum(column + 1, width - 1), np.minimum(row + 1, height - 1)
    upper = picture[row, column] * (1 - u) + picture[row, right] * u
    lower = picture[below, column] * (1 - u) + picture[below, right] * u
    mixed: Float32 = (upper * (1 - v) + lower * v).astype(np.float32)
    return mixed


@dataclass(frozen=True, eq=False)
class Carried:
    """Where pixels of one frame come from, along the flow in one direction of time.

    Attributes:
        source: (H, W) int64, the frame, -1 = none; place: (H, W, 2) float32, x and y in it.
    """

    source: NDArray[np.int64]
    place: Float32


def carry(there: Float32, back: Float32, hole: Mask, known: Mask, index: int, other: Carried) -> Carried:
    """Look for the hole's pixels in the neighbouring frame, or where that has its own from.

    Places are carried on, not colours, so that each pixel is interpolated once, however far it comes from.

    Args:
        there: (H, W, 2) flow from this frame to the neighbour; back: (H, W, 2) of the neighbour to this frame.
        hole: (H, W) of this frame; known: (H, W) of the neighbour, pixels that are its own; index: its number.
        other: where the neighbour's other pixels come from.
    """
    height, width = hole.shape
    rows, columns = np.nonzero(hole)
    move = there[rows, columns]
    target = np.stack([columns, rows], axis=1) + move
    nearest = np.round(target).astype(np.int64)
    inside = (nearest >= 0).all(axis=1) & (nearest < (width, height)).all(axis=1)
    r, c = nearest[:, 1].clip(0, height - 1), nearest[:, 0].clip(0, width - 1)
    returned = bilinear(back, target)
    # Sundaram et al., *Dense point trajectories by GPU-accelerated large displacement optical flow* (2010), eq. 5.
    apart = np.square(move + returned).sum(axis=1)
    agrees = apart < 0.01 * (np.square(move).sum(axis=1) + np.square(returned).sum(axis=1)) + 0.5
    own = inside & agrees & known[r, c]
    handed = inside & agrees & ~known[r, c] & (other.source[r, c] >= 0)
    source, place = np.full(hole.shape, -1, np.int64), np.zeros((*hole.shape, 2), np.float32)
    source[rows[own], columns[own]], place[rows[own], columns[own]] = index, target[own]
    source[rows[handed], columns[handed]] = other.source[r[handed], c[handed]]
    place[rows[handed], columns[handed]] = other.place[r[handed], c[handed]] + (target - nearest)[handed]
    return Carried(source, place)


def _along(
    flows: tuple[list[Float32], list[Float32]], holes: Sequence[Mask], known: Sequence[Mask], *, forwards: bool
) -> list[Carried]:
    """Carry known pixels through all frames in one direction of time."""
    count, (ahead, back) = len(holes), flows
    nothing = Carried(np.full(holes[0].shape, -1, np.int64), np.zeros((*holes[0].shape, 2), np.float32))
    found = [nothing] * count
    for t in range(1, count) if forwards else range(count - 2, -1, -1):
        near = t - 1 if forwards else t + 1
        there, returns = (back[near], ahead[near]) if forwards else (ahead[t], back[t])
        found[t] = carry(there, returns, holes[t], known[near], near, found[near])
    return found


def _painted(images: Sequence[Picture], t: int, candidates: Sequence[Carried]) -> tuple[Picture, Mask]:
    """Frame ``t`` with what was carried to it, nearer sources weighing more, and where there was any."""
    total = np.zeros(images[t].shape)
    weight = np.zeros(images[t].shape[:2])
    for one in candidates:
        for source in np.unique(one.source[one.source >= 0]):
            at = one.source == source
            share = 1.0 / abs(int(source) - t) ** 2
            total[at] += share * bilinear(images[source], one.place[at])
            weight[at] += share
    found = weight > 0
    picture = images[t].copy()
    picture[found] = np.clip(np.round(total[found] / weight[found, None]), 0, 255)
    return picture, found


def inpaint_along_flow(
    images: Sequence[Picture],
    holes: Sequence[Mask],
    single_image: SingleImageInpainter,
    *,
    progress: Progress = no_progress,
) -> list[Picture]:
    """Fill the holes of a film.

    Args:
        images: (H, W, 3) uint8 in order of time; holes: (H, W) each.
        single_image: invents what no frame shows, in the frame that lacks most; that is carried to the others.
    """
    flows = optical_flow(images, holes)
    pictures, missing = [image.copy() for image in images], [hole.copy() for hole in holes]
    for _ in images:
        known = [~hole for hole in missing]
        found = [_along(flows, missing, known, forwards=forwards) for forwards in (True, False)]
        sources = list(pictures)
        for t in range(len(images)):
            pictures[t], filled = _painted(sources, t, [one[t] for one in found])
            missing[t] = missing[t] & ~filled
        progress(sum(not hole.any() for hole in missing), len(images), "carrying along the flow")
        worst = int(np.argmax([hole.sum() for hole in missing]))
        if missing[worst].sum() < LEAST_PX:
            break
        pictures[worst] = fill_around(single_image, pictures[worst], missing[worst])
        missing[worst] = np.zeros_like(missing[worst])
    # What is left are specks, or what no flow reaches.
    return [fill_around(single_image, p, hole) if hole.any() else p for p, hole in zip(pictures, missing, strict=True)]


def flow(footage: Footage, progress: Progress) -> list[Picture]:
    """The row: each camera's film for itself."""
    clean: list[Picture] = list(footage.photographs)
    for track in tracks(footage.drive):
        filled = inpaint_along_flow(
            [footage.photographs[i] for i in track],
            [footage.holes[i] for i in track],
            footage.single_image,
            progress=progress,
        )
        for i, picture in zip(track, filled, strict=True):
            clean[i] = picture
    return deliver(footage, None, clean)
