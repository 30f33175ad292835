"""From footage to a drive: every step of a solve, in order, each made once."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.base.files import write_bytes_atomic, write_json_atomic
from unveil_core.base.output.written import GENERATOR, record_of
from unveil_core.base.pictures.decoding import read_image, read_label_image
from unveil_core.base.progress import Progress
from unveil_core.base.types import Float64, Mask, Picture
from unveil_core.base.wording import about_as_long
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.points import read_points, write_points
from unveil_core.solve.drive_files import write_drive
from unveil_core.solve.footage.frames import FootageFrame, Reel, read_reel, write_reel
from unveil_core.solve.footage.kinds import camera_names, is_clip, is_footage, pictures_in
from unveil_core.solve.footage.photographs import take_photographs
from unveil_core.solve.footage.video import decode_clip
from unveil_core.solve.looks.choice import chosen_frames
from unveil_core.solve.looks.hidden import bonnet_of, by_frame, labelled, write_feature_masks
from unveil_core.solve.looks.motion import motion_of
from unveil_core.solve.looks.pairs import frame_pairs, loops_of
from unveil_core.solve.looks.refusals import check_can_work
from unveil_core.solve.looks.thumbs import take_thumbs
from unveil_core.solve.mapping.model import FISHEYES, Model, read_model
from unveil_core.solve.mapping.process import check_installed, mapped
from unveil_core.solve.mapping.rest import placed_rest
from unveil_core.solve.page import solve_page
from unveil_core.solve.placing import Placed, placed, up_and_height
from unveil_core.solve.points.cloud import dense_points
from unveil_core.solve.points.straight import Straightened, straightened
from unveil_core.solve.settings import SolveSettings, focal_of
from unveil_core.solve.steps import Steps, facts_of_files

__all__ = ["RECORD", "Solved", "solve"]

RECORD = "solve.json"
"""What a solve found, in the drive's folder: the program's mark on it, too."""
WORK = "solve"
"""Folder in the drive's for what steps leave behind."""
MODELS = {"simple": "SIMPLE_RADIAL", "opencv": "OPENCV", "fisheye": "OPENCV_FISHEYE"}
GUESSED_FOCAL = 0.9
"""Of the longer side: a field of view of 58 degrees, between phones (0.7) and dashboard cameras' crops (1.2)."""
OTHER_FOCALS = (0.6, 1.4)
"""Where that leads nowhere."""
LONGEST_SIDE = 2400
"""Pixels at which features are found, at most."""
ENOUGH = 0.95
"""Share of the frames after which no other start is tried."""
FEWEST_PLACED = 0.5
"""Share of the chosen frames that have to be placed for a drive to be written."""
MOST_PX = 3.0
FOCAL_SURE = 0.05
"""Spread of the focal length, over which a user is told to give it."""
COST_S = {"features": 0.35, "pairs": 0.016, "mapping": 0.09, "points": 0.75}
"""Seconds on one core: of features a megapixel, of a pair, of mapping a frame, of points a megapixel looked at."""
Reporter = Callable[[dict[str, object]], None]


@dataclass(frozen=True, eq=False)
class Solved:
    """Attributes: drive: the folder written; facts: what was found, JSON-able, as in its solve.json."""

    drive: Path
    facts: dict[str, Any]


class _Events:
    """Progress and notices of the steps, as events of a run."""

    def __init__(self, reporter: Reporter) -> None:
        self.reporter, self.notices = reporter, list[str]()

    def _event(self, stage: str, message: str, level: str, done: int = 0, total: int = 0, **more: float) -> None:
        event = {"t": round(time.time(), 3), "stage": stage, "done": done, "total": total, "message": message}
        self.reporter({**event, "level": level, **more})

    def progress(self, stage: str) -> Progress:
        def told(done: int, total: int, message: str = "", **metrics: float) -> None:
            self._event(stage, message, "info", done, total, **metrics)

        return told

    def begin(self, stage: str) -> Progress:
        self._event(stage, "started", "info")
        return self.progress(stage)

    def end(self, stage: str, message: str = "done") -> None:
        self._event(stage, message, "info")

    def notice(self, stage: str, line: str, level: str = "notice") -> None:
        if line not in self.notices:
            self.notices.append(line)
            self._event(stage, line, level)


def solve(
    inputs: Sequence[Path], output: Path, settings: SolveSettings, reporter: Reporter = lambda event: None
) -> Solved:
    """Make a drive of clips or folders of photographs, one a camera.

    Args:
        output: folder of the drive; made if need be, continued if a solve wrote it.
        reporter: receives each event as a dict.
    Raises:
        DriveError: no footage, or it cannot be solved. SettingsError: a setting, or a folder that no solve wrote.
        Cancelled, Interrupted: calling again continues.
    """
    inputs = [Path(p) for p in inputs]
    _check_inputs(inputs)
    _check_output(output, inputs, settings)
    check_installed("pycolmap", *(["av"] if any(is_clip(p) for p in inputs) else []))
    begun = time.monotonic()
    work = output / WORK
    steps, events = Steps(work), _Events(reporter)
    write_json_atomic(output / RECORD, {"generator": GENERATOR, "state": "begun"})
    reels = _decode(inputs, output / "images", settings, steps, events)
    looked = _look(reels, output, settings, steps, events)
    model = _map(reels, looked, output, settings, steps, events)
    every = _place_rest(model, reels, output, steps, events)
    found = _place_and_fill(every, reels, looked, output, settings, steps, events)
    facts = _finish(every, found, reels, looked, output, settings, events, time.monotonic() - begun)
    return Solved(output, facts)


def _check_inputs(inputs: Sequence[Path]) -> None:
    if not inputs:
        raise SettingsError("no footage is given", mend="name a clip or a folder of photographs")
    for path in inputs:
        if not path.exists():
            raise DriveError("Not found", path=path, mend="check the path")
        if not is_footage(path):
            if path.is_file():
                raise DriveError("Not footage", path=path, mend="give a clip, as .mp4 or .mov, or a folder of photographs")
            raise DriveError("Not footage: the folder has no photographs", path=path, mend="give a folder of JPEG or PNG files")


def _check_output(output: Path, inputs: Sequence[Path], settings: SolveSettings) -> None:
    if output.exists() and not output.is_dir():
        raise SettingsError("is a file", path=output, mend="name a folder with -o")
    target = output.resolve()
    for path in inputs:
        own = path.resolve()
        if target == own or own in target.parents or target in own.parents:
            raise SettingsError(f"lies in the footage, or around it: {path}", path=output, mend="name a folder beside it")
    if output.is_dir() and any(output.iterdir()) and record_of(output / RECORD) is None and not settings.replace:
        raise SettingsError(
            "is there already, and no solve wrote it", path=output, mend="name another folder with -o, or add --replace"
        )
    output.mkdir(parents=True, exist_ok=True)


# Decode


def _decode(
    inputs: Sequence[Path], images: Path, settings: SolveSettings, steps: Steps, events: _Events
) -> list[Reel]:
    names = camera_names(list(inputs))
    files = [p for path in inputs for p in ([path] if path.is_file() else pictures_in(path))]
    made_from = [facts_of_files(files), names, settings.frames, settings.every]
    places = [steps.folder / f"reel_{name}.json" for name in names]
    if steps.begin("decode", made_from) is not None and all(p.is_file() for p in places):
        reels = [read_reel(p) for p in places]
        if all((images / f.file).is_file() for r in reels for f in r.frames):
            events.end("decode", "up to date")
            return _told(reels, events)
    elif (steps.folder / "decode.json").is_file() and images.is_dir():
        shutil.rmtree(images)  # frames of other footage would be taken for this one's
    progress = events.begin("decode")
    write_json_atomic(steps.folder / "decode.json", {"made_from": "begun"})
    reels = []
    for path, name, place in zip(inputs, names, places, strict=True):
        take = decode_clip if is_clip(path) else take_photographs
        folder = "" if len(inputs) == 1 else name
        reel = take(path, images, name, settings.frames, settings.every, folder, progress)
        write_reel(reel, place)
        reels.append(reel)
    steps.done("decode", {"frames": sum(len(r.frames) for r in reels)})
    events.end("decode")
    return _told(reels, events)


def _told(reels: list[Reel], events: _Events) -> list[Reel]:
    for line in (n for r in reels for n in r.notices):
        events.notice("decode", line, "warning")
    return reels


# Look


@dataclass(frozen=True, eq=False)
class _Looked:
    """Attributes:
    chosen: files of the frames that are solved, by camera; pairs: that are matched.
    labels, masks: pictures of frames; allowed: where a frame is to be trusted, None = everywhere.
    facts: standing and blurred frames, bonnet, loops.
    """

    chosen: list[list[str]]
    pairs: list[tuple[str, str]]
    labels: dict[FootageFrame, Path]
    masks: dict[FootageFrame, Path]
    allowed: Callable[[FootageFrame], Mask | None]
    bonnet: bool
    facts: dict[str, Any]


def _look(reels: Sequence[Reel], output: Path, settings: SolveSettings, steps: Steps, events: _Events) -> _Looked:
    frames = [f for r in reels for f in r.frames]
    labels = {} if settings.labels is None else by_frame(settings.labels, frames, "labels")
    masks = {} if settings.masks is None else by_frame(settings.masks, frames, "masks")
    bonnets_file = steps.folder / "bonnets.npz"
    facts = steps.begin("look", None)
    if facts is None or not bonnets_file.is_file():
        progress = events.begin("look")
        chosen, loops, bonnets, standing, blurred, notices = [], [], {}, 0, 0, []
        for reel in reels:
            thumbs = take_thumbs(output / "images", reel.frames, progress)
            if len(reel.frames) < 2:
                raise DriveError("Too few frames: 1", path=reel.source, mend="give more of the clip")
            motion = motion_of(thumbs, progress)
            bonnet = bonnet_of(motion)
            choice = chosen_frames(motion, thumbs.sharpness)
            notices += check_can_work(reel.source, thumbs, motion, choice, None if bonnet is None else ~bonnet)
            files = [reel.frames[i].file for i in choice.frames]
            loops += [(files[a], files[b]) for a, b in loops_of(thumbs, choice.frames)]
            chosen.append(files)
            standing, blurred = standing + choice.standing, blurred + choice.blurred
            if bonnet is not None:
                bonnets[reel.camera] = bonnet
        np.savez(bonnets_file, **bonnets)  # type: ignore[arg-type]
        facts = steps.done(
            "look",
            {
                "chosen": chosen,
                "loops": loops,
                "standing": standing,
                "blurred": blurred,
                "bonnet": sorted(bonnets),
                "notices": notices,
            },
        )
        events.end("look")
    else:
        events.end("look", "up to date")
    for line in facts["notices"]:
        events.notice("look", line, "warning")
    if settings.segmenter is not None:
        labels = labelled(settings.segmenter, output / "images", frames, output / "semantics", events.progress("label"))
    with np.load(bonnets_file) as held:
        found = {k: held[k] for k in held.files}
    masks_folder = steps.folder / "masks"
    shutil.rmtree(masks_folder, ignore_errors=True)
    free: dict[str, Callable[[FootageFrame], Mask | None]] = {}
    for reel, names in zip(reels, facts["chosen"], strict=True):
        wanted = set(names)
        some = [f for f in reel.frames if f.file in wanted]
        free[reel.camera] = write_feature_masks(some, reel.size, masks_folder, labels, masks, found.get(reel.camera))
    if facts["standing"]:
        events.notice("look", f"the camera stands in {facts['standing']} frames: they are placed by their neighbours")
    return _Looked(
        facts["chosen"],
        _pairs(facts["chosen"], [(a, b) for a, b in facts["loops"]]),
        labels,
        masks,
        lambda f: free[f.camera](f),
        bool(found),
        facts,
    )


def _pairs(chosen: list[list[str]], loops: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Neighbours of each camera, loops, and of several cameras frames at the same share of the way, and those beside."""
    found = [(names[a], names[b]) for names in chosen for a, b in frame_pairs(len(names))]
    for k, first in enumerate(chosen):
        for second in chosen[k + 1 :]:
            for a, name in enumerate(first):
                b = round(a * (len(second) - 1) / max(1, len(first) - 1))
                found += [(name, second[c]) for c in range(max(0, b - 2), min(len(second), b + 3))]
    return list(dict.fromkeys(found + loops))


# Map


def _map(
    reels: Sequence[Reel], looked: _Looked, output: Path, settings: SolveSettings, steps: Steps, events: _Events
) -> Model:
    focal = {r.camera: _focal(r, settings) for r in reels}
    labels = facts_of_files([*looked.labels.values(), *looked.masks.values()])
    made_from = [labels, settings.lens, focal, settings.thorough]
    place = steps.folder / "model.npz"
    before = steps.begin("map", made_from)
    if before is not None and place.is_file():
        events.end("map", "up to date")
        _told_of_mapping(before, events)
        return read_model(place)
    _forecast(reels, looked, settings, events)
    known = all(f is not None for f, _ in focal.values())
    database = steps.folder / "database.db"
    _forget_other_features(database, steps)
    masks = steps.folder / "masks"
    cameras = [
        {
            "names": names,
            "model": MODELS[settings.lens],
            "parameters": _first_parameters(reel, focal[reel.camera][0], settings.lens),
        }
        for reel, names in zip(reels, looked.chosen, strict=True)
    ]
    common = {"database": str(database), "pictures": str(output / "images")}
    progress = events.begin("features")
    mapped(
        {
            **common,
            "do": "features",
            "cameras": cameras,
            "masks": str(masks) if masks.is_dir() else None,
            "longest_side": LONGEST_SIDE,
            "most_features": 8192 if settings.thorough else 4096,
            "first_octave": -1 if settings.thorough else 0,
        },
        progress,
    )
    events.end("features")
    progress = events.begin("match")
    pairs = mapped({**common, "do": "match", "pairs": looked.pairs}, progress)["pairs"]
    events.end("match")
    _check_matches(pairs, looked, reels)
    progress = events.begin("map")
    count = sum(len(names) for names in looked.chosen)
    answer = mapped(
        {
            **common,
            "do": "map",
            "output": str(steps.folder / "models"),
            "model": str(place),
            "count": count,
            "enough": int(np.ceil(ENOUGH * count)),
            "refine_focal": not known,
            "adjustments": 2,
            "most_px": MOST_PX,
            "starts": _starts(reels, looked, known),
        },
        progress,
    )
    if answer["registered"] < max(3, FEWEST_PLACED * count):
        raise DriveError(
            f"Only {answer['registered']} of {count} frames could be placed",
            path=reels[0].source,
            mend="give the focal length (--focal), labels of what moves (--labels or --segmenter), more features "
            "(--thorough), or the part that is sharp: --frames A:B",
        )
    shutil.rmtree(steps.folder / "models", ignore_errors=True)
    facts = {**answer, "chosen": count, "focal_given": {c: s for c, (_, s) in focal.items()}}
    steps.done("map", facts)
    database.unlink(missing_ok=True)
    (steps.folder / "features.json").unlink(missing_ok=True)
    events.end("map")
    _told_of_mapping(facts, events)
    return read_model(place)


def _told_of_mapping(facts: dict[str, Any], events: _Events) -> None:
    if facts["registered"] < facts["chosen"]:
        lost = facts["chosen"] - facts["registered"]
        events.notice("map", f"{lost} of {facts['chosen']} frames had too few matches: they are placed by their neighbours")


def _forget_other_features(database: Path, steps: Steps) -> None:
    """A database of other settings, or that was ended while it was written, is of no use."""
    if steps.begin("features", None) is None:
        for suffix in ("", "-wal", "-shm", "-journal"):
            database.with_name(database.name + suffix).unlink(missing_ok=True)
        steps.done("features", {})


def _focal(reel: Reel, settings: SolveSettings) -> tuple[float | None, str]:
    """Focal length in pixels that is known, and by what."""
    if settings.focal is not None:
        return focal_of(settings.focal, max(reel.size)), "given"
    return reel.focal_px, reel.focal_source


def _first_parameters(reel: Reel, focal: float | None, lens: str) -> list[float]:
    width, height = reel.size
    f = focal if focal is not None else GUESSED_FOCAL * max(reel.size)
    if lens == "fisheye" and focal is None:
        f = 0.5 * max(reel.size)
    if lens == "simple":
        return [f, width / 2, height / 2, 0.0]
    return [f, f, width / 2, height / 2, 0.0, 0.0, 0.0, 0.0]


def _starts(reels: Sequence[Reel], looked: _Looked, known: bool) -> list[dict[str, Any]]:
    """How the first two frames are chosen: motion along the view is what a street has, and COLMAP refuses it by default."""
    forward = {"init_max_forward_motion": 1.0, "init_min_tri_angle": 2.0 if known else 4.0, "init_min_num_inliers": 100}
    starts: list[dict[str, Any]] = [forward, {**forward, "init_min_tri_angle": 2.0, "init_min_num_inliers": 50}]
    starts.append({"init_max_forward_motion": 0.95, "init_min_tri_angle": 16.0, "init_min_num_inliers": 100})
    if not known:
        for share in OTHER_FOCALS:
            focal = {names[0]: share * max(r.size) for r, names in zip(reels, looked.chosen, strict=True)}
            starts.append({**forward, "focal": focal})
    return starts


def _check_matches(pairs: list[list[Any]], looked: _Looked, reels: Sequence[Reel]) -> None:
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


def _forecast(reels: Sequence[Reel], looked: _Looked, settings: SolveSettings, events: _Events) -> None:
    """How long the rest will take, about."""
    chosen = sum(len(n) for n in looked.chosen)
    megapixels = reels[0].size[0] * reels[0].size[1] / 1e6 * min(1.0, LONGEST_SIDE / max(reels[0].size)) ** 2
    looked_at = reels[0].size[0] * reels[0].size[1] / 1e6 * min(1.0, 1280 / max(reels[0].size)) ** 2
    seconds = chosen * megapixels * COST_S["features"] * (4 if settings.thorough else 1)
    seconds += len(looked.pairs) * COST_S["pairs"] * (4 if settings.thorough else 1)
    seconds += chosen * (COST_S["mapping"] + looked_at * COST_S["points"])
    total = sum(len(r.frames) for r in reels)
    events.notice("look", f"{chosen} of {total} frames are solved, the others follow: about {about_as_long(seconds)}")


# All frames


def _place_rest(model: Model, reels: Sequence[Reel], output: Path, steps: Steps, events: _Events) -> Model:
    place = steps.folder / "every.npz"
    before = steps.begin("rest", None)
    if before is not None and place.is_file():
        events.end("rest", "up to date")
        return _read_every(model, place)
    progress = events.begin("rest")
    images = output / "images"
    lens = {r.camera: number for r in reels for number in [_lens_of(model, r)] if number is not None}
    owner = {f.file: r.camera for r in reels for f in r.frames}
    times = {f.file: f.time_s for r in reels for f in r.frames if f.time_s is not None}

    def grey(name: str) -> NDArray[np.uint8]:
        return np.asarray(cv2.cvtColor(read_image(images / name), cv2.COLOR_RGB2GRAY), np.uint8)

    every, errors, between = placed_rest(
        model, [[f.file for f in r.frames] for r in reels], lambda n: lens[owner[n]], grey, times, progress
    )
    np.savez(place, names=np.array(every.names), lens=every.lens, poses=every.poses)
    known = [e for e in errors.values() if np.isfinite(e)]
    facts = {"added": len(errors), "between": list(between), "px": float(np.median(known)) if known else None}
    steps.done("rest", {**facts, "errors": {n: round(e, 3) for n, e in errors.items() if np.isfinite(e)}})
    events.end("rest")
    if between:
        events.notice("rest", f"{len(between)} frames show too little: they are placed between their neighbours", "warning")
    return every


def _lens_of(model: Model, reel: Reel) -> int | None:
    own = {f.file for f in reel.frames}
    return next((int(model.lens[i]) for i, n in enumerate(model.names) if n in own), None)


def _read_every(model: Model, place: Path) -> Model:
    with np.load(place) as held:
        known = set(model.names)
        more = [(str(n), int(k), p) for n, k, p in zip(held["names"], held["lens"], held["poses"], strict=True)]
    more = [m for m in more if m[0] not in known]
    return model.with_pictures([m[0] for m in more], [m[1] for m in more], [m[2] for m in more])


# Metres, up, points


@dataclass(frozen=True, eq=False)
class _Found:
    """Attributes: model: in metres; points: likewise; placed: how they are known."""

    model: Model
    points: PointCloud
    placed: Placed


def _place_and_fill(
    model: Model,
    reels: Sequence[Reel],
    looked: _Looked,
    output: Path,
    settings: SolveSettings,
    steps: Steps,
    events: _Events,
) -> _Found:
    owner = {f.file: f for r in reels for f in r.frames}
    cameras = [owner[n].camera for n in model.names]
    cloud_place = steps.folder / "points.ply"
    sparse = PointCloud(model.points)
    up, source, height = up_and_height(model, cameras, sparse)
    if steps.begin("points", None) is not None and cloud_place.is_file():
        events.end("points", "up to date")
        cloud = read_points(cloud_place)
    else:
        progress = events.begin("points")
        cloud = _dense(model, owner, looked, output, up, height, progress)
        if not len(cloud.positions):
            cloud = PointCloud(model.points, np.full((len(model.points), 3), 128, np.uint8))
        write_points(cloud, cloud_place)
        steps.done("points", {"points": len(cloud.positions)})
        events.end("points")
    up, source, height = up_and_height(model, cameras, cloud)
    where = placed(model, reels, up, source, height, settings)
    moved = replace(cloud, positions=where.to_model.to_local(cloud.positions))
    return _Found(model.moved(where.to_model), moved, where)


def _dense(
    model: Model,
    owner: dict[str, FootageFrame],
    looked: _Looked,
    output: Path,
    up: Float64,
    height: float | None,
    progress: Progress,
) -> PointCloud:
    lenses: dict[int, Straightened] = {}
    cameras = []
    for i in range(len(model.names)):
        number = int(model.lens[i])
        if number not in lenses:
            lenses[number] = straightened(model.lenses[number].camera(np.eye(4)), model.lenses[number].distortion)
        cameras.append(replace(lenses[number].camera, world_to_camera=model.poses[i]))
    tracks: dict[str, list[int]] = {}
    order = {f: k for k, f in enumerate(owner)}
    for i in sorted(range(len(model.names)), key=lambda i: order[model.names[i]]):
        tracks.setdefault(owner[model.names[i]].camera, []).append(i)

    def picture(i: int) -> tuple[Picture, Mask | None]:
        frame, lens = owner[model.names[i]], lenses[int(model.lens[i])]
        hidden = looked.allowed(frame)
        return lens.picture(read_image(output / "images" / frame.file)), lens.hidden(None if hidden is None else ~hidden)

    return dense_points(cameras, list(tracks.values()), picture, up, height, progress)


# The drive and its page


def _finish(
    model: Model,
    found: _Found,
    reels: Sequence[Reel],
    looked: _Looked,
    output: Path,
    settings: SolveSettings,
    events: _Events,
    seconds: float,
) -> dict[str, Any]:
    frames = [f for r in reels for f in r.frames]
    labels = _kept(looked.labels, output, "semantics")
    masks = _kept(looked.masks, output, "masks")
    write_drive(output, found.model, reels, found.points, metric=found.placed.known, labels=labels, masks=masks)
    placed_frames = set(found.model.names)
    rest = Steps(output / WORK)
    errors = found.model.frame_errors()
    way = float(np.linalg.norm(np.diff(found.model.centres, axis=0), axis=1).sum()) if len(reels) == 1 else None
    facts: dict[str, Any] = {
        "generator": GENERATOR,
        "state": "done",
        "footage": [r.source for r in reels],
        "frames": len(frames),
        "placed": sum(f.file in placed_frames for f in frames),
        "solved": int(np.isfinite(errors).sum()),
        "standing": looked.facts["standing"],
        "blurred": looked.facts["blurred"],
        "error_px": round(float(np.sqrt(np.nanmean(errors**2))), 3),
        "points": len(found.points.positions),
        "lens": {
            r.camera: _lens_facts(found.model, r, settings) for r in reels if _lens_of(found.model, r) is not None
        },
        "scale": found.placed.told,
        "scale_known": found.placed.known,
        "up": found.placed.up_source,
        "camera_height_m": None if found.placed.height_m is None else round(found.placed.height_m, 3),
        "way_m": None if way is None else round(way, 2),
        "seconds": round(seconds, 1),
        "notices": events.notices,
    }
    del rest
    level = "notice" if found.placed.known else "warning"
    events.notice("write", f"scale: {found.placed.told}", level)
    write_bytes_atomic(output / "solve.html", solve_page(found.model, reels, found.points, facts).encode("utf-8", "replace"))
    write_json_atomic(output / RECORD, facts)
    events.end("write")
    return facts


def _lens_facts(model: Model, reel: Reel, settings: SolveSettings) -> dict[str, Any]:
    number = _lens_of(model, reel)
    assert number is not None
    lens = model.lenses[number]
    focal, source = _focal(reel, settings)
    return {
        "model": lens.model,
        "focal_px": round(lens.focal_px, 2),
        "focal_known_by": source if focal is not None else "",
        "field_of_view_deg": round(float(np.degrees(2 * np.arctan(lens.width / 2 / lens.pinhole[0]))), 1)
        if lens.model not in FISHEYES
        else None,
        "parameters": [round(p, 6) for p in lens.parameters],
    }


def _kept(pictures: dict[FootageFrame, Path], output: Path, folder: str) -> dict[FootageFrame, str]:
    """Copies of pictures of frames in the drive, by frame, relative to it."""
    found = {}
    for frame, source in pictures.items():
        target = (output / folder / frame.file).with_suffix(".png")
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.resolve() != target.resolve():
            read_label_image(source)  # whatever is no picture is told here, with its name
            shutil.copyfile(source, target)
        found[frame] = target.relative_to(output).as_posix()
    return found
