"""Planted drives that are made once and kept, so that every revision is measured on the very same holes.

In the cache, for each drive: ``footage/``, the workspace of the drive as it is; and for each round ``round_1/`` with ``drive/``
(the drive with the cars, to be opened as any other), ``cars/`` (whose pixel is whose), ``held/`` (per frame what is known of the
photograph: depth, what really goes, what another frame shows, where the ground is) and ``planted.json`` with the cars, which is
written last.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.real_drives.places import WANTED, Feature, choose_rounds, features_of
from benchmarks.real_drives.table import RealDrive
from unveil_core.base.files import write_json_atomic
from unveil_core.base.frame_cache import FrameCache, Frames
from unveil_core.base.pictures.decoding import read_image, read_label_image
from unveil_core.drives.drive import Drive
from unveil_core.drives.imported import read_imported
from unveil_core.evaluate.holdout.placement import CarPixels, SceneView, seen_places
from unveil_core.evaluate.holdout.planting import FootageScene, plant, read_scene
from unveil_core.evaluate.holdout.scores import HoldoutFrame
from unveil_core.evaluate.holdout.virtual_cars import VirtualCar
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings

__all__ = ["KeptRound", "kept_rounds", "planted_rounds"]

MARK = "planted.json"
FORMAT = 1
CACHE_BYTES = 2 << 30


@dataclass(frozen=True)
class KeptRound:
    """A planted drive in the cache.

    Attributes:
        folder: of the round; cars: in it.
        features: what the places are like, by car.
        arguments: of ``unveil run``, besides drive, workspace and quality.
    """

    folder: Path
    cars: tuple[VirtualCar, ...]
    features: tuple[Feature, ...]
    arguments: tuple[str, ...]

    @property
    def drive(self) -> Path:
        """The folder that a run is given."""
        return self.folder / "drive"

    @property
    def runs(self) -> Path:
        """The folder of the runs of all revisions."""
        return self.folder / "runs"

    def frames(self) -> Sequence[HoldoutFrame]:
        """The real frames with what is known of the cars in them, read when they are asked for."""
        real = read_imported(self.folder.parent / "footage" / "drive", points=False).frames

        def held(i: int) -> HoldoutFrame:
            frame = real[i]
            number = read_label_image(self.folder / "cars" / frame.camera_name / f"{frame.name}.png")
            with np.load(self.folder / "held" / frame.camera_name / f"{frame.name}.npz") as kept:
                masks = {name: kept[name] for name in ("excluded", "removed", "elsewhere", "ground")}
                view = SceneView(frame.camera, kept["depth"], masks["excluded"])
            nowhere = np.broadcast_to(np.float32(np.inf), number.shape)
            cars = CarPixels(number, nowhere, np.broadcast_to(np.uint8(0), (*number.shape, 3)))
            return HoldoutFrame(frame, view, cars, masks["removed"], masks["elsewhere"], masks["ground"])

        return FrameCache(CACHE_BYTES).frames(len(real), held)

    def planted_drive(self) -> Drive:
        """The drive with the cars."""
        return read_imported(self.drive, points=False)


def kept_rounds(folder: Path) -> list[KeptRound]:
    """The rounds of a drive's folder in the cache; none where they were not made to their end."""
    if not (folder / MARK).is_file():
        return []
    return [_read(folder / name) for name in json.loads((folder / MARK).read_text())["rounds"]]


def planted_rounds(
    drive: RealDrive, data: Path, cache: Path, *, quality: str, wanted: int, each: int, rounds: int
) -> list[KeptRound]:
    """The planted drives of a drive, from the cache or made.

    Args:
        data: folder of all drives; cache: folder of all that is kept.
        quality: of the run that finds out where the street is free.
        wanted, each, rounds: see :func:`choose_rounds`.
    """
    folder = cache / drive.name
    if kept := kept_rounds(folder):
        return kept
    settings = drive.settings(data, quality)
    footage = run(data / drive.path, folder / "footage", settings, until="inpaint")
    room = FrameCache(CACHE_BYTES)
    names = []
    with TemporaryDirectory(prefix=".scene.", dir=folder) as scratch:
        scene = read_scene(footage, room, Path(scratch))
        real = scene.drive.frames
        places = seen_places(
            scene.street, scene.surfels, scene.drive.points.positions, scene.views.frames, wanted=WANTED
        )
        pictures = Frames(len(real), lambda i: read_image(real[i].image_path))
        features = features_of(places, scene.views.frames, pictures)
        like = {(f.along_m, f.left_m): f for f in features}
        chosen = choose_rounds(places, features, frames=len(real), wanted=wanted, each=each, rounds=rounds)
        for k, cars in enumerate(chosen, 1):
            _make(folder / f"round_{k}", scene, cars, [like[c.s, c.t] for c in cars], settings, room)
            names.append(f"round_{k}")
    write_json_atomic(folder / MARK, {"format": FORMAT, "drive": asdict(drive), "quality": quality, "rounds": names})
    return kept_rounds(folder)


def _make(
    folder: Path,
    scene: FootageScene,
    cars: Sequence[VirtualCar],
    features: Sequence[Feature],
    settings: RunSettings,
    room: FrameCache,
) -> None:
    """Write a round."""
    planted = plant(scene, cars, folder / "drive", folder / "cars", room)
    for held in planted.frames:
        assert held.ground is not None
        path = folder / "held" / held.frame.camera_name / f"{held.frame.name}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(
            path,
            depth=held.view.depth.astype(np.float32),
            excluded=held.view.excluded,
            removed=held.removed,
            elsewhere=held.elsewhere,
            ground=held.ground,
        )
    first = planted.labels.first_instance or 0
    ids = [*settings.instances, *(range(first, first + len(cars)) if planted.labels.choose_instances else ())]
    # The images are what they are to be already.
    arguments = ["--work-side", str(max(32, *(max(f.camera.width, f.camera.height) for f in planted.drive.frames)))]
    if settings.remove:
        arguments += ["--remove", ",".join(settings.remove)]
    if ids:
        arguments += ["--instances", ",".join(map(str, ids))]
    rows = [_to_json(car) | {"is": asdict(feature)} for car, feature in zip(cars, features, strict=True)]
    write_json_atomic(folder / MARK, {"format": FORMAT, "cars": rows, "arguments": arguments})


def _read(folder: Path) -> KeptRound:
    kept = json.loads((folder / MARK).read_text())
    if kept["format"] != FORMAT:
        raise SystemExit(f"Planted by another version: {folder}. Remove it, or name another folder with --cache.")
    cars = tuple(_of_json(row) for row in kept["cars"])
    return KeptRound(folder, cars, tuple(Feature(**row["is"]) for row in kept["cars"]), tuple(kept["arguments"]))


def _to_json(car: VirtualCar) -> dict[str, Any]:
    return {"centre": car.centre.tolist(), "axes": car.axes.tolist(), "number": car.number, "s": car.s, "t": car.t}


def _of_json(row: dict[str, Any]) -> VirtualCar:
    return VirtualCar(np.array(row["centre"]), np.array(row["axes"]), row["number"], row["s"], row["t"])
