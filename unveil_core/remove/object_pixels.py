"""Which pixels of each frame show what is removed, and how far the frame sees in all others."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from unveil_core.base.evenly import evenly
from unveil_core.base.mechanisms import on
from unveil_core.base.types import Float32, Labels, Mask, Picture
from unveil_core.drives.depth_range import ASKED_M, FAR_M, NEAR_M
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.marked import MarkedObject, matte
from unveil_core.geometry.images import border_px, grow
from unveil_core.geometry.reach import cameras_near, centres_of
from unveil_core.ground.street import Ground
from unveil_core.raster.near_camera import near_camera
from unveil_core.raster.on_device import array, rendered
from unveil_core.remove.cut_off import cut_off_pixels
from unveil_core.remove.missed import missed_pixels
from unveil_core.remove.observed import SeenView, seen_view
from unveil_core.semantics.classes import GROUND_CLASSES
from unveil_core.semantics.labels import SceneLabels, frame_instances, frame_labels
from unveil_core.surfels.surfels import Surfels

__all__ = ["ObjectPixels", "drawn_by_kind"]

OWN_KINDS = 3
"""What a surfel is drawn as: stays, goes, goes as one that a person marked; then single objects."""
SEEN = 0.3
"""Alpha over which the scene has a depth."""
SHOWN = 0.5
"""Share of a pixel from which on it shows what was drawn: half of the light comes from it."""
MOST_ASKED = 24
"""Other frames that are asked about what one seems to miss, from the first to the last that are near."""


@dataclass(frozen=True, eq=False)
class ObjectPixels:
    """Attributes:
    drive: whose frames these are; scene: labels, with what was chosen; street: its ground, None where there is none.
    drawn: the full scene, its labels kinds (see :data:`OWN_KINDS`); by_hand: what a person marked.
    grown: by object, pixels of the delivered frame by which its mask is enlarged.
    photograph: (H, W, 3) of a frame, in the scene's colours; moving, ego: (H, W) its pixels that show a dynamic object, and the
        ego vehicle.
    """

    drive: Drive
    scene: SceneLabels
    street: Ground | None
    drawn: Surfels
    by_hand: Sequence[MarkedObject]
    grown: Mapping[int, int]
    photograph: Callable[[Frame], Picture]
    moving: Callable[[Frame], Mask]
    ego: Callable[[Frame], Mask]

    def seen(self, frame: Frame) -> SeenView:
        """What a frame shows, and what of it is hidden by removed objects."""
        near = near_camera(self.drawn, frame.camera)
        planes, count = ("rgb", "alpha", "depth", "semantics"), OWN_KINDS + len(self.grown)
        full = rendered(near, frame.camera, planes, label_count=count, near=NEAR_M, far=FAR_M)
        alpha, depth = array(full.alpha), array(full.depth)
        own = self._own(frame, array(full.semantics), array(full.rgb), depth / np.maximum(alpha, SEEN))
        label, on_ground = frame_labels(frame, self.scene), self.scene.labels.indices(GROUND_CLASSES)
        # Pixels at the border of the sky are mixed.
        sky = ~grow(~np.isin(label, self.scene.labels.indices(("sky",))), border_px(frame.camera.width, 1))
        by_label = (label >= 0, np.isin(label, on_ground), sky) if on_ground else None
        return seen_view(depth, alpha, own, by_label)

    def _own(self, frame: Frame, share: Float32, colors: Float32, depth: Float32) -> Mask:
        """(H, W) pixels that show something that goes.

        Args:
            share: (H, W, K) of each kind; colors: (H, W, 3), and depth: (H, W) metres, of the scene with everything in it.
        """
        single = {n: share[..., k] for k, n in enumerate(self.grown, start=OWN_KINDS)}
        marked, known = share[..., 2].copy(), share[..., 1].copy()
        for number, part in single.items():
            into = marked if number in {m.id for m in self.by_hand} else known
            into += part
        own = self._chosen(frame, known + marked) | self.moving(frame) | self._marked(frame, marked)
        photograph = self.photograph(frame)
        if on("missed_objects"):
            own |= missed_pixels(photograph, colors, known, own, lambda asked: self._backed(frame, depth, asked))
        if self.scene.source == "masks" and on("cut_off_pieces") and self.street is not None:
            own |= cut_off_pixels(photograph, frame.camera, depth.astype(np.float64), own, self.street)
        for number, part in single.items():
            instances = frame_instances(frame)
            # By the frame's own instances where these know the object, and by its drawn share.
            pixels = own & ((part > SHOWN) | (False if instances is None else instances == number))
            own |= grow(pixels, working_px(frame, self.grown[number])) if pixels.any() else False
        return own & ~self.ego(frame)

    def _chosen(self, frame: Frame, drawn: Float32) -> Mask:
        """(H, W) pixels of chosen classes and objects.

        From the frame's own labels or instances where it has them, else from the share (H, W) in which removed surfels were drawn:
        so masks on some frames are carried to the others through the scene.
        """
        label = frame_labels(frame, self.scene)
        mask: Mask = np.isin(label, self.scene.removed_labels)
        instances = frame_instances(frame)
        if self.scene.instances and instances is not None:
            mask |= np.isin(instances, self.scene.instances)
        elif self.scene.instances:
            mask |= drawn > SHOWN
        return mask | ((label < 0) & (drawn > SHOWN))

    def _backed(self, frame: Frame, depth: Float32, asked: Mask) -> Mask:
        """(H, W) of the pixels ``asked`` (H, W) those at whose place, ``depth`` (H, W) metres away, most other frames' own labels
        have something that goes; all where no other frame has labels there."""
        places = frame.camera.centre + depth[asked].astype(np.float64)[:, None] * frame.camera.rays()[asked]
        near = cameras_near(centres_of([f.camera for f in self.drive.frames]), places, ASKED_M)
        others = [self.drive.frames[int(near[k])] for k in evenly(len(near), MOST_ASKED)]
        goes, known = np.zeros((2, len(places)), dtype=np.int64)
        for other in others:
            if other is frame:
                continue
            index, pixels, _ = other.camera.shown(places)
            column, row = pixels.astype(np.int64).T
            known[index] += frame_labels(other, self.scene)[row, column] >= 0
            goes[index] += self._chosen(other, np.zeros((), np.float32))[row, column]
        backed = asked.copy()
        backed[asked] = (goes > known / 2) | (known == 0)
        return backed

    def _marked(self, frame: Frame, drawn: Float32) -> Mask:
        """(H, W) pixels of marked objects: by their mattes where this frame has them, else by their drawn share (H, W)."""
        mask = np.zeros(drawn.shape, dtype=bool)
        for marked in self.by_hand:
            own = None if marked.mattes is None else matte(marked, self.drive, frame)
            mask |= drawn > SHOWN if own is None else own
        return mask


def drawn_by_kind(
    surfels: Surfels, gone: Mask, instances: Labels, by_hand: Sequence[MarkedObject], grown: Mapping[int, int]
) -> Surfels:
    """The full scene with kinds as labels, see :data:`OWN_KINDS`: no label or instance image tells where marked objects are, and
    those whose masks are enlarged are drawn apart.

    Args:
        gone: (N,) surfels that go; instances: (N,) the object that each belongs to.
    """
    kinds = gone.astype(np.int64) + (gone & np.isin(instances, [m.id for m in by_hand]))
    for kind, number in enumerate(grown, start=OWN_KINDS):
        kinds[gone & (instances == number)] = kind
    return replace(surfels, labels=torch.from_numpy(kinds))


def working_px(frame: Frame, pixels: int) -> int:
    """Pixels of the working picture that are so many of the delivered one, at least one."""
    wide = frame.camera.width if frame.footage is None else frame.footage.camera.width
    return max(1, round(pixels * frame.camera.width / wide))
