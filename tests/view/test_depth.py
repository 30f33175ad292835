"""The depth of a scene is one: who asks for it gets the same plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import torch

import unveil_core as unveil
from tests.exports.street import WORLD, make_workspace
from unveil_core.app.cli import main
from unveil_core.base.types import Float32
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Frame
from unveil_core.drives.imported import read_imported
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.origin import SEEN_ELSEWHERE
from unveil_core.mesh.views import depth_views
from unveil_core.provenance.origins import marked_by, rendered_origins
from unveil_core.raster.on_device import array, rendered
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.ply import read_surfels, write_surfels
from unveil_core.surfels.sky import Sky, save_sky
from unveil_core.surfels.surfels import Surfels, concatenate
from unveil_core.view.surface import ONE_SURFACE, scene_depth
from unveil_core.workspace.files import STEPS_PER_M, load_depth, save_depth

POST_M, WALL_M = 3.0, 9.0


def sheet(camera: Camera, depth_m: float, columns: slice) -> Surfels:
    """A surfel in each of some pixel columns of a camera, facing it, each as wide as two pixels and letting some light through."""
    points = camera.unproject(np.full((camera.height, camera.width), depth_m))[:, columns].reshape(-1, 3)
    count, size = len(points), depth_m / camera.fx
    colors, labels = np.full((count, 3), 120, np.uint8), np.zeros(count, np.int64)
    normals = np.tile(-camera.forward, (count, 1))
    return surfels_from_points(points, colors, labels, normals, np.full(count, 2 * size), opacity=0.5)


def post_before_wall(camera: Camera) -> Surfels:
    """A post, eight pixels wide, before a wall that fills the right two thirds of the picture; beyond it is the sky."""
    post = slice(camera.width // 2, camera.width // 2 + 8)
    return concatenate([sheet(camera, POST_M, post), sheet(camera, WALL_M, slice(camera.width // 3, None))])


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = make_workspace(tmp_path_factory.mktemp("depth"))
    scene = post_before_wall(first_frame(root).camera)
    write_surfels(scene, root / "surfels/empty.ply", to_world=WORLD)
    save_sky(Sky(torch.full((3, 4, 8), 0.7), np.eye(3)), root / "surfels/sky.npz")
    return root


def first_frame(root: Path) -> Frame:
    return read_imported(root / "drive", points=False).frames[0]


def empty_scene(root: Path) -> Surfels:
    return read_surfels(root / "surfels/empty.ply")


def of_the_stage(root: Path, tmp_path: Path) -> Float32:
    """As the stage reoptimize keeps it, and deliver reads it."""
    scene, camera = empty_scene(root), first_frame(root).camera
    _, depth = rendered_origins(marked_by(scene, np.full(len(scene), SEEN_ELSEWHERE, np.uint8)), camera)
    save_depth(depth, tmp_path / "depth.png")
    return load_depth(tmp_path / "depth.png", (camera.width, camera.height))


def of_the_mesh(root: Path, tmp_path: Path) -> Float32:
    return np.asarray(depth_views(empty_scene(root), [first_frame(root)], near=NEAR_M, far=FAR_M)[0].depth, np.float32)


def of_the_program(root: Path, tmp_path: Path) -> Float32:
    """As the evaluation asks for it, and what corrects frames by hand."""
    return scene_depth(empty_scene(root), first_frame(root).camera)


@pytest.mark.parametrize("reader", [of_the_stage, of_the_mesh, of_the_program])
def test_python_shows_the_depth_that_the_program_works_with(reader, workspace: Path, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    """To the precision of depth images, in all pixels: also where a post ends before a wall, and a wall before the sky."""
    told = unveil.Workspace.open(workspace).frames(size="work")[0].depth("empty")
    assert told.dtype == np.float32 and (told == 0).any()
    np.testing.assert_allclose(reader(workspace, tmp_path), told, rtol=0, atol=0.5 / STEPS_PER_M + 1e-6)


def test_exported_plates_have_it_in_the_drives_units(workspace: Path, tmp_path: Path) -> None:
    told = unveil.Workspace.open(workspace).frames()[0].depth("empty")
    assert main(["export", str(workspace), "--to", "exr", "-o", str(tmp_path)]) == 0
    with OpenEXR.File(str(tmp_path / "exr/front/front.1001.exr"), separate_channels=True) as file:
        plane = file.channels()["depth.Z"].pixels
    np.testing.assert_allclose(plane, told * WORLD.scale, rtol=1e-6)


def test_each_pixel_shows_a_surface_and_none_between_two(workspace: Path) -> None:
    """Beside a post the light of two surfaces is mixed; a depth between them would be a place where nothing is."""
    camera = first_frame(workspace).camera
    depth = scene_depth(empty_scene(workspace), camera)
    at_post, at_wall = (np.abs(depth / away - 1) < ONE_SURFACE for away in (POST_M, WALL_M))
    assert (at_post | at_wall | (depth == 0)).all() and at_post.sum() > 200 and at_wall.sum() > 500
    assert np.abs(depth[:, camera.width // 2 + 16 :] - WALL_M).max() < 0.01
    assert not scene_depth(empty_scene(workspace).select(torch.zeros(0, dtype=torch.int64)), camera).any()


def test_on_a_road_at_a_flat_angle_the_depth_is_smooth() -> None:
    """Many surfels that lie a little above and below each other stop the light there: their mean is nearer to the road than one."""
    camera = Camera(96, 64, 80.0, 80.0, 48.0, 4.0, np.eye(4))
    generator = np.random.default_rng(0)
    x, z = (a.ravel() for a in np.meshgrid(np.arange(-6, 6, 0.1), np.arange(1.5, 16, 0.1)))
    points = np.stack([x, 1.5 + generator.normal(0, 0.01, x.size), z], axis=1)
    colors, labels = np.full((len(points), 3), 120, np.uint8), np.zeros(len(points), np.int64)
    up = np.tile([0.0, -1.0, 0.0], (len(points), 1))
    road = surfels_from_points(points, colors, labels, up, np.full(len(points), 0.2), opacity=0.5)
    true = 1.5 / camera.rays()[24:, 30:66, 1]
    out = rendered(road, camera, ("median_depth",), near=NEAR_M, far=FAR_M)
    wrong, of_median = (np.abs(d[24:, 30:66] - true) for d in (scene_depth(road, camera), array(out.median_depth)))
    assert wrong.mean() < 0.7 * of_median.mean()
