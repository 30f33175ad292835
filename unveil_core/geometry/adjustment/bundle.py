"""Bundle adjustment: small motions of the cameras, and places, that explain all observations of tracks together.

Triggs et al., *Bundle adjustment: a modern synthesis* (2000), with the places eliminated (section 6.1), Huber's weights, and the
given poses as a prior: it says where the drive lies, how large it is, and what no photograph tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, csc_array, csr_array
from scipy.sparse.linalg import splu

from unveil_core.base.types import Float64
from unveil_core.geometry.adjustment.tracks import Tracks
from unveil_core.geometry.camera import Camera

__all__ = ["Motions", "adjusted", "reprojection_errors", "triangulated"]

PIXEL = 0.5
"""Standard deviation of an observation, pixels; residuals beyond twice as much count by Huber's weights."""
SHIFT_M, TURN_RAD = 0.3, 0.02
"""Standard deviations of the given poses, metres and radians: what satellites, and an inertial unit or odometry, are off by."""
ROUNDS, SMALL = 15, 1e-4
"""Gauss-Newton steps at most, and the relative gain that ends them."""
PASSES = 3
"""How often places are found anew and all is adjusted again."""
WRONG_PX = 4.0
"""Error beyond which an observation is a wrong match, once all has been adjusted to all of them, pixels."""
FARTHEST_M = 2000.0
"""Where a place lies that no two rays tell the distance of, metres."""


@dataclass(frozen=True, eq=False)
class Motions:
    """Rigid motions by which what is fixed to the vehicle moves, one for each moment: x -> R (x - pivot) + pivot + shift.

    Attributes:
        rotations: (K, 3, 3); shifts: (K, 3) metres; pivots: (K, 3).
    """

    rotations: Float64
    shifts: Float64
    pivots: Float64

    @staticmethod
    def none(pivots: Float64) -> Motions:
        """That nothing moves; ``pivots``: (K, 3)."""
        return Motions(np.tile(np.eye(3), (len(pivots), 1, 1)), np.zeros_like(pivots), pivots)

    def of_points(self, points: Float64, moment: int) -> Float64:
        """World points (N, 3) that were measured from the vehicle in a moment, moved with it."""
        pivot = self.pivots[moment]
        return np.asarray((points - pivot) @ self.rotations[moment].T + pivot + self.shifts[moment])

    def of_camera(self, camera: Camera, moment: int) -> Camera:
        """A camera of a moment, moved with it."""
        pose = camera.world_to_camera.copy()
        pose[:3, :3] = pose[:3, :3] @ self.rotations[moment].T
        pose[:3, 3] = -pose[:3, :3] @ self.of_points(camera.centre[None], moment)[0]
        return replace(camera, world_to_camera=pose)

    @property
    def turned_rad(self) -> Float64:
        """(K,) angles."""
        trace = self.rotations.trace(axis1=1, axis2=2)
        return np.asarray(np.arccos(np.clip((trace - 1) / 2, -1, 1)))


def _rays(cameras: Sequence[Camera], tracks: Tracks) -> tuple[Float64, Float64]:
    """Centres (M, 3) and unit directions (M, 3) of the observations."""
    centre = np.stack([c.centre for c in cameras])[tracks.view]
    turn = np.stack([c.world_to_camera[:3, :3] for c in cameras])[tracks.view]
    fx, fy, cx, cy = np.array([[c.fx, c.fy, c.cx, c.cy] for c in cameras])[tracks.view].T
    local = np.stack([(tracks.pixel[:, 0] - cx) / fx, (tracks.pixel[:, 1] - cy) / fy, np.ones(len(fx))], axis=1)
    ray = np.einsum("mji,mj->mi", turn, local)
    return centre, ray / np.linalg.norm(ray, axis=1, keepdims=True)


def triangulated(cameras: Sequence[Camera], tracks: Tracks) -> Float64:
    """(P, 3) the places nearest to the rays of their observations."""
    centre, ray = _rays(cameras, tracks)
    across = np.eye(3) - ray[:, :, None] * ray[:, None]
    normal, wanted = np.zeros((tracks.count, 3, 3)), np.zeros((tracks.count, 3))
    np.add.at(normal, tracks.point, across)
    np.add.at(wanted, tracks.point, np.einsum("mij,mj->mi", across, centre))
    count = np.bincount(tracks.point)
    middle, ahead = np.zeros((tracks.count, 3)), np.zeros((tracks.count, 3))
    np.add.at(middle, tracks.point, centre)
    np.add.at(ahead, tracks.point, ray)
    middle /= count[:, None]
    # A weak pull to far ahead: of rays that are parallel nothing else tells the distance.
    pull = 1e-12 * count[:, None, None] * np.eye(3)
    far = middle + FARTHEST_M * ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
    place = np.linalg.solve(normal + pull, (wanted + np.einsum("pij,pj->pi", pull, far))[..., None])[..., 0]
    along = np.einsum("pi,pi->p", place - middle, ahead)
    return np.where((along > 0.1)[:, None], place, far)


def _seen(cameras: Sequence[Camera], tracks: Tracks, places: Float64) -> tuple[Float64, Float64, Float64, Float64]:
    """Of each observation: residual (M, 2), the place in its camera's axes (M, 3), its rotation (M, 3, 3), focal lengths (M, 2)."""
    turn = np.stack([c.world_to_camera[:3, :3] for c in cameras])[tracks.view]
    shift = np.stack([c.world_to_camera[:3, 3] for c in cameras])[tracks.view]
    numbers = np.array([[c.fx, c.fy, c.cx, c.cy] for c in cameras])[tracks.view]
    local = np.einsum("mij,mj->mi", turn, places[tracks.point]) + shift
    depth = np.where(np.abs(local[:, 2:]) > 1e-3, local[:, 2:], 1e-3)
    pixel = local[:, :2] / depth * numbers[:, :2] + numbers[:, 2:]
    return pixel - tracks.pixel, np.concatenate([local[:, :2], depth], axis=1), turn, numbers[:, :2]


def reprojection_errors(cameras: Sequence[Camera], tracks: Tracks, places: Float64) -> Float64:
    """(M,) pixels between observations and places (P, 3)."""
    return np.asarray(np.linalg.norm(_seen(cameras, tracks, places)[0], axis=1))


def _weights(residual: Float64) -> Float64:
    """(M,) Huber's, over the variance of an observation."""
    away = np.linalg.norm(residual, axis=1)
    return np.asarray(np.minimum(1.0, 2 * PIXEL / np.maximum(away, 1e-9)) / PIXEL**2)


def _cost(residual: Float64, motions: Motions) -> float:
    away = np.linalg.norm(residual, axis=1) / PIXEL
    robust = np.where(away < 2, away**2, 4 * away - 4).sum()
    return float(robust + (motions.shifts**2).sum() / SHIFT_M**2 + (motions.turned_rad**2).sum() / TURN_RAD**2)


def adjusted(
    cameras: Sequence[Camera], moment: NDArray[np.int64], pivots: Float64, tracks: Tracks
) -> tuple[Motions, Float64]:
    """The motions (of K moments) and places (P, 3) that explain the tracks best.

    Args:
        cameras: of the V photographs, as given; moment: (V,) which moment each belongs to: cameras of a rig move together.
        pivots: (K, 3) about which the vehicle turns.
    """
    motions = Motions.none(pivots)
    places = triangulated(cameras, tracks)
    trusted = np.ones(len(tracks.view), dtype=bool)
    for _ in range(PASSES):
        now = [motions.of_camera(c, k) for c, k in zip(cameras, moment, strict=True)]
        # A place that wrong poses put behind a camera finds no way back by small steps.
        anew = triangulated(now, tracks)
        better = _worst(now, tracks, anew) < _worst(now, tracks, places)
        places = np.where(better[:, None], anew, places)
        motions, places = _descended(cameras, moment, motions, tracks, places, trusted)
        now = [motions.of_camera(c, k) for c, k in zip(cameras, moment, strict=True)]
        trusted = reprojection_errors(now, tracks, places) < WRONG_PX
    return motions, places


def _worst(cameras: Sequence[Camera], tracks: Tracks, places: Float64) -> Float64:
    """(P,) the largest error of a place's observations, pixels."""
    worst = np.zeros(tracks.count)
    np.maximum.at(worst, tracks.point, reprojection_errors(cameras, tracks, places))
    return worst


def _descended(
    cameras: Sequence[Camera],
    moment: NDArray[np.int64],
    motions: Motions,
    tracks: Tracks,
    places: Float64,
    trusted: NDArray[np.bool_],
) -> tuple[Motions, Float64]:
    """Motions and places after Gauss-Newton steps, as long as they gain; ``trusted``: (M,) observations that count."""
    now = [motions.of_camera(c, k) for c, k in zip(cameras, moment, strict=True)]
    cost, damping = _cost(_seen(now, tracks, places)[0][trusted], motions), 1e-4
    for _ in range(ROUNDS):
        turn, step = _step(now, moment, motions, tracks, places, trusted, damping)
        trial = Motions(_turned(turn[:, :3]) @ motions.rotations, motions.shifts + turn[:, 3:], motions.pivots)
        there = [trial.of_camera(c, k) for c, k in zip(cameras, moment, strict=True)]
        after = _cost(_seen(there, tracks, places + step)[0][trusted], trial)
        if not after < cost:
            damping *= 10
            if damping > 1e3:
                break
            continue
        done = cost - after < SMALL * cost
        motions, places, now, cost, damping = trial, places + step, there, after, max(damping / 5, 1e-7)
        if done:
            break
    return motions, places


def _crosses(vectors: Float64) -> Float64:
    """(N, 3, 3) matrices that multiply by vectors (N, 3) from the left, as the cross product does."""
    cross = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -z, y, -x
    return np.asarray(cross - cross.transpose(0, 2, 1))


def _turned(turn: Float64) -> Float64:
    """(K, 3, 3) rotations of rotation vectors (K, 3), Rodrigues."""
    angle = np.linalg.norm(turn, axis=1)[:, None, None]
    cross = _crosses(turn)
    return np.asarray(
        np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(angle / 2 / np.pi) ** 2 * cross @ cross
    )


def _step(
    cameras: Sequence[Camera],
    moment: NDArray[np.int64],
    motions: Motions,
    tracks: Tracks,
    places: Float64,
    trusted: NDArray[np.bool_],
    damping: float,
) -> tuple[Float64, Float64]:
    """A damped Gauss-Newton step: turns and shifts (K, 6) and places (P, 3)."""
    residual, local, turn, focal = _seen(cameras, tracks, places)
    count, own = len(motions.shifts), moment[tracks.view]
    depth = local[:, 2]
    by_local = np.zeros((len(local), 2, 3))
    by_local[:, 0, 0], by_local[:, 1, 1] = (focal / depth[:, None]).T
    by_local[:, :, 2] = -focal * local[:, :2] / depth[:, None] ** 2
    by_place = by_local @ turn
    # The vehicle turned by w about its pivot sees a place as if that had turned by -w: its arm crossed with w.
    arm = places[tracks.point] - motions.pivots[own] - motions.shifts[own]
    by_motion = np.concatenate([by_place @ _crosses(arm), -by_place], axis=2)
    weight = _weights(residual) * trusted
    weighted = by_motion.transpose(0, 2, 1) * weight[:, None, None]
    normal = np.zeros((count, 6, 6))
    np.add.at(normal, own, weighted @ by_motion)
    right = np.zeros((count, 6))
    np.add.at(right, own, -np.einsum("mij,mj->mi", weighted, residual))
    prior = np.repeat([1 / TURN_RAD**2, 1 / SHIFT_M**2], 3)
    normal += np.diag(prior)
    right -= prior * np.concatenate([_vectors(motions.rotations), motions.shifts], axis=1)
    of_place = np.zeros((tracks.count, 3, 3))
    place_weighted = by_place.transpose(0, 2, 1) * weight[:, None, None]
    np.add.at(of_place, tracks.point, place_weighted @ by_place)
    place_right = np.zeros((tracks.count, 3))
    np.add.at(place_right, tracks.point, -np.einsum("mij,mj->mi", place_weighted, residual))
    diagonal = np.arange(3)
    of_place[:, diagonal, diagonal] *= 1 + damping
    of_place[:, diagonal, diagonal] += 1e-9
    inverse = np.linalg.inv(of_place).astype(np.float64)
    steps = np.arange(6)
    normal[:, steps, steps] *= 1 + damping
    # One block for each observation; those of a moment and a place add up when they are multiplied.
    joint = csr_array(_blocks(weighted @ by_place, own, tracks.point, (count, tracks.count)))
    moments, all_places = np.arange(count), np.arange(tracks.count)
    own_blocks = _blocks(normal, moments, moments, (count, count))
    reduced = csr_array(own_blocks) - joint @ _blocks(inverse, all_places, all_places, (tracks.count,) * 2) @ joint.T
    solved = splu(csc_array(reduced)).solve(
        right.ravel() - joint @ np.einsum("pij,pj->pi", inverse, place_right).ravel()
    )
    moved = place_right.ravel() - joint.T @ solved
    return solved.reshape(count, 6), np.einsum("pij,pj->pi", inverse, moved.reshape(-1, 3))


def _blocks(values: Float64, row: NDArray[np.int64], column: NDArray[np.int64], shape: tuple[int, int]) -> bsr_array:
    """Sparse matrix of blocks (M, R, C) at some rows and columns of blocks; ``shape``: how many of these there are."""
    order = np.lexsort((column, row))
    pointer = np.searchsorted(row[order], np.arange(shape[0] + 1))
    size = (shape[0] * values.shape[1], shape[1] * values.shape[2])
    return bsr_array((values[order], column[order], pointer), shape=size)


def _vectors(rotations: Float64) -> Float64:
    """(K, 3) rotation vectors of small rotations (K, 3, 3)."""
    skew = 0.5 * (rotations - rotations.transpose(0, 2, 1))
    return np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
