"""Which surfels of a scene go before any frame is looked at: the chosen ones, and what only seems to be something else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from unveil_core.base.frame_cache import Frames
from unveil_core.base.mechanisms import on
from unveil_core.base.types import Labels, Mask
from unveil_core.drives.drive import Drive
from unveil_core.geometry.axes import UP, up_frame
from unveil_core.ground.street import Ground
from unveil_core.remove.selection import Selection, select_removed
from unveil_core.remove.unsupported import unsupported
from unveil_core.semantics.classes import GROUND_CLASSES
from unveil_core.semantics.labels import SceneLabels, frame_labels
from unveil_core.surfels.surfels import Surfels

__all__ = ["removed_surfels"]

ON_GROUND_M = 0.15
"""Height over or under the ground within which a surfel lies on it, metres: what a fit along the whole street is off by."""
LOOSE_M = 0.5
"""How far from an object its loose ends may lie, metres."""
TOO_CLOSE_M = 0.08
"""Distance from a removed surfel within which others go, too, metres: their colour is that of its border."""


def removed_surfels(
    surfels: Surfels, instances: Labels, scene: SceneLabels, drive: Drive, street: Ground | None
) -> Selection:
    """The surfels that go.

    Args:
        surfels: the full scene; instances: (N,) the object that each belongs to, 0 = none.
        scene: labels, with what was chosen; drive: whose frames tell.
        street: its ground, None where there is none.
    """
    on_ground = np.isin(surfels.labels.numpy(), scene.labels.indices(GROUND_CLASSES))
    means, labelled = surfels.means.double().numpy(), bool(scene.labels.indices(GROUND_CLASSES))
    lies = None
    if labelled and street is not None:
        lies = on_ground & (np.abs(street.over(street.path.to_street(means))) < ON_GROUND_M)
    found = select_removed(surfels, instances, scene, too_close=TOO_CLOSE_M, axes=up_frame(UP), ground=lies)
    gone = found.removed
    if not labelled and on("loose_ends"):
        gone = gone | _loose_ends(drive, scene, surfels, gone)
    return replace(found, removed=gone)


def _loose_ends(drive: Drive, scene: SceneLabels, surfels: Surfels, gone: Mask) -> Mask:
    """(N,) surfels that go because no masked frame backs them: masks drawn by hand are missing in some frames and loose in others,
    and where there are no classes, a surfel's label is no more than what most frames say."""
    masked = [f for f in drive.frames if (frame_labels(f, scene) >= 0).any()]
    masks = Frames(len(masked), lambda i: np.isin(frame_labels(masked[i], scene), scene.removed_labels))
    return unsupported(surfels.means.double().numpy(), gone, [f.camera for f in masked], masks, reach=LOOSE_M)
