"""Places for many virtual cars that differ from each other: near and far, lane, kerb and sidewalk, sun and shade.

The check of the program takes the places that are seen best, which lie side by side. A bench wants each of its cars to be another
case, so that a mean over cars says something of drives at large: the next place is the one that is least like those before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from unveil_core.base.types import Float64, Mask, Picture
from unveil_core.evaluate.holdout.placement import (
    COARSE_PX,
    CarPixels,
    Place,
    SceneView,
    Visibility,
    see_cars,
)
from unveil_core.evaluate.holdout.virtual_cars import VirtualCar
from unveil_core.geometry.images import luminance

__all__ = ["WANTED", "Feature", "choose_rounds", "features_of"]

WANTED = Visibility(least_share=0.002, least_clean=0.5, most_share=0.25)
"""Half of what the program's check asks for: of a frame 768 pixels wide, 0.2 % is a car 40 m ahead, and beside a row of parked cars
half of the view is of what really goes. Pixels that show what goes are never measured. A car that covers more than a quarter of
some frame would leave no room for others at the same time."""
MOST_TOGETHER = 0.5
"""Share of a frame that the cars of a round may cover together: rows of parked cars on both sides cover as much of a narrow street.
The program's check allows 0.35, with which four cars stand on a straight road at the same time."""
APART_M = 5.5
"""Distance of cars that stand at the same time, metres: a car's length and a gap. The program's check keeps 7 m."""
APART_ROUNDS_M = 2.5
"""Distance of cars of different rounds, metres: not the same hole twice."""
UNIT_ALONG_M, UNIT_ACROSS_M = 8.0, 2.0
"""Steps along and across the street that make as much of a difference as each other: across, a lane's half is another surface."""
UNIT_LEVELS = 40.0
"""Levels of brightness that make as much of a difference: sun and shade on asphalt are 60 and more apart on the drives at hand."""
UNIT_SIZE = float(np.log(2.0))
"""Twice as large in the picture is one unit, too."""


@dataclass(frozen=True)
class Feature:
    """What a place is like.

    Attributes:
        along_m, left_m: street coordinates of its middle.
        level: median luminance of what the car hides, in the frame that shows most of it, 0 to 255.
        size: share of that frame that it covers.
    """

    along_m: float
    left_m: float
    level: float
    size: float

    def vector(self) -> Float64:
        """(4,) in units of equal difference."""
        return np.array(
            [
                self.along_m / UNIT_ALONG_M,
                self.left_m / UNIT_ACROSS_M,
                self.level / UNIT_LEVELS,
                np.log(max(self.size, 1e-6)) / UNIT_SIZE,
            ]
        )


def features_of(places: Sequence[Place], views: Sequence[SceneView], pictures: Sequence[Picture]) -> list[Feature]:
    """What the places are like.

    Args:
        views: of all frames; pictures: (H, W, 3) their photographs, asked for one by one.
    """
    found = []
    for place in places:
        best = int(np.argmax(place.shares))
        view, picture = _coarse(views[int(place.near[best])], pictures[int(place.near[best])])
        own: CarPixels = see_cars([place.car], view)
        shown: Mask = (own.number > 0) & ~view.excluded
        level = float(np.median(luminance(picture[shown].astype(np.float32)))) if shown.any() else 0.0
        found.append(Feature(place.car.s, place.car.t, level, float(place.shares[best])))
    return found


def _coarse(view: SceneView, picture: Picture) -> tuple[SceneView, Picture]:
    """Both with pixels left out, as :meth:`SceneView.coarse` does."""
    step = max(1, view.camera.width // COARSE_PX)
    return view.coarse(COARSE_PX), picture[step // 2 :: step, step // 2 :: step]


def choose_rounds(
    places: Sequence[Place], features: Sequence[Feature], *, frames: int, wanted: int, each: int, rounds: int
) -> list[list[VirtualCar]]:
    """Cars by round, each numbered from 1: the best seen place first, then always the one least like those that were taken. A
    further round is begun only when nothing fits in any more.

    Args:
        places: the best seen one first; features: what they are like.
        frames: of the drive; wanted: cars in all rounds; each: most of a round; rounds: how many drives may be made.
    """
    vectors = np.stack([f.vector() for f in features])
    centres = np.stack([p.car.centre for p in places])
    chosen: list[list[VirtualCar]] = []
    apart = np.full(len(places), np.inf)
    left = np.ones(len(places), dtype=bool)
    while len(chosen) < rounds and sum(map(len, chosen)) < wanted and left.any():
        cars: list[VirtualCar] = []
        total = np.zeros(frames)
        untried = left.copy()
        while untried.any() and len(cars) < each and sum(map(len, chosen)) + len(cars) < wanted:
            k = int(np.argmax(np.where(untried, np.minimum(apart, 1e9), -1.0)))
            place = places[k]
            untried[k] = False
            if not _fits(place, cars, total):
                continue
            cars.append(replace(place.car, number=len(cars) + 1))
            total[place.near] += place.shares
            apart = np.minimum(apart, np.linalg.norm(vectors - vectors[k], axis=1))
            left &= np.linalg.norm(centres - place.car.centre, axis=1) >= APART_ROUNDS_M
            untried &= left
        if not cars:
            break
        chosen.append(cars)
    return chosen


def _fits(place: Place, cars: Sequence[VirtualCar], total: Float64) -> bool:
    """Whether a car may stand there together with those of a round, without hiding too much of a frame."""
    apart = all(np.linalg.norm(place.car.centre - car.centre) >= APART_M for car in cars)
    return apart and bool((total[place.near] + place.shares <= MOST_TOGETHER).all())
