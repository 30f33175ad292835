"""Where the cameras are at each frame: along the route, swaying a little, standing where there are lights."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sample_scenes.generators.streets.plan import Plan, Rig

HALT_NOISE_M = 0.006
"""Standard deviation of a standing frame's position on each axis, metres: about 1 cm in space, as positioning systems have it."""
HALT_DT_S = 0.4
"""Seconds between standing frames."""
ROUTE_STEP_M = 0.25


@dataclass(frozen=True, eq=False)
class Shot:
    """A frame: its camera, number, time in seconds, the pose it is rendered with and the one that the drive says, OpenGL (4, 4)."""

    camera: str
    number: int
    time: float
    pose: np.ndarray
    told: np.ndarray

    @property
    def stem(self) -> str:
        """Name of its files."""
        return f"{self.number:04d}"


def station_distances(rig: Rig) -> np.ndarray:
    """(S,) distance along the route of each station; a halt repeats one."""
    moving = np.ones(rig.stations)
    moving[0] = 0
    if rig.halt is not None:
        moving[rig.halt[0] + 1 : rig.halt[1] + 1] = 0
    return np.cumsum(moving) * rig.step


def station_times(rig: Rig) -> np.ndarray:
    """(S,) seconds."""
    gone = np.diff(station_distances(rig), prepend=0.0)
    wait = np.where(gone > 0, rig.step / rig.speed, HALT_DT_S)
    wait[0] = 0
    return np.cumsum(wait)


def route_at(plan: Plan, distance: float) -> tuple[np.ndarray, float]:
    """Position (3,) on the ground and heading, at a distance along the route."""
    d = np.arange(len(plan.route_xyz)) * ROUTE_STEP_M
    return np.array([np.interp(distance, d, plan.route_xyz[:, k]) for k in range(3)]), float(np.interp(distance, d, plan.route_angle))


def look(position: np.ndarray, yaw: float, pitch: float) -> np.ndarray:
    """OpenGL camera-to-world (4, 4): at a position, looking along ``yaw``, ``pitch`` radians below the horizon."""
    forward = np.array([math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), -math.sin(pitch)])
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = right, np.cross(right, forward), -forward, position
    return pose


def shots(plan: Plan) -> list[Shot]:
    """All frames, station by station."""
    rig = plan.rig
    rng = np.random.default_rng([plan.seed, 1])
    found = []
    distances, times = station_distances(rig), station_times(rig)
    for i, (distance, time) in enumerate(zip(distances, times, strict=True)):
        ground, heading = route_at(plan, float(distance))
        ahead, _ = route_at(plan, float(distance) + 3.0)
        grade = (ahead[2] - ground[2]) / 3.0
        sway = 0.07 * math.sin(0.37 * distance)
        position = ground + np.array([-math.sin(heading) * sway, math.cos(heading) * sway, rig.height + 0.012 * math.sin(1.1 * distance)])
        yaw = heading + 0.01 * math.sin(0.5 * distance)
        halted = rig.halt is not None and rig.halt[0] <= i <= rig.halt[1]
        noise = rng.normal(0, HALT_NOISE_M, 3) if halted else np.zeros(3)
        for name, turn in rig.cameras:
            # A car pitches with the slope that it stands on; a side camera rolls instead, which is left out.
            pitch = math.radians(rig.pitch) - math.atan(grade) * math.cos(math.radians(turn))
            pose = look(position, yaw + math.radians(turn), pitch)
            told = pose.copy()
            told[:3, 3] += noise
            found.append(Shot(name, i, float(time), pose, told))
    return found
