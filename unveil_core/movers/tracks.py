"""Which objects are dynamic: those with instance ids over the whole drive, others frame by frame.

Only what other frames prove to have moved counts as dynamic; objects seen too seldom, too far off or always occluded are static.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Mask
from unveil_core.geometry.camera import Camera
from unveil_core.ground.height_field import HeightField
from unveil_core.movers.contacts import Contacts, find_contacts
from unveil_core.movers.pixel_set import PixelSet
from unveil_core.movers.seen_through import Body, DriveVisibility, count_evidence, probe_points

__all__ = ["Patch", "arrays_of_patches", "find_patches", "instance_moves", "link_patches", "patches_of_arrays"]

COLUMNS = 3
"""Least number of contacts that say anything about an object."""
MOST, FEW = 0.7, 0.3
"""Share of an object's contacts that other frames see through: from the first on all of it is dynamic, up to the second static."""
FRAMES_MOVING = 3
"""An object without an id must be proven to move in so many frames."""
LIKE = 0.3
"""Patches of consecutive frames may be one object if their similarity, 0 to 1, exceeds this."""
SMALLEST_PX = 12
MOVING, STATIC, UNKNOWN = 1, 0, -1


@dataclass(eq=False)
class Patch:
    """Connected pixels of one class in one frame.

    Attributes:
        frame, label: which.
        pixels: those of the image (H, W) that show it.
        state: MOVING, STATIC or UNKNOWN.
        number: of the dynamic object that it belongs to, 0 = none.
    """

    frame: int
    label: int
    pixels: PixelSet
    state: int
    number: int = 0

    @property
    def box(self) -> NDArray[np.float64]:
        """(4,) left, upper, right and lower end, pixels."""
        own = self.pixels
        return np.array([own.left, own.upper, own.right, own.lower], dtype=np.float64)


def arrays_of_patches(patches: Sequence[Patch]) -> dict[str, NDArray[Any]]:
    """Patches as arrays for a file, before any has a number."""
    pixels = [p.pixels for p in patches]
    rows = [(p.frame, p.label, p.state, *p.pixels.numbers) for p in patches]
    bits = np.concatenate([np.zeros(0, np.uint8), *(p.bits for p in pixels)])
    return {"rows": np.array(rows, np.int64).reshape(len(rows), 8), "bits": bits}


def patches_of_arrays(arrays: Mapping[str, NDArray[Any]]) -> list[Patch]:
    """Inverse of :func:`arrays_of_patches`."""
    found, begun = [], 0
    for frame, label, state, *numbers in arrays["rows"].tolist():
        pixels = PixelSet.of_bits(numbers, arrays["bits"][begun:])
        begun += len(pixels.bits)
        found.append(Patch(frame, label, pixels, state))
    return found


def _certain(contacts: Contacts, body: Body) -> Contacts:
    return contacts.where(contacts.error < body.error_m)


def _seen_through(
    contacts: Contacts, frame: int, visibility: DriveVisibility, body: Body, ground: HeightField
) -> tuple[Mask, Mask]:
    """(M,) contacts that other frames see through, and (M,) those about which they say anything."""
    evidence = count_evidence(
        probe_points(contacts, visibility.cameras[frame], body, ground), visibility, frame, farther=body.farther
    )
    through = body.seen_through(evidence)
    return through, through | (evidence.covered > 0)


def instance_moves(
    masks: Mapping[int, Mask],
    below: Sequence[Mask],
    visibility: DriveVisibility,
    body: Body,
    ground: HeightField,
) -> str | None:
    """How it is known that an object moves: "seen through", "drift", or None where nothing proves it.

    Args:
        masks: (H, W) of the object, by the frames that show it; below: (H, W) per frame, ground.
        visibility: of all frames, with only this object's pixels as ``occupied``.
    """
    verdicts, places, doubts, widths = [], [], [], [0.0]
    for frame in sorted(masks):
        mask = masks[frame]
        if mask.sum() < SMALLEST_PX:
            continue
        contacts = _certain(find_contacts(mask, below[frame], visibility.cameras[frame], ground), body)
        if len(contacts) < COLUMNS:
            continue
        through, known = _seen_through(contacts, frame, visibility, body, ground)
        if known.sum() >= COLUMNS:
            verdicts.append(bool(through[known].mean() >= MOST))
        places.append(np.median(contacts.points, axis=0))
        doubts.append(float(np.median(contacts.error)))
        widths.append(float(np.linalg.norm(np.ptp(contacts.points, axis=0))))
    if sum(verdicts) >= 2 and np.mean(verdicts) >= 0.5:
        return "seen through"
    if len(places) >= 3:
        gap = np.linalg.norm(np.array(places)[:, None] - np.array(places)[None], axis=2)
        allowed = np.maximum(body.drift_m, 1.2 * max(widths)) + np.add.outer(doubts, doubts)
        if (gap > allowed).sum() >= 4:  # each pair counts twice
            return "drift"
    return None


def find_patches(
    frame: int,
    label: NDArray[np.int8],
    wanted: dict[int, Body],
    below: Mask,
    visibility: DriveVisibility,
    ground: HeightField,
) -> list[Patch]:
    """The connected pixels of each wanted label in a frame, with what the other frames say about them.

    A patch of several objects that touch in the image is cut where its contacts change from seen through to not.

    Args:
        label: (H, W), negative where nothing is to be searched; wanted: the kind of object of each label.
        below: (H, W) pixels that show ground.
    """
    patches: list[Patch] = []
    for k, body in wanted.items():
        count, component, stats, _ = cv2.connectedComponentsWithStats((label == k).astype(np.uint8), connectivity=8)
        for i in range(1, count):
            if stats[i, cv2.CC_STAT_AREA] < SMALLEST_PX:
                continue
            mask = component == i
            contacts = _certain(find_contacts(mask, below, visibility.cameras[frame], ground), body)
            through, known = _seen_through(contacts, frame, visibility, body, ground)
            share = float(through[known].mean()) if known.sum() >= COLUMNS else -1.0
            if share < 0:
                patches.append(Patch(frame, k, PixelSet.of(mask), UNKNOWN))
            elif share >= MOST or share <= FEW:
                patches.append(Patch(frame, k, PixelSet.of(mask), MOVING if share >= MOST else STATIC))
            else:
                patches += _cut(frame, k, mask, contacts.where(known), through[known], visibility.cameras[frame])
    return patches


def _cut(frame: int, label: int, mask: Mask, contacts: Contacts, through: Mask, camera: Camera) -> list[Patch]:
    """The dynamic and the static part of a patch: per column by the majority of the contacts within about half a metre."""
    near = np.maximum(0.6 * camera.fx / contacts.depth, 2.0)
    gap = np.abs(np.arange(mask.shape[1])[:, None] - contacts.columns[None])
    weight = np.where(gap <= near[None], 1.0, 0.0) + 1e-3 / (1.0 + gap)
    moving = (weight * through[None]).sum(axis=1) > MOST * weight.sum(axis=1)
    parts = []
    for state, columns in ((MOVING, moving), (STATIC, ~moving)):
        part = mask & columns[None]
        if part.sum() >= SMALLEST_PX:
            parts.append(Patch(frame, label, PixelSet.of(part), state))
    return parts


def _alike(a: Patch, b: Patch) -> float:
    """Similarity of two patches of neighbouring frames, 0 to 1."""
    area = min(a.pixels.size, b.pixels.size) / max(a.pixels.size, b.pixels.size)
    size = max(float(np.hypot(*(p.box[2:] - p.box[:2]))) for p in (a, b))
    gap = float(np.hypot(*((a.box[:2] + a.box[2:]) / 2 - (b.box[:2] + b.box[2:]) / 2)))
    return area * max(0.0, 1 - gap / size) if a.label == b.label and area > 0.3 else 0.0


def link_patches(tracks: Sequence[Sequence[int]], patches: dict[int, list[Patch]]) -> int:
    """Chain the patches that look like one object along each track, and number the dynamic chains; returns how many there are.

    One frame may err: a chain is dynamic if enough of its patches are and few are static. Then all its patches are, also those
    about which nothing is known.

    Args:
        tracks: frame indices per camera in order of travel; patches: of each frame, numbered in place.
    """
    used = 0
    for track in tracks:
        chains: list[list[Patch]] = []
        before: list[tuple[Patch, list[Patch]]] = []
        for frame in track:
            now = patches.get(frame, [])
            pairs = [(_alike(p, q), i, j) for i, p in enumerate(now) for j, (q, _) in enumerate(before)]
            chain_of: dict[int, list[Patch]] = {}
            linked: set[int] = set()
            for likeness, i, j in sorted(pairs, reverse=True):
                if likeness > LIKE and i not in chain_of and j not in linked:
                    chain_of[i] = before[j][1]
                    linked.add(j)
            for i, patch in enumerate(now):
                if i not in chain_of:
                    chain_of[i] = []
                    chains.append(chain_of[i])
                chain_of[i].append(patch)
            before = [(p, chain_of[i]) for i, p in enumerate(now)]
        for chain in chains:
            moving, static = (sum(p.state == s for p in chain) for s in (MOVING, STATIC))
            if moving >= FRAMES_MOVING and moving > 2 * static:
                used += 1
                for patch in chain:
                    patch.number = used
    return used
