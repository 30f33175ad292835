"""The pinhole camera that everything after import uses.

Conventions (OpenCV): x right, y down, z forward; pixel centres at integer + 0.5; ``world_to_camera`` maps homogeneous
world points to camera points. Lens distortion is gone by the time a Camera exists: images are undistorted on import.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.parallel import in_parallel
from unveil_core.base.types import Float64
from unveil_core.geometry.projection import project_shown
from unveil_core.geometry.transforms import rigid_inverse

__all__ = ["Camera"]

POINTS = 16_384
"""That a thread projects at a time: some tenths of a millisecond of work."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera with a pose.

    Attributes:
        width, height: image size in pixels.
        fx, fy: focal lengths in pixels.
        cx, cy: principal point in pixels, counted from the outer edge of the first pixel (its centre is 0.5).
        world_to_camera: (4, 4) float64 rigid transform.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    world_to_camera: Float64

    @property
    def intrinsics(self) -> tuple[int, int, float, float, float, float]:
        """width, height, fx, fy, cx, cy: the same for all frames of a camera."""
        return self.width, self.height, self.fx, self.fy, self.cx, self.cy

    @property
    def K(self) -> Float64:
        """(3, 3) intrinsics of pixels whose centres lie at integer + 0.5: what gsplat and nerfstudio call so."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def viewmat(self) -> Float64:
        """(4, 4) from world to camera, x right, y down, z forward: :attr:`world_to_camera` by the name that gsplat gives it."""
        return self.world_to_camera

    @property
    def opencv_matrix(self) -> Float64:
        """(3, 3) intrinsics for functions of cv2 alone, whose pixel centres lie at integers: half a pixel from :attr:`K`."""
        return self.K - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]

    @property
    def camera_to_world(self) -> Float64:
        """(4, 4) float64 inverse of :attr:`world_to_camera`, exact for a rigid transform."""
        return rigid_inverse(self.world_to_camera)

    @property
    def centre(self) -> Float64:
        """(3,) float64 position of the optical centre in the world."""
        return -self.world_to_camera[:3, :3].T @ self.world_to_camera[:3, 3]

    @property
    def forward(self) -> Float64:
        """(3,) float64 unit viewing direction in the world."""
        return self.world_to_camera[2, :3].copy()

    def homography(self, other: Camera, normal: Float64, distance: float) -> Float64 | None:
        """(3, 3) from the pixels of this camera to those of another one, both as :attr:`opencv_matrix` has them, of what lies on a
        plane; None where it takes the first pixel to infinity (Hartley and Zisserman, *Multiple View Geometry*, 13.1).

        Args:
            normal: (3,) of the plane in this camera's axes, away from the camera; distance: of the plane from it.
        """
        to_other = other.world_to_camera @ self.camera_to_world
        plane = to_other[:3, :3] + np.outer(to_other[:3, 3], normal) / distance
        found = other.opencv_matrix @ plane @ np.linalg.inv(self.opencv_matrix)
        return np.asarray(found / found[2, 2]) if abs(found[2, 2]) > 1e-9 else None

    def moved(self, *, right: float = 0.0, up: float = 0.0, ahead: float = 0.0) -> Camera:
        """The same camera so many metres (or units) to its right, up and ahead; negative the other way."""
        pose = self.world_to_camera.copy()
        pose[:3, 3] -= (right, -up, ahead)
        return replace(self, world_to_camera=pose)

    def resized(self, width: int, height: int) -> Camera:
        """The same view sampled on another pixel grid."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self, width=width, height=height, fx=self.fx * sx, fy=self.fy * sy, cx=self.cx * sx, cy=self.cy * sy
        )

    def project(self, points: Float64) -> tuple[Float64, Float64]:
        """Project world points.

        Args:
            points: (N, 3) world positions.
        Returns:
            pixels (N, 2) float64, and depth along the optical axis (N,); pixels are meaningless where depth <= 0.
        """
        local = points @ self.world_to_camera[:3, :3].T + self.world_to_camera[:3, 3]
        depth = local[:, 2]
        # In the plane of the camera a pixel is infinite, and just beside it larger than any number.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            x = local[:, 0] / depth * self.fx + self.cx
            y = local[:, 1] / depth * self.fy + self.cy
        return np.stack([x, y], axis=1), depth

    def in_picture(self, pixels: Float64, depth: Float64, *, nearest: float = 1e-6) -> NDArray[np.bool_]:
        """(N,) bool, which of what :meth:`project` gave lies before the camera and within its picture.

        Args:
            pixels: (N, 2); depth: (N,).
            nearest: depth that a point must exceed, metres.
        """
        inside: NDArray[np.bool_] = (depth > nearest) & (pixels >= 0).all(axis=1)
        return inside & (pixels[:, 0] < self.width) & (pixels[:, 1] < self.height)

    @property
    def pose(self) -> tuple[Float64, Float64]:
        """(3, 3) rotation and (3,) translation from world to camera."""
        return np.ascontiguousarray(self.world_to_camera[:3, :3]), self.world_to_camera[:3, 3].copy()

    def shown(
        self, points: Float64, *, nearest: float = 1e-6, furthest: float = np.inf
    ) -> tuple[NDArray[np.int64], Float64, Float64]:
        """The world points that fall into the picture: of many of which few do, faster than :meth:`project`.

        Args:
            points: (N, 3).
            nearest, furthest: depths between which they lie, metres.
        Returns:
            which (M,), rising; their pixels (M, 2); their depth (M,).
        """
        found = np.empty((len(points), 3))
        places = np.ascontiguousarray(points, dtype=np.float64)
        in_parallel(project_shown, len(places), POINTS, places, *self.pose, self.intrinsics, nearest, furthest, found)
        index = np.flatnonzero(found[:, 2])
        found = found[index]
        return index, found[:, :2], found[:, 2]

    def fall_in(self, points: Float64, mask: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which world points (N, 3) lie in the picture, and which of these in the ``mask`` (H, W); each (N,) bool."""
        index, pixels, _ = self.shown(points)
        inside, masked = np.zeros((2, len(points)), dtype=bool)
        column, row = pixels.astype(np.int64).T
        inside[index], masked[index] = True, mask[row, column]
        return inside, masked

    @property
    def longest_ray(self) -> float:
        """Distance from the camera over depth along its axis, at most: that of the farthest corner."""
        across = max(self.cx, self.width - self.cx) / self.fx
        down = max(self.cy, self.height - self.cy) / self.fy
        return float(np.sqrt(1 + across**2 + down**2))

    def rays(self) -> Float64:
        """(H, W, 3) float64 world directions through the pixel centres with unit component along the optical axis,
        so that ``centre + depth * ray`` is the point at that depth."""
        xs = (np.arange(self.width) + 0.5 - self.cx) / self.fx
        ys = (np.arange(self.height) + 0.5 - self.cy) / self.fy
        local = np.stack(np.broadcast_arrays(xs[None, :], ys[:, None], np.ones((1, 1))), axis=-1)
        return local @ self.world_to_camera[:3, :3]

    def below_horizon(self, up: Float64) -> NDArray[np.bool_]:
        """(H, W) pixels whose rays go down, against ``up`` (3,): they cannot show the sky."""
        return np.asarray(self.rays() @ up < 0)

    def rays_at(self, pixels: Float64) -> Float64:
        """(N, 3) world directions through image positions (N, 2), as :meth:`rays` has them for the pixel centres."""
        x, y = (pixels[:, 0] - self.cx) / self.fx, (pixels[:, 1] - self.cy) / self.fy
        return np.stack([x, y, np.ones(len(pixels))], axis=1) @ self.world_to_camera[:3, :3]

    def unproject(self, depth: NDArray[np.floating]) -> Float64:
        """World points (H, W, 3) at ``depth`` (H, W) along the optical axis."""
        return self.centre + self.rays() * np.asarray(depth, dtype=np.float64)[..., None]
