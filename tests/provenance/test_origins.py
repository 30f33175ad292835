"""Where a pixel comes from, in scenes whose surfels are known."""

from __future__ import annotations

import numpy as np

from tests.inpaint.walls import before_wall, shows, wall_without
from unveil_core.inpaint.origin import CONTINUED, INVENTED, ORIGINAL, RELIT, SEEN_ELSEWHERE
from unveil_core.provenance.origins import frame_origins, marked_by, rendered_origins

WINDOW = (-0.6, 0.6, -0.6, 0.6)


def test_a_pixel_is_what_most_of_its_surfels_are_and_the_sky_was_seen() -> None:
    wall = wall_without(WINDOW)
    left = wall.means[:, 0].numpy() < 0
    camera = before_wall(0.0, 3.0)
    origin, depth = rendered_origins(marked_by(wall, np.where(left, CONTINUED, INVENTED).astype(np.uint8)), camera)
    inside, halves = (
        shows(camera, (-0.4, 0.4, -0.4, 0.4)),
        (shows(camera, (-2, -0.8, -1, 1)), shows(camera, (0.8, 2, -1, 1))),
    )
    assert (origin[inside] == SEEN_ELSEWHERE).all() and (depth[inside] == 0).all()
    assert (origin[halves[0]] == CONTINUED).all() and (origin[halves[1]] == INVENTED).all()
    assert np.abs(depth[halves[0]] - 3).max() < 0.05


def test_a_frame_shows_the_scene_the_inpainted_frame_or_itself() -> None:
    """One row of pixels, a case each."""
    columns = [
        # rendered, inpainted, optimized, shadow, unobserved; result
        (SEEN_ELSEWHERE, SEEN_ELSEWHERE, False, False, False, ORIGINAL),
        (SEEN_ELSEWHERE, RELIT, False, True, False, RELIT),
        (CONTINUED, INVENTED, True, False, True, CONTINUED),
        (SEEN_ELSEWHERE, INVENTED, False, True, False, INVENTED),  # around a dynamic object
        (INVENTED, SEEN_ELSEWHERE, False, True, False, INVENTED),  # likewise; surfels show it
        (SEEN_ELSEWHERE, SEEN_ELSEWHERE, True, False, True, CONTINUED),
        (RELIT, RELIT, True, False, True, CONTINUED),
        (RELIT, RELIT, True, False, False, RELIT),
    ]
    rendered, inpainted, optimized, shadow, unobserved, expected = (np.array([c]) for c in zip(*columns, strict=True))
    found = frame_origins(rendered.astype(np.uint8), inpainted.astype(np.uint8), optimized, shadow, unobserved)
    assert found.tolist() == expected.tolist()
