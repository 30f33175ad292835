"""What other frames saw of the places behind a removed object."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from unveil_core.base.frame_cache import Frames
from unveil_core.geometry.camera import Camera
from unveil_core.remove.observed import SeenView, SeenViews, depth_behind, never_seen, seen_by_some, seen_view

HEIGHT, WIDTH, WALL = 40, 60, 10.0


def camera(x: float) -> Camera:
    """At (x, 0, 0), looking along z."""
    pose = np.eye(4)
    pose[0, 3] = -x
    return Camera(WIDTH, HEIGHT, 40.0, 40.0, WIDTH / 2, HEIGHT / 2, pose)


Look = tuple[Camera, SeenView]
HERE = np.zeros(3)


def seen_from(x: float, *planes: object) -> Look:
    return camera(x), seen_view(*planes)  # type: ignore[arg-type]


def together(looks: list[Look]) -> SeenViews:
    return SeenViews([c for c, _ in looks], [v for _, v in looks])


NONE = np.zeros((0, 3))


def places_seen(places: np.ndarray, views: SeenViews) -> np.ndarray:
    return seen_by_some(places, NONE, views, HERE)[0]


def sky_seen(directions: np.ndarray, views: SeenViews) -> np.ndarray:
    return seen_by_some(NONE, directions, views, HERE)[1]


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
    views = [seen_from(0, *wall_view(0, hidden)), seen_from(4, *wall_view(4))]
    alpha_empty = np.zeros((HEIGHT, WIDTH), np.float32)
    alpha_empty[HEIGHT // 2 :] = 1
    none = np.full((HEIGHT, WIDTH), np.inf)
    behind = depth_behind(alpha_empty * np.float32(WALL), none)
    mask = never_seen(camera(0), hidden, behind, together(views))
    assert not mask.any()
    alone = never_seen(camera(0), hidden, behind, together(views[:1]))
    assert np.array_equal(alone, hidden)


def test_what_is_in_front_hides_a_place() -> None:
    view = seen_from(0, *wall_view(0))
    places = np.array([[0.0, 2.0, 9.9], [0.0, 2.0, 5.0], [0.0, 2.0, 14.0], [0.0, 2.0, -5.0], [90.0, 2.0, 9.0]])
    # On the wall; in front of it, where nothing hides it; behind it; behind the camera; outside the picture.
    assert places_seen(places, together([view])).tolist() == [True, True, False, False, False]
    assert not places_seen(places, together([])).any()


def test_sky_is_seen_by_direction() -> None:
    hidden = np.zeros((HEIGHT, WIDTH), bool)
    hidden[:, :30] = True
    view = seen_from(3, *wall_view(3, hidden))
    directions = np.array([[0.3, -0.2, 1.0], [-0.3, -0.2, 1.0], [0.3, 0.2, 1.0], [0.0, -0.2, -1.0]])
    # Open sky; behind the object; the wall; behind the camera.
    assert sky_seen(directions, together([view])).tolist() == [True, False, False, False]


def test_the_ground_counts_where_nothing_is_left() -> None:
    hidden = np.zeros((HEIGHT, WIDTH), bool)
    hidden[30:35, 25:35] = True
    views = [seen_from(0, *wall_view(0, hidden)), seen_from(2, *wall_view(2))]
    nothing = np.zeros((HEIGHT, WIDTH), np.float32)
    ground = np.full((HEIGHT, WIDTH), np.inf)
    ground[25:] = 6.0
    assert not never_seen(camera(0), hidden, depth_behind(nothing, ground), together(views)).any()
    # Without the ground it would be sky, which nobody sees down there.
    no_ground = np.full((HEIGHT, WIDTH), np.inf)
    assert np.array_equal(never_seen(camera(0), hidden, depth_behind(nothing, no_ground), together(views)), hidden)


def floor_view(x: float, height: float = 1.6) -> tuple[np.ndarray, np.ndarray]:
    """Depth and alpha of level ground ``height`` below the camera."""
    rays = camera(x).rays()
    with np.errstate(divide="ignore"):
        depth = np.where(rays[..., 1] > 0, height / rays[..., 1], 0)
    return depth.astype(np.float32), (depth > 0).astype(np.float32)


def test_ground_seen_at_a_grazing_angle_does_not_hide_itself() -> None:
    nowhere = np.zeros((HEIGHT, WIDTH), bool)
    view = seen_from(0, *floor_view(0), nowhere, (~nowhere, nowhere, nowhere))
    rng = np.random.default_rng(0)
    # Anywhere in their pixels: up to metres from what the pixels' centres show.
    depth = rng.uniform(4, 40, 3000)
    places = np.stack([rng.uniform(-0.5, 0.5, 3000) * depth, np.full(3000, 1.6), depth], axis=1)
    assert places_seen(places, together([view])).all()
    # Below the ground by a tenth of the camera's height and more, nothing is seen.
    assert not places_seen(places[depth < 8] * (1, 1.4, 1), together([view])).any()


def test_the_reach_of_a_pixel_stops_at_edges_of_depth() -> None:
    hidden = np.zeros((HEIGHT, WIDTH), bool)
    depth, alpha = np.full((HEIGHT, WIDTH), 20, np.float32), np.ones((HEIGHT, WIDTH), np.float32)
    depth[:, 28:32] = 5
    view = seen_from(0, depth, alpha, hidden)
    column = np.arange(WIDTH)
    places = np.stack([(column + 0.5 - WIDTH / 2) / 40 * 7, np.zeros(WIDTH), np.full(WIDTH, 7.0)], axis=1)
    post = (column >= 28) & (column < 32)
    assert np.array_equal(places_seen(places, together([view])), ~post)


def test_ground_by_label_hides_only_across_a_crest() -> None:
    hidden, everywhere = np.zeros((HEIGHT, WIDTH), bool), np.ones((HEIGHT, WIDTH), bool)
    depth, alpha = np.full((HEIGHT, WIDTH), 10, np.float32), np.ones((HEIGHT, WIDTH), np.float32)
    places = np.array([[0.0, 0.0, 10.5], [0.0, 0.0, 14.0], [0.0, 0.0, 25.0]])

    def shown(told: tuple[np.ndarray, np.ndarray, np.ndarray] | None) -> list[bool]:
        return list(places_seen(places, together([seen_from(0, depth, alpha, hidden, told)])))

    assert shown((everywhere, everywhere, ~everywhere)) == [True, True, False]
    assert shown((everywhere, ~everywhere, ~everywhere)) == [True, False, False]
    # Where a frame's labels are void they tell no more than none at all.
    assert shown(None) == shown((~everywhere, everywhere, ~everywhere))


def test_the_sky_is_seen_through_a_haze_of_surfels_where_a_label_says_so() -> None:
    hidden, everywhere = np.zeros((HEIGHT, WIDTH), bool), np.ones((HEIGHT, WIDTH), bool)
    depth, alpha = np.full((HEIGHT, WIDTH), 10, np.float32), np.full((HEIGHT, WIDTH), 0.5, np.float32)
    ahead = np.array([[0.0, 0.0, 1.0]])
    for sky in (everywhere, ~everywhere):
        view = seen_from(0, depth, alpha, hidden, (everywhere, ~everywhere, sky))
        assert sky_seen(ahead, together([view])) == sky.all()
        # What is nearer than the haze is not hidden by it either.
        assert places_seen(8 * ahead, together([view]))


def test_what_stands_or_the_terrain_lies_behind() -> None:
    left = np.array([30, 30, 30, 30, 0], np.float32)  # through holes of the ground the scene shows what is far
    standing = np.array([0, 6, 20, 0, 0], np.float32)
    terrain = np.array([9, 9, 9, np.inf, np.inf])
    chart = np.array([12, 12, 12, 12, np.inf])
    # Terrain; what stands before it; terrain before what stands; no terrain: the chart; nothing: the sky.
    assert depth_behind(left, chart, standing, terrain).tolist() == [9, 6, 9, 12, np.inf]
    assert depth_behind(left, chart).tolist() == [12, 12, 12, 12, np.inf]


def looking(generator: np.random.Generator) -> Camera:
    """Anywhere, in any direction."""
    turn = Rotation.random(random_state=generator.integers(1 << 30)).as_matrix()
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, -turn @ generator.uniform(-60, 60, 3)
    return Camera(WIDTH, HEIGHT, 40.0, 35.0, 0.3 * WIDTH, 0.6 * HEIGHT, pose)


@given(st.integers(0, 10_000))
def test_asking_some_frames_finds_what_asking_all_finds(seed: int) -> None:
    generator = np.random.default_rng(seed)
    cameras = [looking(generator) for _ in range(12)]
    depths = generator.choice([0.0, 5.0, 40.0, np.inf], (12, HEIGHT, WIDTH)).astype(np.float16)
    views = SeenViews(cameras, [SeenView(depth) for depth in depths])
    points, directions = generator.uniform(-50, 50, (80, 3)), generator.normal(size=(generator.integers(0, 5), 3))
    shown, sky = np.zeros(len(points), bool), np.zeros(len(directions), bool)
    for camera_, depth in zip(cameras, depths, strict=True):
        for places, found, is_sky in ((points, shown, False), (camera_.centre + directions, sky, True)):
            pixel, z = camera_.project(places)
            inside = camera_.in_picture(pixel, z)
            x, y = pixel[inside].astype(int).T
            found[inside] |= np.isinf(depth[y, x]) if is_sky else depth[y, x] > z[inside]
    for found, expected in zip(seen_by_some(points, directions, views, cameras[0].centre), (shown, sky), strict=True):
        assert np.array_equal(found, expected)


def test_frames_that_look_elsewhere_are_not_asked() -> None:
    ahead = camera(0)
    turned = np.diag([-1.0, 1.0, -1.0, 1.0])
    behind = Camera(WIDTH, HEIGHT, 40.0, 40.0, WIDTH / 2, HEIGHT / 2, turned)

    def look(i: int) -> SeenView:
        assert i == 0, "asked a frame that looks back"
        return SeenView(np.full((HEIGHT, WIDTH), 3, np.float16))

    views = SeenViews([ahead, behind], Frames(2, look))
    points, up = np.array([[0.0, 0.0, 9.0], [1.0, 0.5, 2.0]]), np.array([[0.0, -0.1, 1.0]])
    shown, sky = seen_by_some(points, up, views, HERE)
    assert shown.tolist() == [False, True] and not sky.any()
