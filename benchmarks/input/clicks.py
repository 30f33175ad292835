"""Objects by three clicks (``unveil mask``), outlined in all frames, against the truth.

    python benchmarks/input/clicks.py [--only NAME,…] [--data DIR] [--workspace WORKSPACE] [--solved DRIVE] [--sheets DIR]

Each car of a scene that stands still and is seen in at least five frames with more than 400 pixels (of 384x256, more in larger
pictures) is clicked three times in the frame that shows it whole and largest: at random, well inside of its pixels, far from each
other; so often with other numbers. The intersection over union of its mattes and the true instance maps is taken by frame, of those
with more than 400 pixels, and of all frames together. The parked street and the country road have exact truth, and so has the
phone's clip, whose cameras and points ``unveil solve`` finds first, without labels (``--solved``: a drive that it made so).
``--data`` names a folder with ``pandaset/002``: there the truth is approximate, labels that follow from annotated boxes and LiDAR
points. ``--workspace`` names one of the parked street that is reconstructed: its surfels are clicked, too. ``--sheets`` gets
contact sheets. Writes benchmarks/results/clicks.json.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from sample_scenes.generators.phone_clip import film, street  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402
from unveil_core.drives import open_drive  # noqa: E402
from unveil_core.drives.drive import Drive  # noqa: E402
from unveil_core.drives.imported import read_imported  # noqa: E402
from unveil_core.drives.labels.reading import instances_of  # noqa: E402
from unveil_core.drives.moved import moved_ids  # noqa: E402
from unveil_core.marking.asked.said import Said, SaidObject  # noqa: E402
from unveil_core.marking.mark import mark  # noqa: E402
from unveil_core.pipeline.run import run  # noqa: E402
from unveil_core.pipeline.settings import RunSettings  # noqa: E402
from unveil_core.solve.settings import SolveSettings  # noqa: E402
from unveil_core.solve.solve import solve  # noqa: E402

RESULT = ROOT / "benchmarks/results/clicks.json"
LEAST_PX, LEAST_FRAMES, CLICKS, DRAWS = 400, 5, 3, 3
PANDASET_FRAMES, PANDASET_SIDE = "20:80:4", 768
PHONE_FRAMES = ":60:3"
SAMPLES = {name: ROOT / "sample_scenes" / name for name in ("parked_street", "country_road")}


def clicks_in(mask: np.ndarray, generator: np.random.Generator) -> list[tuple[float, float]]:
    """Pixels well inside of a mask, each far from those before."""
    depth = cv2.distanceTransform(np.pad(mask.astype(np.uint8), 1), cv2.DIST_L2, 5)[1:-1, 1:-1]
    inside = np.argwhere(depth >= max(2.0, 0.35 * float(depth.max())))
    found = [inside[generator.integers(len(inside))]]
    while len(found) < CLICKS:
        away = np.min([np.linalg.norm(inside - p, axis=1) for p in found], axis=0)
        far = inside[away >= 0.6 * away.max()]
        found.append(far[generator.integers(len(far))])
    return [(float(c) + 0.5, float(r) + 0.5) for r, c in found]


def best_frame(maps: Sequence[np.ndarray], number: int) -> int:
    """The frame that shows an object largest, of those that show it whole where there are such."""
    own = [m == number for m in maps]
    whole = [v for v, m in enumerate(own) if m.any() and not (m[:, [0, -1]].any() or m[[0, -1]].any())]
    return max(whole or range(len(maps)), key=lambda v: int(own[v].sum()))


def scores(mattes: Sequence[np.ndarray], maps: Sequence[np.ndarray], number: int) -> dict[str, float]:
    """Intersection over union of an object: mean and worst of its frames, and of all frames together."""
    both, either, of_frames = 0, 0, []
    least = least_px(maps)
    for matte, m in zip(mattes, maps, strict=True):
        own = m == number
        a, b = int((matte & own).sum()), int((matte | own).sum())
        both, either = both + a, either + b
        if own.sum() > least:
            of_frames.append(a / b)
    return {
        "frames": len(of_frames),
        "mean": round(float(np.mean(of_frames)), 3),
        "worst": round(min(of_frames), 3),
        "together": round(both / either, 3),
    }


def measured(
    source: Path,
    drive: Drive,
    maps: Sequence[np.ndarray],
    numbers: Sequence[int],
    settings: RunSettings,
    sheets: Path | None,
) -> list[dict[str, object]]:
    """One entry for each object and draw; ``maps``: instance maps of the drive's frames."""
    found = []
    for number in numbers:
        v = best_frame(maps, number)
        frame = drive.frames[v]
        size = (frame.camera.width, frame.camera.height) if frame.footage is None else None
        footage = size or (frame.footage.camera.width, frame.footage.camera.height)  # type: ignore[union-attr]
        factor = footage[0] / maps[v].shape[1]
        for draw in range(DRAWS):
            places = clicks_in(maps[v] == number, np.random.default_rng(draw))
            said = [Said(f"{frame.camera_name}/{frame.name}", "inside", (x * factor, y * factor)) for x, y in places]
            with tempfile.TemporaryDirectory() as folder:
                begun = time.monotonic()
                mark(source, Path(folder) / "masks", [SaidObject("car", said)], settings=settings)
                seconds = time.monotonic() - begun
                root = Path(folder) / "masks/mattes/car"
                mattes = [cv2.imread(str(root / f.camera_name / f"{f.name}.png"), 0) for f in drive.frames]
                if sheets is not None and draw == 0:
                    sheets.mkdir(parents=True, exist_ok=True)
                    (sheets / f"{source.name}_{number}.jpg").write_bytes(
                        (Path(folder) / "masks/sheets/car.jpg").read_bytes()
                    )
            small = [cv2.resize(m, maps[0].shape[::-1], interpolation=cv2.INTER_AREA) > 127 for m in mattes]
            entry = {"object": number, "draw": draw, **scores(small, maps, number), "seconds": round(seconds, 1)}
            print(source.name, entry, flush=True)
            found.append(entry)
    return found


def least_px(maps: Sequence[np.ndarray]) -> float:
    """Pixels of an object from which on a frame counts."""
    return LEAST_PX * (maps[0].shape[1] / 384) ** 2


def seen_enough(maps: Sequence[np.ndarray], among: Sequence[int] | None = None) -> list[int]:
    """Objects that enough frames show large enough."""
    sizes = np.zeros((len(maps), 1 << 16), np.int64)
    for k, m in enumerate(maps):
        sizes[k] = np.bincount(m.ravel(), minlength=1 << 16)
    enough = np.flatnonzero((sizes > least_px(maps)).sum(axis=0) >= LEAST_FRAMES).tolist()
    return [n for n in enough if n and (among is None or n in among)]


def summed_up(entries: Sequence[dict[str, object]]) -> dict[str, object]:
    values = {
        key: np.array([e[key] for e in entries], dtype=np.float64) for key in ("mean", "worst", "together", "seconds")
    }
    return {
        "objects": len({e["object"] for e in entries}),
        "iou_mean": round(float(values["mean"].mean()), 3),
        "iou_worst_object": round(float(values["mean"].min()), 3),
        "iou_together_mean": round(float(values["together"].mean()), 3),
        "iou_together_worst_object": round(float(values["together"].min()), 3),
        "iou_worst_frame": round(float(values["worst"].min()), 3),
        "share_of_objects_over_0.85": round(float((values["mean"] >= 0.85).mean()), 2),
        "seconds_median": round(float(np.median(values["seconds"])), 1),
        "seconds_most": round(float(values["seconds"].max()), 1),
        "each": list(entries),
    }


def of_sample(name: str, sheets: Path | None, workspace: Path | None = None) -> dict[str, object]:
    drive = open_drive(SAMPLES[name])
    data = json.loads((SAMPLES[name] / "transforms.json").read_text())
    cars = [entry["id"] for entry in data["instances"] if entry["class"] != "person"]
    maps = [instances_of(f) for f in drive.frames]
    source = workspace or SAMPLES[name]
    return summed_up(measured(source, drive, maps, seen_enough(maps, cars), RunSettings(), sheets))


def of_phone(solved: Path | None, sheets: Path | None) -> dict[str, object]:
    """The clip as a user has it: solved from its pictures, and clicked in them."""
    clip = ROOT / "sample_scenes/phone_clip"
    phone = film.Phone()
    with tempfile.TemporaryDirectory() as scratch:
        if solved is None:
            height = json.loads((clip / "truth.json").read_text())["camera_height"]
            # Who clicks has no labels: with them a solve leaves all points on cars out.
            known = SolveSettings(camera_height=height)
            solved = solve([clip / "clip.mp4"], Path(scratch) / "phone_clip", known).drive
        settings = RunSettings(frames=PHONE_FRAMES)
        drive = open_drive(solved, settings.drive_options)
        boxes = street.make_street().arrays(crowded=True)
        maps = [film.things(phone, boxes, int(f.name) / phone.rate) for f in drive.frames]
        cars = {int(n) for n, kind in zip(boxes[6], boxes[5], strict=True) if n and kind == street.CAR_CLASS}
        return summed_up(measured(solved, drive, maps, seen_enough(maps, sorted(cars)), settings, sheets))


def of_pandaset(folder: Path, sheets: Path | None) -> dict[str, object]:
    settings = RunSettings(frames=PANDASET_FRAMES, work_side=PANDASET_SIDE)
    with tempfile.TemporaryDirectory() as scratch:
        workspace = run(folder, Path(scratch) / "pandaset_002", settings, until="import")
        drive = read_imported(workspace.drive_dir)
        moved = moved_ids(drive)
        maps = [instances_of(f) for f in drive.frames]
        cars = {b.id for f in drive.frames for b in f.boxes if b.class_name in ("car", "truck")}
        numbers = seen_enough(maps, sorted(cars - set(moved)))
        return summed_up(measured(workspace.root, drive, maps, numbers, RunSettings(), sheets))


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--only", help="some of parked_street, country_road, phone_clip, pandaset; all by default")
    p.add_argument("--data", type=Path)
    p.add_argument("--solved", type=Path)
    p.add_argument("--workspace", type=Path)
    p.add_argument("--sheets", type=Path)
    arguments = p.parse_args()
    result: dict[str, object] = {"machine": machine(), "clicks": CLICKS, "draws": DRAWS, "least_px": LEAST_PX}
    wanted = (arguments.only or ",".join([*SAMPLES, "phone_clip", "pandaset"])).split(",")
    for name in SAMPLES:
        if name in wanted:
            result[name] = of_sample(name, arguments.sheets)
    if "phone_clip" in wanted:
        result["phone_clip"] = of_phone(arguments.solved, arguments.sheets)
    if arguments.workspace is not None:
        result["parked_street, reconstructed"] = of_sample("parked_street", arguments.sheets, arguments.workspace)
    if arguments.data is not None and "pandaset" in wanted:
        result["pandaset 002, approximate truth"] = of_pandaset(arguments.data / "pandaset/002", arguments.sheets)
    before = json.loads(RESULT.read_text()) if RESULT.is_file() else {}
    RESULT.write_text(json.dumps({**before, **result}, indent=1) + "\n")
    for name, row in result.items():
        if isinstance(row, dict) and "iou_mean" in row:
            print(name, {k: v for k, v in row.items() if k != "each"})


if __name__ == "__main__":
    main()
