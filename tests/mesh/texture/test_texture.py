"""Textures from pictures of a courtyard: a paved ground and a wall, with a pattern far finer than their triangles."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.base.types import Float32, Float64
from unveil_core.geometry.camera import Camera
from unveil_core.mesh.hits import hit_triangles
from unveil_core.mesh.mesh import Mesh
from unveil_core.mesh.picture import render_mesh_picture, render_textured_picture
from unveil_core.mesh.texture import TexturedMesh, TextureView, paint, unwrap

pytest.importorskip("xatlas")

WALL_X = 9.0


def pattern(points: Float64) -> Float32:
    """(..., 3) colours in [0, 1] of places: slabs of 40 cm with joints on the ground, bricks on the wall."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    wall = z > 0.01
    across, along = np.where(wall, y, x), np.where(wall, z, y)
    joint = (np.abs(across / 0.4 % 1 - 0.5) > 0.42) | (np.abs(along / 0.4 % 1 - 0.5) > 0.42)
    color = np.where(wall[..., None], (0.7, 0.4, 0.3), (0.5, 0.5, 0.45)) * np.where(joint, 0.4, 1.0)[..., None]
    return color.astype(np.float32)


def grid(corner: Float64, u: Float64, v: Float64, steps: int) -> Mesh:
    """A parallelogram of ``2 * steps**2`` triangles with the pattern as vertex colours."""
    a, b = np.meshgrid(np.linspace(0, 1, steps + 1), np.linspace(0, 1, steps + 1), indexing="ij")
    vertices = corner + a.reshape(-1, 1) * u + b.reshape(-1, 1) * v
    first = (np.arange(steps)[:, None] * (steps + 1) + np.arange(steps)).reshape(-1, 1)
    quads = first + np.array([0, steps + 1, steps + 2, 1])
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return Mesh(vertices.astype(np.float32), faces.astype(np.int32), np.full((len(vertices), 3), 110, np.uint8))


def together(*meshes: Mesh) -> Mesh:
    first = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    faces = [m.faces + np.int32(n) for m, n in zip(meshes, first[:-1], strict=True)]
    vertices, colors = (np.concatenate([getattr(m, n) for m in meshes]) for n in ("vertices", "colors"))
    return Mesh(vertices, np.concatenate(faces), colors)


GROUND = grid(np.array([1.0, -4, 0]), np.array([8.0, 0, 0]), np.array([0, 8.0, 0]), 6)
WALL = grid(np.array([WALL_X, -4, 0]), np.array([0, 8.0, 0]), np.array([0, 0, 3.0]), 4)
COURT = together(GROUND, WALL)


def camera_at(x: float, y: float, size: tuple[int, int] = (240, 160)) -> Camera:
    """At 1.6 m, looking along x and down a little."""
    down = np.radians(12)
    pose = np.eye(4)
    pose[:3, :3] = [[0, -1, 0], [-np.sin(down), 0, -np.cos(down)], [np.cos(down), 0, -np.sin(down)]]
    pose[:3, 3] = -pose[:3, :3] @ [x, y, 1.6]
    return Camera(*size, 200.0, 200.0, size[0] / 2, size[1] / 2, pose)


def photograph(camera: Camera, mesh: Mesh = COURT, samples: int = 3) -> Float32:
    """(H, W, 3) what a camera sees of the pattern; the sky is blue."""
    fine = camera.resized(camera.width * samples, camera.height * samples)
    hits = hit_triangles(mesh, fine)
    color = np.where((hits.face >= 0)[..., None], pattern(hits.values(mesh.faces, mesh.vertices)), (0.4, 0.6, 0.9))
    shape = (camera.height, samples, camera.width, samples, 3)
    return color.reshape(shape).mean(axis=(1, 3)).astype(np.float32)


def view(camera: Camera, picture: Float32 | None = None) -> TextureView:
    shown = photograph(camera) if picture is None else picture
    return TextureView(camera, shown, lambda points: camera.project(points)[0])


def painted(mesh: Mesh, views: list[TextureView], texel: float = 0.02) -> TexturedMesh:
    atlas = unwrap(mesh, 1024, texel, 2)
    return paint(mesh, atlas, [v.camera for v in views], views)


def psnr(picture: np.ndarray, truth: Float32, where: np.ndarray) -> float:
    return float(-10 * np.log10(np.square(picture / 255.0 - truth)[where].mean()))


CAMERAS = [camera_at(x, y) for x, y in ((-1.0, 0.5), (0.5, -1.0), (2.0, 1.0))]


def test_another_view_of_the_texture_is_what_a_camera_would_see_there() -> None:
    textured = painted(COURT, [view(c) for c in CAMERAS])
    there = camera_at(0.3, 0.4)
    truth, seen = photograph(there), hit_triangles(COURT, there).face >= 0
    fine = psnr(render_textured_picture(textured, there), truth, seen)
    plain = psnr(render_mesh_picture(COURT, there, headlight=0), truth, seen)
    assert fine > 26 and fine > plain + 10


def test_every_triangle_has_its_own_texels_of_the_size_that_was_asked_for() -> None:
    atlas = unwrap(COURT, 1024, 0.05, 2)
    np.testing.assert_array_equal(atlas.vertices[atlas.corners], COURT.faces)
    assert atlas.texel == pytest.approx(0.05) and len(atlas.sides) == 1
    corners = atlas.coordinates[atlas.corners] * np.array(atlas.sides[0])
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]).sum() / 2
    assert area == pytest.approx((8 * 8 + 8 * 3) / 0.05**2, rel=0.05)
    assert atlas.coordinates.min() >= 0 and atlas.coordinates.max() <= 1


def test_texels_grow_where_the_pages_would_not_suffice() -> None:
    atlas = unwrap(COURT, 256, 0.005, 2)
    assert len(atlas.sides) <= 2 and all(side <= (256, 256) for side in atlas.sides)
    assert 0.02 < atlas.texel < 0.1


def test_what_stands_before_a_wall_is_not_painted_on_it() -> None:
    """A board hides a part of the wall in one view; the other sees that part."""
    board = grid(np.array([5.0, -1, 0]), np.array([0, 2.0, 0]), np.array([0, 0, 2.0]), 1)
    mesh = together(COURT, board)
    aside = camera_at(-1.0, 3.2)
    pictures = []
    for camera in (CAMERAS[0], aside):
        hits = hit_triangles(mesh, camera)
        pictures.append(
            np.where((hits.face >= len(COURT.faces))[..., None], np.float32([1, 0, 0]), photograph(camera, mesh))
        )
    textured = painted(mesh, [view(c, p) for c, p in zip((CAMERAS[0], aside), pictures, strict=True)])
    wall = render_textured_picture(
        TexturedMesh(COURT, _without(textured, len(COURT.faces)), textured.images), CAMERAS[0]
    )
    red = (wall[..., 0] > 200) & (wall[..., 1] < 60)
    # The board's foot stands in a pixel with the ground behind it.
    assert not red[:80].any() and red.mean() < 0.005


def _without(textured: TexturedMesh, faces: int):  # type: ignore[no-untyped-def]
    from dataclasses import replace

    atlas = textured.atlas
    return replace(atlas, corners=atlas.corners[:faces], pages=atlas.pages[:faces])


def test_what_the_mesh_lacks_is_not_painted_where_most_pictures_disagree() -> None:
    """A post that is in the nearest picture but not in the mesh."""
    pictures = [photograph(c) for c in CAMERAS]
    with_post = pictures[2].copy()
    with_post[:, 110:130] = (0.0, 1.0, 0.0)
    clean = painted(COURT, [view(c, p) for c, p in zip(CAMERAS, pictures, strict=True)])
    spoilt = painted(COURT, [view(c, p) for c, p in zip(CAMERAS, [*pictures[:2], with_post], strict=True)])
    green = [int(((i[..., 1] > 180) & (i[..., 0] < 90)).sum()) for i in (clean.images[0], spoilt.images[0])]
    seen_once = int((np.abs(clean.images[0].astype(int) - spoilt.images[0]).max(axis=2) > 40).sum())
    assert green[0] == 0 and green[1] <= seen_once < 0.05 * clean.images[0].shape[0] * clean.images[0].shape[1]


def test_a_triangle_larger_than_the_picture_is_painted() -> None:
    """None of its corners is in the picture."""
    wall = grid(np.array([WALL_X, -30, -30]), np.array([0, 60.0, 0]), np.array([0, 0, 60.0]), 1)
    camera = camera_at(0.0, 0.0)
    picture = photograph(camera, wall)
    textured = painted(wall, [view(camera, picture)], 0.06)
    shown = render_textured_picture(textured, camera)
    assert psnr(shown, picture, np.ones(shown.shape[:2], bool)) > 20
    assert np.abs(shown.astype(int) - 110).max() > 60  # not the vertices' grey


def test_what_no_picture_shows_has_the_colours_of_the_vertices() -> None:
    textured = painted(COURT, [])
    inside = textured.images[0]
    assert (np.abs(inside.astype(int) - 110) <= 1).all()
