"""From a seed to a street: everything is drawn from one generator, in one order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sample_scenes.generators.streets import course, marks, surroundings, traffic
from sample_scenes.generators.streets.cameras import station_distances
from sample_scenes.generators.streets.plan import LabelNoise, Leg, Light, Plan, Rig, Scanner

LARGE_EVERY = 5
"""Every so many seeds the frames are large and few."""
SIZES = {"usual": (384, 256, 28), "large": (960, 640, 12), "small": (192, 128, 12), "tiny": (96, 64, 3)}
"""Width and height of the images, and the number of frames."""


def size_of(seed: int, size: str) -> tuple[int, int, int]:
    """Width, height and frames of a seed; ``size`` is "usual", where every fifth seed is large, or another of ``SIZES``."""
    return SIZES["large" if size == "usual" and seed % LARGE_EVERY == LARGE_EVERY - 1 else size]


def draw(seed: int, size: str = "usual") -> Plan:
    """The street of a seed."""
    rng = np.random.default_rng(seed)
    width, height, frames = size_of(seed, size)
    light = draw_light(rng)
    rig = draw_rig(rng, width, height, frames)
    scanner = draw_scanner(rng)
    noise = draw_noise(rng)
    character = str(rng.choice(list(surroundings.STYLES), p=[0.5, 0.3, 0.2]))
    wear = {"grain": float(rng.uniform(0.5, 1.3)), "cracks": float(rng.choice([0.0, rng.uniform(0.3, 1.0)])), "tone": float(rng.uniform(0.75, 1.35))}
    travel = float(station_distances(rig)[-1])
    kind = str(rng.choice(list(course.COURSES), p=list(course.COURSES.values())))
    section = course.draw_section(rng, character)
    corners = []
    if kind == "junction":
        second = replace(course.draw_section(rng, character), crown=0.0, kerb=section.kerb)
        travel = max(travel, 26.0)
        told, legs, corners, route, angle = course.junction(rng, travel, replace(section, crown=0.0), second)
        rig = replace(rig, offset=course.route_offset(section))
    else:
        rig = replace(rig, offset=course.route_offset(section))
        told, leg = course.single(rng, kind, travel, section)
        legs = [leg]
        route, angle = course.route_along(leg, rig.offset, travel + 15)
    finished: list[Leg] = []
    for leg in legs:
        leg.lots.extend(surroundings.draw_lots(rng, leg, character))
        leg.posts.extend(surroundings.draw_posts(rng, leg, character, light.kind == "dusk"))
        leg.marks.extend(marks.draw_marks(rng, leg, travel))
        finished.append(leg)
    plan = Plan(seed, told, character, wear, finished, corners, route, angle, light, rig, scanner, noise, [])
    return replace(plan, things=traffic.draw_things(rng, plan, travel))


def draw_light(rng: np.random.Generator) -> Light:
    """Sun from 12 degrees to high, overcast, or dusk; an exposure that drifts in a third of the streets."""
    kind = str(rng.choice(["sun", "overcast", "dusk"], p=[0.62, 0.24, 0.14]))
    elevation = float(rng.uniform(12, 66)) if kind == "sun" else 4.0
    drift = float(rng.choice([0.0, rng.uniform(0.12, 0.4)], p=[0.65, 0.35]))
    sun = {"sun": 2.2 + 2.4 * float(np.sin(np.radians(elevation))), "overcast": 0.0, "dusk": 0.25}[kind]
    sky = {"sun": float(rng.uniform(0.6, 1.0)), "overcast": 1.0, "dusk": 0.3}[kind]
    clouds = {"sun": float(rng.uniform(0.0, 0.6)), "overcast": 1.0, "dusk": 0.3}[kind]
    return Light(kind, elevation, float(rng.uniform(0, 360)), sun, sky, clouds, float(rng.uniform(0.40, 0.50)) * (0.85 if kind == "dusk" else 1.0), drift)


def draw_rig(rng: np.random.Generator, width: int, height: int, frames: int) -> Rig:
    """One camera, or a front and a side one that share the frames; a stop at lights in some streets."""
    side = str(rng.choice(["", "left", "right"], p=[0.7, 0.15, 0.15]))
    cameras: tuple[tuple[str, float], ...] = (("front", 0.0),)
    if side:
        turn = float(rng.uniform(50, 80)) * (1 if side == "left" else -1)
        cameras = (*cameras, (side, turn))
    fov = float(rng.uniform(50, 110))
    stations = max(2, frames // len(cameras))
    step = float(rng.uniform(1.0, 4.0))
    halt = None
    if rng.uniform() < 0.25 and stations >= 10:
        first = int(rng.integers(2, stations - 6))
        halt = (first, first + int(rng.integers(3, 6)))
    return Rig(
        cameras, height=float(rng.uniform(1.2, 3.0)), fov=fov, pitch=float(rng.uniform(-2, 9)), step=step,
        speed=float(rng.uniform(4, 12)), offset=0.0, stations=stations, halt=halt, width=width, height_px=height,
    )  # fmt: skip


def draw_scanner(rng: np.random.Generator) -> Scanner:
    """A LiDAR of 16 to 128 beams, or none."""
    beams = int(rng.choice([0, 16, 32, 64, 128], p=[0.15, 0.15, 0.2, 0.3, 0.2]))
    return Scanner(beams, float(rng.uniform(-30, -22)), float(rng.uniform(2, 18)), float(rng.uniform(0.008, 0.03)))


def draw_noise(rng: np.random.Generator) -> LabelNoise | None:
    """Wrong labels in four streets of ten."""
    noisy = rng.uniform() < 0.4
    noise = LabelNoise(float(rng.uniform(0.7, 2.0)), float(rng.uniform(0.5, 4.0)), float(rng.uniform(0.01, 0.05)))
    return noise if noisy else None
