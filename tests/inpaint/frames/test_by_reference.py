"""Which frame paints a hole, and which part of it is shown to the network."""

from __future__ import annotations

import numpy as np

from tests.pavement import box
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.frames.by_reference import ReferencePropagator

WIDTH, HEIGHT, WALL_M = 160, 120, 10.0


def camera_at(x: float, z: float) -> Camera:
    """Looks at a wall 10 m before the origin, from so far to the right and so much nearer."""
    pose = np.eye(4)
    pose[:3, 3] = (-x, 0, -z)
    return Camera(WIDTH, HEIGHT, 100.0, 100.0, WIDTH / 2, HEIGHT / 2, pose)


def wall(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """What the camera sees: colours that tell the place, and depth."""
    depth = np.full((HEIGHT, WIDTH), WALL_M + camera.world_to_camera[2, 3])
    points = camera.centre + depth[..., None] * camera.rays()
    colour = np.stack([128 + 12 * points[..., 0], 128 + 12 * points[..., 1], 0 * depth + 50], axis=-1)
    return np.clip(np.round(colour), 0, 255).astype(np.uint8), depth


class Asked:
    """In place of a network: paints the middle of the reference, and remembers what it was given."""

    def __init__(self) -> None:
        self.given: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def __call__(self, image: np.ndarray, mask: np.ndarray, reference: np.ndarray) -> np.ndarray:
        self.given.append((image, mask, reference))
        middle = reference[reference.shape[0] // 2, reference.shape[1] // 2]
        return np.where(mask[..., None], middle, image).astype(np.uint8)


def test_the_finest_view_of_the_place_paints_it() -> None:
    network = Asked()
    references = ReferencePropagator(network)
    for blue, (x, z) in enumerate(((0.5, 2.0), (0.0, 4.0), (30.0, 6.0), (0.0, 0.0))):
        camera = camera_at(x, z)
        image, depth = wall(camera)
        image[..., 2] = 10 * blue
        references.add(camera, image, depth)
    here = camera_at(0.0, 0.0)
    image, depth = wall(here)
    hole = box((HEIGHT, WIDTH), 50, 70, 70, 90)
    done, painted = references.paint(here, np.where(hole[..., None], 0, image).astype(np.uint8), hole, depth)
    assert np.array_equal(painted, hole) and np.array_equal(done[~hole], image[~hole])
    assert len(network.given) == 1
    # Nearer is finer; the one far to the side is nearer still, and does not show it.
    assert (done[hole][:, 2] == 10).all()
    assert np.abs(done[hole][:, :2].astype(int) - image[60, 80, :2]).max() <= 2
    part, mask, reference = network.given[0]
    assert mask.sum() == hole.sum() and part.shape[:2] == mask.shape
    # As much around the place as in the image: by the nearer view's larger scale.
    assert reference.shape[0] / part.shape[0] > 1.2
    assert np.abs(reference[0, 0].astype(int) - part[0, 0])[:2].max() <= 25


def test_a_frame_in_which_something_stands_before_the_place_is_none() -> None:
    network, references = Asked(), None
    for nearer in (0.0, 3.0):
        references = ReferencePropagator(network)
        camera = camera_at(1.0, 1.0)
        image, depth = wall(camera)
        references.add(camera, image, depth - nearer)
        here = camera_at(0.0, 0.0)
        image, depth = wall(here)
        hole = box((HEIGHT, WIDTH), 50, 70, 70, 90)
        done, painted = references.paint(here, image, hole, depth)
        assert painted.any() == (nearer == 0) and np.array_equal(done[~painted], image[~painted])
    assert len(network.given) == 1


def test_nothing_is_painted_without_frames_or_holes() -> None:
    network = Asked()
    here = camera_at(0.0, 0.0)
    image, depth = wall(here)
    hole = box((HEIGHT, WIDTH), 0, 9, 0, 9)
    done, painted = ReferencePropagator(network).paint(here, image, hole, depth)
    assert np.array_equal(done, image) and not painted.any()
    references = ReferencePropagator(network)
    references.add(here, image, depth)
    done, painted = references.paint(here, image, hole & False, depth)
    assert np.array_equal(done, image) and not painted.any() and not network.given
    done, painted = references.paint(here, image, hole, depth)
    assert np.array_equal(painted, hole) and len(network.given) == 1


def test_holes_are_painted_each_by_its_own_frame() -> None:
    network = Asked()
    references = ReferencePropagator(network)
    for blue, x in ((10, -9.0), (20, 9.0)):
        camera = camera_at(x, 0.0)
        image, depth = wall(camera)
        image[..., 2] = blue
        references.add(camera, image, depth)
    here = camera_at(0.0, 0.0)
    image, depth = wall(here)
    left, right, middle = (box((HEIGHT, WIDTH), 40, 60, c, c + 4) for c in (20, 140, 80))
    done, painted = references.paint(here, image, left | right, depth)
    assert np.array_equal(painted, left | right)
    assert (done[left][:, 2] == 10).all() and (done[right][:, 2] == 20).all()
    assert (done[middle][:, 2] == 50).all()
