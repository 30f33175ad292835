"""The z-buffer against pictures that can be computed by hand."""

from __future__ import annotations

import dataclasses

import numpy as np

from tests.mesh.street import cast, street_camera
from unveil_core.geometry.camera import Camera
from unveil_core.mesh import DepthView, Mesh, fuse, render_mesh_picture
from unveil_core.mesh.mesh import drop_small_components
from unveil_core.mesh.picture import BACKGROUND

CAMERA = Camera(40, 30, 20.0, 20.0, 20.0, 15.0, np.eye(4))


def square(z: float, half: float, color: tuple[int, int, int]) -> Mesh:
    vertices = np.array([[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]], np.float32)
    return Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.tile(np.array(color, np.uint8), (4, 1)))


def both(a: Mesh, b: Mesh) -> Mesh:
    return Mesh(
        np.concatenate([a.vertices, b.vertices]),
        np.concatenate([a.faces, b.faces + len(a.vertices)]),
        np.concatenate([a.colors, b.colors]),
    )


def test_a_square_covers_its_pixels() -> None:
    picture = render_mesh_picture(square(2.0, 0.5, (200, 10, 30)), CAMERA, headlight=0.0)
    inside = np.zeros((30, 40), dtype=bool)
    inside[10:20, 15:25] = True
    np.testing.assert_array_equal(picture[inside], np.tile((200, 10, 30), (100, 1)))
    np.testing.assert_array_equal(picture[~inside], np.tile(BACKGROUND, (1100, 1)))


def test_the_nearer_surface_is_seen_whatever_the_order() -> None:
    near, far = square(2.0, 0.5, (200, 10, 30)), square(4.0, 2.0, (10, 200, 30))
    one = render_mesh_picture(both(near, far), CAMERA, headlight=0.0)
    two = render_mesh_picture(both(far, near), CAMERA, headlight=0.0)
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(one[15, 20], (200, 10, 30))
    np.testing.assert_array_equal(one[15, 12], (10, 200, 30))


def test_colours_are_linear_in_space_not_on_the_screen() -> None:
    """A strip that recedes from z = 1 to z = 3: its middle in space is not its middle on the screen."""
    vertices = np.array([[-1, -0.4, 1], [-1, 0.4, 1], [1, -0.4, 3], [1, 0.4, 3]], np.float32)
    colors = np.array([[0, 0, 0], [0, 0, 0], [200, 200, 200], [200, 200, 200]], np.uint8)
    mesh = Mesh(vertices, np.array([[0, 1, 2], [1, 3, 2]], np.int32), colors)
    camera = dataclasses.replace(CAMERA, width=400, height=300, fx=200.0, fy=200.0, cx=200.0, cy=150.0)
    picture = render_mesh_picture(mesh, camera, headlight=0.0, samples=1)
    # x = z - 2, so the column is 200 (z - 2) / z + 200: z = 2 at the image's middle.
    assert abs(int(picture[150, 200, 0]) - 100) <= 1
    for z in (1.5, 2.5):
        column = int(200 * (z - 2) / z + 200)
        assert abs(int(picture[150, column, 0]) - 100 * (z - 1)) <= 2


def test_behind_the_camera_and_empty() -> None:
    behind = render_mesh_picture(square(-2.0, 0.5, (9, 9, 9)), CAMERA)
    empty = render_mesh_picture(Mesh.empty(), CAMERA, size=(16, 12))
    assert (behind == np.array(BACKGROUND)).all()
    assert empty.shape == (12, 16, 3)
    assert (empty == np.array(BACKGROUND)).all()


def test_a_fused_street_looks_like_its_photograph() -> None:
    views = []
    for i in range(6):
        camera = street_camera(1.2 * i, 160, 110)
        seen = cast(camera)
        views.append(DepthView(camera, seen["depth"], seen["rgb"]))
    mesh = fuse(views, voxel_size=0.08, max_depth=12.0)
    camera = street_camera(1.2, 160, 110)
    picture = render_mesh_picture(mesh, camera, headlight=0.0) / 255.0
    seen = cast(camera)
    near = (seen["depth"] > 4.5) & (seen["depth"] < 9)
    assert np.abs(picture[near] - seen["rgb"][near]).mean() < 0.03


def test_components_are_whole() -> None:
    near, far = square(2.0, 0.5, (200, 10, 30)), square(4.0, 2.0, (10, 200, 30))
    three = both(near, both(far, Mesh(far.vertices[:3] + 9, far.faces[:1], far.colors[:3])))
    kept = drop_small_components(three, 2)
    assert len(kept.faces) == 4
    assert len(kept.vertices) == 8
    np.testing.assert_array_equal(kept.vertices[kept.faces], three.vertices[three.faces[:4]])
    assert len(drop_small_components(three, 3).faces) == 0
    assert drop_small_components(three, 1) is three
