"""What other frames saw of the places behind a removed object."""

from __future__ import annotations

import numpy as np

from unveil_core.geometry.camera import Camera
from unveil_core.remove.observed import never_seen, places_seen, seen_view, sky_seen

HEIGHT, WIDTH, WALL = 40, 60, 10.0


def camera(x: float) -> Camera:
    """At (x, 0, 0), looking along z."""
    pose = np.eye(4)
    pose[0, 3] = -x
    return Camera(WIDTH, HEIGHT, 40.0, 40.0, WIDTH / 2, HEIGHT / 2, pose)


def wall_view(x: float, hidden: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth, alpha and hidden pixels of a wall at z = 10 below the horizon, under a sky; what is hidden is at z = 4."""
    hidden = np.zeros((HEIGHT, WIDTH), bool) if hidden is None else hidden
    alpha = np.zeros((HEIGHT, WIDTH), np.float32)
    alpha[HEIGHT // 2 :] = 1
    depth = alpha * WALL
    alpha[hidden], depth[hidden] = 1, 4
    return depth.astype(np.float32), alpha, hidden


def test_a_wall_is_seen_from_beside_the_object() -> None:
    hidden = np.zeros((HEIGHT, WIDTH), bool)
    hidden[5:35, 25:35] = True
    # From 4 m beside, an object at z = 4 lies 40 px to the side, the wall behind it 16 px.
    views = [seen_view(camera(0), *wall_view(0, hidden)), seen_view(camera(4), *wall_view(4))]
    alpha_left = np.zeros((HEIGHT, WIDTH), np.float32)
    alpha_left[HEIGHT // 2 :] = 1
    none = np.full((HEIGHT, WIDTH), np.inf)
    mask = never_seen(camera(0), hidden, alpha_left, alpha_left * np.float32(WALL), none, views)
    assert not mask.any()
    alone = never_seen(camera(0), hidden, alpha_left, alpha_left * np.float32(WALL), none, views[:1])
    assert np.array_equal(alone, hidden)


def test_what_is_in_front_hides_a_place() -> None:
    view = seen_view(camera(0), *wall_view(0))
    places = np.array([[0.0, 2.0, 9.9], [0.0, 2.0, 5.0], [0.0, 2.0, 14.0], [0.0, 2.0, -5.0], [90.0, 2.0, 9.0]])
    # On the wall; in front of it, where nothing hides it; behind it; behind the camera; outside the picture.
    assert places_seen(places, [view]).tolist() == [True, True, False, False, False]
    assert not places_seen(places, []).any()


def test_sky_is_seen_by_direction() -> None:
    hidden = np.zeros((HEIGHT, WIDTH), bool)
    hidden[:, :30] = True
    view = seen_view(camera(3), *wall_view(3, hidden))
    directions = np.array([[0.3, -0.2, 1.0], [-0.3, -0.2, 1.0], [0.3, 0.2, 1.0], [0.0, -0.2, -1.0]])
    # Open sky; behind the object; the wall; behind the camera.
    assert sky_seen(directions, [view]).tolist() == [True, False, False, False]


def test_the_ground_counts_where_nothing_is_left() -> None:
    hidden = np.zeros((HEIGHT, WIDTH), bool)
    hidden[30:35, 25:35] = True
    views = [seen_view(camera(0), *wall_view(0, hidden)), seen_view(camera(2), *wall_view(2))]
    nothing = np.zeros((HEIGHT, WIDTH), np.float32)
    ground = np.full((HEIGHT, WIDTH), np.inf)
    ground[25:] = 6.0
    assert not never_seen(camera(0), hidden, nothing, nothing, ground, views).any()
    # Without the ground it would be sky, which nobody sees down there.
    no_ground = np.full((HEIGHT, WIDTH), np.inf)
    assert np.array_equal(never_seen(camera(0), hidden, nothing, nothing, no_ground, views), hidden)
