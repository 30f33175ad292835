"""Frames along a wall with a gap that nobody saw: the last one invents, the network with a reference paints the others by it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.inpaint.networks import from_reference
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.frames.holes import FrameTask, open_hole
from unveil_core.inpaint.frames.keyframes import plan_keyframes
from unveil_core.inpaint.frames.propagate import Painted, RemainingScene, propagate_inpainting
from unveil_core.inpaint.single_image.onnx_models import load_reference
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

WIDTH, HEIGHT, WALL_M, FRAMES = 96, 64, 6.0, 3
WALL, INVENTED = (150, 110, 70), (20, 200, 90)


def camera_at(x: float) -> Camera:
    pose = np.eye(4)
    pose[0, 3] = -x
    return Camera(WIDTH, HEIGHT, 80.0, 80.0, WIDTH / 2, HEIGHT / 2, pose)


def wall_with_a_gap() -> Surfels:
    y, x = np.mgrid[-3.2:3.2:0.06, -6:6:0.06]
    points = np.stack([x.ravel(), y.ravel(), np.full(x.size, WALL_M)], axis=1)
    points = points[(np.abs(points[:, 0]) > 0.8) | (np.abs(points[:, 1]) > 0.8)]
    count = len(points)
    return surfels_from_points(
        points,
        np.tile(np.array(WALL, np.uint8), (count, 1)),
        np.zeros(count, np.int64),
        np.tile([0.0, 0.0, -1.0], (count, 1)),
        np.full(count, 0.06),
        opacity=0.95,
    )


def frames() -> list[FrameTask]:
    tasks = []
    for i in range(FRAMES):
        camera = camera_at(0.3 * i)
        points = camera.centre + WALL_M * camera.rays()
        gone = (np.abs(points[..., 0]) < 0.85) & (np.abs(points[..., 1]) < 0.85)
        image = np.where(gone[..., None], (250, 0, 0), WALL).astype(np.uint8)
        tasks.append(FrameTask(camera, image, gone, gone))
    return tasks


def paint(order: str, reference) -> tuple[list[Painted], list[int]]:
    """The frames, and how many pixels each call of the single-image inpainter had to fill."""
    asked: list[int] = []

    def invent(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
        asked.append(int(mask.sum()))
        return np.where(mask[..., None], INVENTED, image).astype(np.uint8)

    sky, wall, tasks = Sky(torch.zeros(3, 8, 16), np.eye(3)), wall_with_a_gap(), frames()
    holes = [open_hole(task, wall, None) for task in tasks]
    plan = None if order == "independent" else plan_keyframes(holes, range(FRAMES), order=order)
    done: dict[int, Painted] = {}
    scene = RemainingScene(wall, sky, None, 1)
    propagate_inpainting(tasks, scene, invent, done.setdefault, plan=plan, reference=reference)  # type: ignore[arg-type]
    return [done[i] for i in range(FRAMES)], asked


class Recolours:
    """In place of a network: what the middle of the reference shows, with a blue that counts its calls."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, image: np.ndarray, mask: np.ndarray, reference: np.ndarray) -> np.ndarray:
        self.calls += 1
        middle = reference[reference.shape[0] // 2, reference.shape[1] // 2].copy()
        middle[2] = 200 + self.calls
        return np.where(mask[..., None], middle, image).astype(np.uint8)


@pytest.mark.parametrize(("order", "first"), [("reverse", FRAMES - 1), ("forward", 0)])
def test_the_first_frame_invents_and_the_network_paints_the_others_by_it(order: str, first: int) -> None:
    network = Recolours()
    done, asked = paint(order, network)
    assert network.calls == FRAMES - 1 and len(asked) == 1 and asked[0] > 300
    for i, (task, painted) in enumerate(zip(frames(), done, strict=True)):
        middle = painted.image[HEIGHT // 2, WIDTH // 2 - round(0.3 * i * 80 / WALL_M)]
        assert np.abs(middle[:2].astype(int) - INVENTED[:2]).max() <= 2, "the reference shows what was invented"
        assert middle[2] == INVENTED[2] if i == first else middle[2] > 200
        assert np.array_equal(painted.image[~task.removed], task.image[~task.removed])


def test_without_a_network_surfels_carry_and_independent_frames_use_none() -> None:
    done, asked = paint("reverse", None)
    assert asked[0] > 300 and sum(asked[1:]) < 0.2 * asked[0]
    network = Recolours()
    _, alone = paint("independent", network)
    assert network.calls == 0 and len(alone) == FRAMES and min(alone) > 300


def test_a_real_network_paints_what_the_surfels_would_carry(tmp_path: Path) -> None:
    """One that takes the reference where the mask is: it is shown the right part of the right frame at the right scale."""
    done, _ = paint("reverse", load_reference(from_reference(tmp_path / "reference.onnx")))
    for i, painted in enumerate(done):
        column = WIDTH // 2 - round(0.3 * i * 80 / WALL_M)
        inner = painted.image[HEIGHT // 2 - 8 : HEIGHT // 2 + 8, column - 8 : column + 8]
        assert np.abs(inner.astype(int) - INVENTED).max() <= 3
