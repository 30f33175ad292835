"""Which things move, by what they show of themselves: things with ids over the whole drive, others frame by frame.

Nothing is called moving that no other frame proves to have moved: what is seen too seldom, too far off or always hidden stands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Mask
from unveil_core.geometry.camera import Camera
from unveil_core.ground.sparse import GroundPoints
from unveil_core.movers.contacts import Contacts, find_contacts
from unveil_core.movers.seen_through import Body, Sight, look_through, sticks

__all__ = ["Patch", "find_patches", "instance_moves", "link_patches"]

COLUMNS = 3
"""So many contacts tell something of a thing."""
MOST, FEW = 0.7, 0.3
"""Share of a thing's contacts that are looked through, from which all of it moves, and up to which all of it stands."""
FRAMES_MOVING = 3
"""A thing without an id must be proven to move in so many frames."""
LIKE = 0.3
"""Patches of frames that follow each other may be one thing if they are as alike as this."""
SMALLEST_PX = 12
MOVING, STANDING, UNKNOWN = 1, 0, -1


@dataclass(eq=False)
class Patch:
    """Connected pixels of one class in one frame.

    Attributes:
        frame, label: which.
        mask: (H, W) pixels.
        state: MOVING, STANDING or UNKNOWN.
        number: of the mover that it belongs to, 0 = none.
    """

    frame: int
    label: int
    mask: Mask
    state: int
    number: int = 0
    box: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        rows, columns = np.nonzero(self.mask)
        self.box = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1], dtype=np.float64)


def _certain(contacts: Contacts, body: Body) -> Contacts:
    return contacts.where(contacts.error < body.error_m)


def _seen_through(
    contacts: Contacts, frame: int, sights: Sequence[Sight], body: Body, ground: GroundPoints
) -> tuple[Mask, Mask]:
    """(M,) contacts that other frames look through, and (M,) those of which they say anything."""
    evidence = look_through(sticks(contacts, sights[frame].camera, body, ground), sights, frame, farther=body.farther)
    through = body.seen_through(evidence)
    return through, through | (evidence.covered > 0)


def instance_moves(
    masks: Sequence[Mask | None], below: Sequence[Mask], sights: Sequence[Sight], body: Body, ground: GroundPoints
) -> str | None:
    """How it is known that a thing moves: "seen through", "drift", or None where nothing proves it.

    Args:
        masks: (H, W) of the thing per frame, None where a frame does not show it; below: (H, W) per frame, ground.
        sights: of all frames; for this thing, ``taken`` is what it may be itself.
    """
    verdicts, places, doubts, widths = [], [], [], [0.0]
    for frame, mask in enumerate(masks):
        if mask is None or mask.sum() < SMALLEST_PX:
            continue
        contacts = _certain(find_contacts(mask, below[frame], sights[frame].camera, ground), body)
        if len(contacts) < COLUMNS:
            continue
        through, known = _seen_through(contacts, frame, sights, body, ground)
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
    sights: Sequence[Sight],
    ground: GroundPoints,
) -> list[Patch]:
    """The connected pixels of each wanted label in a frame, with what the other frames say of them.

    A patch of several things that touch in the image is cut where its contacts change from looked through to not.

    Args:
        label: (H, W), negative where nothing is to be looked for; wanted: what things of each label are.
        below: (H, W) pixels that show ground.
    """
    patches: list[Patch] = []
    for k, body in wanted.items():
        count, component, stats, _ = cv2.connectedComponentsWithStats((label == k).astype(np.uint8), connectivity=8)
        for i in range(1, count):
            if stats[i, cv2.CC_STAT_AREA] < SMALLEST_PX:
                continue
            mask = component == i
            contacts = _certain(find_contacts(mask, below, sights[frame].camera, ground), body)
            through, known = _seen_through(contacts, frame, sights, body, ground)
            share = float(through[known].mean()) if known.sum() >= COLUMNS else -1.0
            if share < 0:
                patches.append(Patch(frame, k, mask, UNKNOWN))
            elif share >= MOST or share <= FEW:
                patches.append(Patch(frame, k, mask, MOVING if share >= MOST else STANDING))
            else:
                patches += _cut(frame, k, mask, contacts.where(known), through[known], sights[frame].camera)
    return patches


def _cut(frame: int, label: int, mask: Mask, contacts: Contacts, through: Mask, camera: Camera) -> list[Patch]:
    """The parts of a patch that move and that stand: per column what most contacts within half a metre or so say."""
    near = np.maximum(0.6 * camera.fx / contacts.depth, 2.0)
    gap = np.abs(np.arange(mask.shape[1])[:, None] - contacts.columns[None])
    weight = np.where(gap <= near[None], 1.0, 0.0) + 1e-3 / (1.0 + gap)
    moving = (weight * through[None]).sum(axis=1) > MOST * weight.sum(axis=1)
    parts = []
    for state, columns in ((MOVING, moving), (STANDING, ~moving)):
        part = mask & columns[None]
        if part.sum() >= SMALLEST_PX:
            parts.append(Patch(frame, label, part, state))
    return parts


def _alike(a: Patch, b: Patch) -> float:
    """How much two patches of neighbouring frames look like one thing, 0 to 1."""
    area = float(min(a.mask.sum(), b.mask.sum()) / max(a.mask.sum(), b.mask.sum()))
    size = max(float(np.hypot(*(p.box[2:] - p.box[:2]))) for p in (a, b))
    gap = float(np.hypot(*((a.box[:2] + a.box[2:]) / 2 - (b.box[:2] + b.box[2:]) / 2)))
    return area * max(0.0, 1 - gap / size) if a.label == b.label and area > 0.3 else 0.0


def link_patches(tracks: Sequence[Sequence[int]], patches: dict[int, list[Patch]]) -> int:
    """Chain the patches that look like one thing along each track, and number the chains that move; returns how many do.

    One frame may err: a chain moves if enough of its patches do and few of them stand. Then all of it does, also those patches
    of which nothing is known.

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
            taken: set[int] = set()
            for likeness, i, j in sorted(pairs, reverse=True):
                if likeness > LIKE and i not in chain_of and j not in taken:
                    chain_of[i] = before[j][1]
                    taken.add(j)
            for i, patch in enumerate(now):
                if i not in chain_of:
                    chain_of[i] = []
                    chains.append(chain_of[i])
                chain_of[i].append(patch)
            before = [(p, chain_of[i]) for i, p in enumerate(now)]
        for chain in chains:
            moving, standing = (sum(p.state == s for p in chain) for s in (MOVING, STANDING))
            if moving >= FRAMES_MOVING and moving > 2 * standing:
                used += 1
                for patch in chain:
                    patch.number = used
    return used
