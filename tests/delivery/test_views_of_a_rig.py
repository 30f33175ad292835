"""Which frames of a rig give a hole its detail."""

from __future__ import annotations

import numpy as np

from tests.ground.test_street import look
from unveil_core.delivery.views import MOST_ASKED_VIEWS, EmptyView, choose_sources


def heading_view(x: float, y: float, heading: float) -> EmptyView:
    """A view of a wall at x = 30."""
    camera = look(np.array([x, y, 0.0]), heading, pitch=0.0)
    with np.errstate(divide="ignore"):
        depth = (30.0 - x) / camera.rays()[..., 0]
    wall = (camera.rays()[..., 0] > 0.1).astype(bool)
    return EmptyView(
        camera, np.where(wall, depth, 0).astype(np.float32), np.zeros((camera.height, camera.width), dtype=bool)
    )


def test_cameras_that_look_elsewhere_do_not_use_up_the_views_that_are_asked() -> None:
    """More of them stand nearer than the only frame that shows the place."""
    places = np.stack([np.full(50, 30.0), np.linspace(-1, 1, 50), np.zeros(50)], axis=1)
    elsewhere = [heading_view(0.01 * k, 0.3, np.pi) for k in range(MOST_ASKED_VIEWS + 20)]
    views = [heading_view(0.0, 0.0, 0.0), *elsewhere, heading_view(5.0, 0.0, 0.0)]
    assert choose_sources(places, 0, views, 6) == [len(views) - 1]
