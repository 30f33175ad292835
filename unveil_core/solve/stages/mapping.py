"""Cameras and points of the chosen frames, by pycolmap."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_own_json, write_json_atomic
from unveil_core.base.output.copies import linked
from unveil_core.base.wording import about_as_long
from unveil_core.forecast.solving import LONGEST_SIDE, about_seconds
from unveil_core.solve.events import Events
from unveil_core.solve.footage.frames import Reel, own_names
from unveil_core.solve.looks.refusals import DARK, too_dark
from unveil_core.solve.mapping.model import Model, read_model
from unveil_core.solve.mapping.process import mapped
from unveil_core.solve.settings import SolveSettings, focal_of
from unveil_core.solve.stages.look import Looked
from unveil_core.solve.steps import Steps, facts_of_files

__all__ = ["known_focal", "lens_of", "map_frames"]

PICTURES = "pictures"
MODELS = {"simple": "SIMPLE_RADIAL", "opencv": "OPENCV", "fisheye": "OPENCV_FISHEYE"}
GUESSED_FOCAL = 0.9
"""Of the longer side: a field of view of 58 degrees, between phones (0.7) and dashboard cameras' crops (1.2)."""
OTHER_FOCALS = (0.6, 1.4)
"""Where that leads nowhere."""
ENOUGH = 0.95
"""Share of the frames after which no other start is tried."""
FEWEST_PLACED = 0.5
"""Share of the chosen frames that have to be placed for a drive to be written."""
MOST_PX, LEAST_ANGLE_DEG = 3.0, 0.5
"""Observations farther from where their point projects are dropped, and points seen at smaller angles."""
ALIKE_FOCAL, NEARLY = 0.03, 0.97
"""Two starts agree whose focal lengths differ by less. Of those that place about as many frames the one of least error counts."""
FREER = ((True, False), (False, True), (True, True))
"""Lenses that are tried: whether they bend, and whether their centre is free."""
GAIN, CENTRE_GAIN = 0.03, 0.003
"""Each of them is taken where it lowers the error by so large a share; at last a free centre where it lowers what is left by the
second. A picture cut out of a larger one (KITTI 0005) gains 0.5 %: its centre comes out right to 3 pixels of 15, and the street
level, which rises by 1 in 50 otherwise. Where the centre is in the middle, or the way too straight to tell, 0.02 % are gained."""


def map_frames(
    reels: Sequence[Reel], looked: Looked, images: Path, settings: SolveSettings, steps: Steps, events: Events
) -> Model:
    focal = {r.camera: known_focal(r, settings) for r in reels}
    labels = facts_of_files([*looked.labels.values(), *looked.masks.values()])
    made_from = [labels, settings.lens, focal, settings.thorough]
    place = steps.folder / "model.npz"
    before = steps.begin("map", made_from)
    called = own_names(reels)
    if before is not None:
        events.end("map", "up to date")
        _told_of_mapping(before, events)
        return _read(place, called)
    _forecast(reels, looked, settings, events)
    known = all(f is not None for f, _ in focal.values())
    count = sum(len(names) for names in looked.chosen)
    work = _Work(reels, looked, images, called, settings, steps, events, focal, known, count)
    answer = work.attempt(place, settings.thorough)
    grey = float(looked.facts.get("grey", 255))
    if answer["registered"] < 3 and grey < DARK:  # more features would be more noise
        raise too_dark(reels[0].source, grey)
    if answer["registered"] < ENOUGH * count and not settings.thorough:
        events.notice("map", f"{answer['registered']} of {count} frames could be placed: more features are looked for")
        second = work.attempt(place.with_name("second.npz"), True)
        if second["registered"] > answer["registered"]:
            answer = second
            place.with_name("second.npz").replace(place)
    if answer["registered"] < max(3, FEWEST_PLACED * count):
        raise DriveError(
            f"Only {answer['registered']} of {count} frames could be placed",
            path=reels[0].source,
            mend="give the focal length (--focal), labels of what moves (--labels or --segmenter), or the part that is sharp: "
            "--frames A:B",
        )
    facts = {**answer, "chosen": count, "focal_given": {c: s for c, (_, s) in focal.items()}}
    steps.done("map", facts, [place])
    work.tidy()
    events.end("map")
    _told_of_mapping(facts, events)
    return _read(place, called)


def _read(place: Path, called: dict[str, str]) -> Model:
    """The model that COLMAP made, of the frames by their own names; in the order of these."""
    model = read_model(place)
    file = {name: file for file, name in called.items()}
    return replace(model, names=tuple(file[n] for n in model.names)).with_pictures([], [], [])


@dataclass(frozen=True, eq=False)
class _Work:
    """What pycolmap is asked for."""

    reels: Sequence[Reel]
    looked: Looked
    images: Path
    called: dict[str, str]
    settings: SolveSettings
    steps: Steps
    events: Events
    focal: dict[str, tuple[float | None, str]]
    known: bool
    count: int

    def attempt(self, place: Path, thorough: bool) -> dict[str, Any]:
        """Features, matches, cameras; the model goes to ``place`` where there is one."""
        folder, lens = self.steps.folder, self.settings.lens
        database = folder / f"database_{'thorough' if thorough else 'quick'}.db"
        self._forget_other_features(database)
        masks = folder / "masks"
        cameras = [
            {
                "names": [self.called[n] for n in names],
                "model": MODELS[lens],
                "parameters": _first_parameters(reel, self.focal[reel.camera][0], lens, GUESSED_FOCAL),
            }
            for reel, names in zip(self.reels, self.looked.chosen, strict=True)
        ]
        common = {"database": str(database), "pictures": str(self._pictures())}
        features = {
            "do": "features",
            "cameras": cameras,
            "masks": str(masks) if masks.is_dir() else None,
            "longest_side": LONGEST_SIDE,
            "most_features": 8192 if thorough else 4096,
            "first_octave": -1 if thorough else 0,
        }
        mapped({**common, **features}, self.events.begin("features"))
        self.events.end("features")
        request = {**common, "do": "match", "pairs": [(self.called[a], self.called[b]) for a, b in self.looked.pairs]}
        pairs = mapped(request, self.events.begin("match"))["pairs"]
        self.events.end("match")
        if thorough:
            _check_matches(pairs, self.looked, self.reels)
        mapping = {
            "do": "map",
            "output": str(folder / "models"),
            "model": str(place),
            "count": self.count,
            "enough": int(np.ceil(ENOUGH * self.count)),
            "refine_focal": not self.known,
            "most_px": MOST_PX,
            "alike": ALIKE_FOCAL,
            "nearly": NEARLY,
            "least_angle": LEAST_ANGLE_DEG,
            "gain": GAIN,
            "centre_gain": CENTRE_GAIN,
            "lenses": FREER,
            "always_bent": lens != "simple",
            "starts": _starts(self.reels, [[self.called[n] for n in c] for c in self.looked.chosen], self.focal, lens),
        }
        return mapped({**common, **mapping}, self.events.begin("map"))

    def _pictures(self) -> Path:
        """The chosen frames by the names that COLMAP knows them by."""
        folder = self.steps.folder / PICTURES
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        for name in (n for names in self.looked.chosen for n in names):
            linked(self.images / name, folder / self.called[name])
        return folder

    def _forget_other_features(self, database: Path) -> None:
        """A database of other frames or settings is of no use; one that this solve was ended at is gone on with."""
        mark = database.with_suffix(".json")
        try:
            same = read_own_json(mark) == {"made_from": self.steps.chain}
        except (OSError, ValueError):
            same = False
        if not same:
            for file in database.parent.glob(f"{database.name}*"):
                file.unlink()
            write_json_atomic(mark, {"made_from": self.steps.chain})

    def tidy(self) -> None:
        """Take away what only a solve that was ended needs: features take a megabyte a frame."""
        for name in ("models", PICTURES):
            shutil.rmtree(self.steps.folder / name, ignore_errors=True)
        for file in self.steps.folder.glob("database_*"):
            file.unlink()


def _told_of_mapping(facts: dict[str, Any], events: Events) -> None:
    if facts["registered"] < facts["chosen"]:
        lost = facts["chosen"] - facts["registered"]
        events.notice(
            "map", f"{lost} of {facts['chosen']} frames had too few matches: they are placed by their neighbours"
        )


def known_focal(reel: Reel, settings: SolveSettings) -> tuple[float | None, str]:
    """Focal length in pixels that is known, and by what."""
    if settings.focal is not None:
        return focal_of(settings.focal, reel.size), "given"
    return reel.focal_px, reel.focal_source


def _first_parameters(reel: Reel, focal: float | None, lens: str, share: float) -> list[float]:
    """Of COLMAP's model; ``share``: of the longer side, the focal length where it is not known."""
    width, height = reel.size
    f = focal if focal is not None else share * max(reel.size) * (0.5 if lens == "fisheye" else 1.0)
    if lens == "simple":
        return [f, width / 2, height / 2, 0.0]
    return [f, f, width / 2, height / 2, 0.0, 0.0, 0.0, 0.0]


def _starts(
    reels: Sequence[Reel], chosen: list[list[str]], focal: dict[str, tuple[float | None, str]], lens: str
) -> list[dict[str, Any]]:
    """How the first two frames are chosen, and from which focal length: motion along the view is what a street has, and COLMAP
    refuses it by default. The last ones are for lenses that bend much."""
    shares = (GUESSED_FOCAL,) if all(f is not None for f, _ in focal.values()) else (GUESSED_FOCAL, *OTHER_FOCALS)
    found = []
    for angle, inliers, bend, some in (
        (2.0, 50, False, shares),
        (4.0, 100, False, shares[:1]),
        (4.0, 100, True, shares),
    ):
        for share in some:
            lenses = {
                names[0]: _first_parameters(reel, focal[reel.camera][0], lens, share)
                for reel, names in zip(reels, chosen, strict=True)
            }
            start = {"init_min_tri_angle": angle, "init_min_num_inliers": inliers, "init_max_forward_motion": 1.0}
            found.append({**start, "bend": bend, "lenses": lenses})
    return found


def _check_matches(pairs: list[list[Any]], looked: Looked, reels: Sequence[Reel]) -> None:
    """Each frame has to be matched with a neighbour, or the way falls apart.

    Raises:
        DriveError: next to nothing matches, or all moves as a plane does.
    """
    count = sum(len(names) for names in looked.chosen)
    partners = {n for a, b, inliers, _ in pairs if inliers >= 15 for n in (a, b)}
    if len(partners) < FEWEST_PLACED * count:
        raise DriveError(
            f"Too few matches: {len(partners)} of {count} frames share enough with another one",
            path=reels[0].source,
            mend="use sharper footage or more frames a second (a smaller --every), or --thorough",
        )


def _forecast(reels: Sequence[Reel], looked: Looked, settings: SolveSettings, events: Events) -> None:
    """How long the rest will take, about."""
    chosen = sum(len(n) for n in looked.chosen)
    seconds = about_seconds(chosen, reels[0].size, len(looked.pairs), settings.thorough)
    total = sum(len(r.frames) for r in reels)
    what = (
        f"{chosen} of {total} frames are solved, the others follow" if chosen < total else f"{total} frames are solved"
    )
    events.notice("look", f"{what}: about {about_as_long(seconds)}")


def lens_of(model: Model, reel: Reel) -> int | None:
    own = {f.file for f in reel.frames}
    return next((int(model.lens[i]) for i, n in enumerate(model.names) if n in own), None)
