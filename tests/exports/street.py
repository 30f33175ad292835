"""One small finished workspace for all tests of exports: surveyed far off, in other units, y up, 16-bit footage in a lens."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import torch

from tests.evaluate.street_workspace import CARS, OFFSET, build_workspace
from tests.mesh.street import cast, street_camera
from tests.other_frame import Y_UP_UTM
from unveil_core.base.files import write_image_atomic, write_json_atomic
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.points import write_points
from unveil_core.inpaint.origin import CONTINUED
from unveil_core.mesh import Mesh, write_ply
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.ply import write_surfels
from unveil_core.surfels.scene_edit import NOT_SHORTENED, SceneEdit, write_edit
from unveil_core.surfels.surfels import Surfels, concatenate
from unveil_core.workspace.files import save_array

WORLD = Y_UP_UTM
ROAD, CAR = 0, 13
LENS = {"model": "OPENCV", "coefficients": [-0.05, 0.01, 0.001, -0.002, 0.0, 0.0, 0.0, 0.0]}
WIDTH, HEIGHT, FRAMES, LARGER = 64, 48, 3, 2
SEEDS = 40
"""Surfels of the empty street that are new, in the test."""


def make_workspace(root: Path) -> Path:
    """The workspace; returns its folder."""
    workspace = build_workspace(root, count=FRAMES, width=WIDTH, height=HEIGHT, truth=False)
    origin = _put_elsewhere(workspace)
    shift = OFFSET - origin
    _write_scene(workspace, shift)
    _write_points(workspace, shift)
    _write_mesh(workspace)
    boxes = [
        {
            "id": number,
            "class": "car",
            "removed": number < 3,
            "frames": FRAMES,
            "first_frame": "0000",
            "last_frame": "0002",
            "box": {
                "centre": [car.x + shift[0], car.y + shift[1], car.height / 2 + shift[2]],
                "size": [4, 1.8, 1.5],
                "yaw": -np.pi / 2,  # along x: a workspace counts from the east axis of up_frame
            },
        }
        for number, car in enumerate(CARS, start=1)
    ]
    write_json_atomic(workspace / "instances.json", boxes)
    counts = [5000, 1000]
    labels = {"names": ["road", "car"], "disk_ids": [ROAD, CAR], "source": "semantics", "pixel_counts": counts}
    write_json_atomic(workspace / "labels.json", labels)
    write_json_atomic(workspace / "selection.json", {"removed": [], "instances": [1, 2]})
    return workspace


def _put_elsewhere(workspace: Path) -> np.ndarray:
    """Give the imported drive another frame, time stamps and larger footage; returns where its local origin was."""
    path = workspace / "drive/cameras.json"
    data = json.loads(path.read_text())
    origin = np.array(data["to_world"]["translation"])
    data.update(to_world=WORLD.to_json(), scale_source="given", frame_rate=10.0)
    rng = np.random.default_rng(3)
    for i, entry in enumerate(data["frames"]):
        name = f"front/{entry['name']}.png"
        picture = rng.integers(0, 65536, (HEIGHT * LARGER, WIDTH * LARGER, 3)).astype(np.uint16)
        write_image_atomic(workspace / "frames" / name, picture)
        write_image_atomic(workspace / "drive/footage" / name, picture)
        numbers = {key: entry[key] * LARGER for key in ("width", "height", "fx", "fy", "cx", "cy")}
        entry["footage"] = {"image": f"footage/{name}", "distortion": LENS, **numbers}
        entry["timestamp"] = 100.0 + 0.1 * i
        origins = rng.integers(0, 5, (HEIGHT, WIDTH)).astype(np.uint8)
        write_image_atomic(workspace / "provenance" / name, origins)
        write_image_atomic(workspace / "certainty" / name, np.where(origins == 0, 255, 100).astype(np.uint8))
    path.write_text(json.dumps(data))
    return origin


def _surfels(depth: np.ndarray, rgb: np.ndarray, labels: np.ndarray, shift: np.ndarray) -> Surfels:
    """A surfel for every second pixel that shows a surface, with colours by direction."""
    camera = street_camera(0.0, WIDTH, HEIGHT)
    points = camera.unproject(depth)
    solid = (depth > 0) & (np.indices(depth.shape).sum(axis=0) % 2 == 0)
    normals = np.tile([0.0, 0.0, 1.0], (int(solid.sum()), 1))
    spacing = depth[solid] / camera.fx * 2
    colors = np.round(rgb[solid] * 255).astype(np.uint8)
    made = surfels_from_points(points[solid] + shift, colors, labels[solid], normals, spacing, sh_degree=2, opacity=0.8)
    generator = torch.Generator().manual_seed(4)
    sh = made.sh.clone()
    sh[:, 1:] = 0.1 * torch.randn(sh[:, 1:].shape, generator=generator)
    quats = made.quats + 0.2 * torch.randn(made.quats.shape, generator=generator)
    scales = made.log_scales + 0.3 * torch.randn(made.log_scales.shape, generator=generator)
    # Of an image's row all would have one depth from its camera, and rounding would decide which is drawn first.
    means = made.means + 0.02 * torch.randn(made.means.shape, generator=generator)
    return Surfels(means, quats, scales, made.opacity_logits, sh, made.labels)


def _write_scene(workspace: Path, shift: np.ndarray) -> None:
    camera = street_camera(0.0, WIDTH, HEIGHT)
    full, street = cast(camera, CARS), cast(camera)
    labels = (full["car"] > 0).astype(np.int64)
    scene = _surfels(full["depth"], full["rgb"], labels, shift)
    solid = (full["depth"] > 0) & (np.indices(labels.shape).sum(axis=0) % 2 == 0)
    instances = full["car"][solid]
    gone = (instances == 1) | (instances == 2)
    seeds = _surfels(street["depth"], street["rgb"], np.zeros_like(labels), shift).select(torch.arange(SEEDS))
    empty = concatenate([scene.select(torch.from_numpy(~gone)), seeds])
    write_surfels(scene, workspace / "surfels/full.ply", to_world=WORLD)
    write_surfels(empty, workspace / "surfels/empty.ply", to_world=WORLD)
    save_array(instances.astype(np.int64), workspace / "surfels/instances.npy")
    nothing = np.zeros(len(scene), dtype=bool)
    origin = np.full(SEEDS, CONTINUED, np.uint8)
    write_edit(SceneEdit(gone, NOT_SHORTENED, nothing, nothing, seeds, origin), workspace / "surfels/edit.npz")


def _write_points(workspace: Path, shift: np.ndarray) -> None:
    """Points of the street and of its cars, labelled; some of the first car's have no label but lie in its box."""
    camera = street_camera(0.0, WIDTH, HEIGHT)
    seen = cast(camera, CARS)
    solid = seen["depth"] > 0
    positions = camera.unproject(seen["depth"])[solid] + shift
    colors = np.round(seen["rgb"][solid] * 255).astype(np.uint8)
    objects = seen["car"][solid]
    labels = np.where(objects > 0, CAR, ROAD).astype(np.uint8)
    missed = (objects == 1) & (np.arange(len(objects)) % 3 == 0)
    labels[missed] = 255
    write_points(PointCloud(positions, colors), workspace / "drive/points.ply")
    (workspace / "objects").mkdir()
    save_array(labels, workspace / "objects/point_labels.npy")
    save_array(np.where(missed, 0, objects).astype(np.uint16), workspace / "objects/point_objects.npy")


def _write_mesh(workspace: Path) -> None:
    """A rolling sheet."""
    x, y = np.meshgrid(np.linspace(0, 10, 12), np.linspace(-3, 3, 9))
    vertices = np.stack([x.ravel(), y.ravel(), 0.2 * np.sin(x).ravel()], axis=1).astype(np.float32)
    first = (np.arange(8)[:, None] * 12 + np.arange(11)).ravel()
    faces = np.concatenate(
        [np.stack([first, first + 1, first + 12], 1), np.stack([first + 1, first + 13, first + 12], 1)]
    )
    colors = np.random.default_rng(5).integers(0, 256, (len(vertices), 3)).astype(np.uint8)
    for state in ("empty", "full"):
        write_ply(Mesh(vertices, faces.astype(np.int32), colors), workspace / f"meshes/{state}.ply", WORLD)
