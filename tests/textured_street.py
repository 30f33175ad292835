"""A crowned street between two walls, rough all over, ray-cast with numpy: what photographs tell of it is told by its textures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from unveil_core.geometry.camera import Camera

WIDTH, HEIGHT, FOCAL = 240, 160, 170.0
WALL_M, TOP_M, KERB_M = 5.0, 6.0, 2.8
LOW, HIGH = np.array([11.0, -4.0, 0.0]), np.array([14.0, -2.2, 1.5])
"""A box that stands on the right."""
GROUND, WALL, BOX, SKY = 0, 1, 2, 3


@dataclass(frozen=True)
class TexturedStreet:
    """crown: metres by which the street is lower a metre aside of its middle, growing with the square; slope: metres a metre; kerb:
    height of a sidewalk on the left, from ``KERB_M`` on, metres; rough: contrast of all surfaces, 0 to 1; finest: length of
    their shortest waves, metres; paved: side of the slabs that the ground repeats, metres, None where it does not."""

    crown: float = 0.006
    slope: float = 0.0
    kerb: float = 0.0
    rough: float = 1.0
    finest: float = 0.3
    paved: float | None = None

    def height(self, p: np.ndarray) -> np.ndarray:
        """(N,) of the ground under places (N, 3)."""
        sidewalk = self.kerb * np.clip((p[:, 1] - KERB_M) / 0.1, 0, 1)
        return self.slope * p[:, 0] - self.crown * np.square(p[:, 1]) + sidewalk

    def camera(self, x: float, height: float = 1.5) -> Camera:
        """One that looks along the street, so many metres down it and so high over its middle."""
        turn = np.array([[0.0, -1.0, 0.0], [0.05, 0.0, -1.0], [1.0, 0.0, 0.05]])
        turn /= np.linalg.norm(turn, axis=1, keepdims=True)
        pose = np.eye(4)
        pose[:3, :3] = turn
        pose[:3, 3] = -turn @ (x, 0.0, self.slope * x + height)
        return Camera(WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, pose)

    def photograph(self, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
        """(H, W, 3) uint8, four rays a pixel, and what each pixel shows (H, W)."""
        total = np.zeros((HEIGHT, WIDTH))
        middle = camera.rays()
        for dx, dy in ((0.25, 0.25), (-0.25, 0.25), (0.25, -0.25), (-0.25, -0.25)):
            aside = (dx / FOCAL) * camera.camera_to_world[:3, 0] + (dy / FOCAL) * camera.camera_to_world[:3, 1]
            points, kind = self._meet(camera.centre, (middle + aside).reshape(-1, 3))
            total += self._shade(points, kind).reshape(HEIGHT, WIDTH) / 4
        kind = self._meet(camera.centre, middle.reshape(-1, 3))[1].reshape(HEIGHT, WIDTH)
        return np.repeat(total.round().astype(np.uint8)[..., None], 3, axis=2), kind

    def _meet(self, origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -origin[2] / rays[:, 2]
            for _ in range(8):  # the ground is nearly level: heights met so far correct the next guess
                at = origin + np.clip(t, -99, 99)[:, None] * rays
                t = (self.height(at) - origin[2]) / rays[:, 2]
            best = np.where((t > 0) & (t < 80), t, np.inf)
            kind = np.where(np.isfinite(best), GROUND, SKY)
            for side in (-WALL_M, WALL_M):
                t = (side - origin[1]) / rays[:, 1]
                over = (origin + t[:, None] * rays)[:, 2] - self.slope * (origin[0] + t * rays[:, 0])
                hit = (t > 0) & (t < np.minimum(best, 80)) & (over < TOP_M)
                best, kind = np.where(hit, t, best), np.where(hit, WALL, kind)
            raised = np.array([0, 0, self.slope * LOW[0]])
            a, b = (LOW - 0.5 * np.array([0, 0, 1]) + raised - origin) / rays, (HIGH + raised - origin) / rays
            enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
            hit = (enter > 0) & (enter < leave) & (enter < best)
            best, kind = np.where(hit, enter, best), np.where(hit, BOX, kind)
        return origin + np.where(np.isfinite(best), best, 0)[:, None] * rays, kind

    def _shade(self, p: np.ndarray, kind: np.ndarray) -> np.ndarray:
        """(N,) levels of 255: waves up to 2 m long in many directions."""
        generator = np.random.default_rng(7)
        total = np.zeros(len(p))
        for _ in range(24):
            direction = generator.normal(size=3)
            length = np.exp(generator.uniform(np.log(self.finest), np.log(2.0)))
            wave = 2 * np.pi / length * direction / np.linalg.norm(direction)
            total += np.sin(p @ wave + generator.uniform(0, 2 * np.pi))
        if self.paved is not None:
            along, across = 2 * np.pi / self.paved * p[:, 0], 2 * np.pi / self.paved * p[:, 1]
            slabs = 3 * np.sin(along) + 2 * np.sin(2 * along + 1) + np.cos(across)
            total = np.where(kind == GROUND, slabs + 0.4 * total, total)
        level = np.array([110.0, 150.0, 90.0, 220.0])[kind]
        return np.clip(level + np.where(kind == SKY, 0.0, self.rough * 12.0 * total), 0, 255)
