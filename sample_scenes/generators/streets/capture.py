"""Photographs, scans and labels a street, crowded and empty, and writes the drive with its truth."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import bpy
import cv2
import numpy as np

from sample_scenes.generators.streets import exposure, points
from sample_scenes.generators.streets.build import build, stand
from sample_scenes.generators.streets.cameras import Shot, shots
from sample_scenes.generators.streets.free_views import write_free_views
from sample_scenes.generators.streets.labels import noisy
from sample_scenes.generators.streets.plan import CLASS_NAMES, KINDS, Plan, Thing
from sample_scenes.generators.streets.render import SAMPLES, Picture, Studio
from sample_scenes.generators.streets.truth import shadow_mask, true_picture
from sample_scenes.generators.streets.visibility import Shown, View, never_seen

JPEG = [cv2.IMWRITE_JPEG_QUALITY, 95, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
OFFSET = np.array([352_140.0, 5_812_960.0, 34.0])
"""Where streets lie in the world: large coordinates, as surveyed drives have them; each seed is 2 km from the next."""
LARGE_PX = 500_000
LARGE_SAMPLES = 4
"""Pictures of more pixels take fewer paths each: what a pixel shows is smaller, and the denoiser has as much to go by."""
STEPS_A_METRE = 256
"""Of the depth images, as KITTI's."""


class Stage:
    """The things of a street, as objects that come, move and go."""

    def __init__(self, plan: Plan, objects: dict[int, bpy.types.Object]) -> None:
        self.plan, self.objects = plan, objects

    def at(self, time: float) -> None:
        """Move what moves to where it is at a time."""
        for thing in self.plan.things:
            if thing.speed:
                stand(self.objects[thing.number], thing, self.plan, time)

    def show(self, shown: bool) -> None:
        """Show all things, or none."""
        for obj in self.objects.values():
            obj.hide_render = not shown


def view_of(plan: Plan, shot: Shot) -> View:
    """The camera of a frame."""
    return View(shot.pose, plan.rig.width, plan.rig.height_px, plan.rig.fov)


def write_street(plan: Plan, folder: Path, *, samples: int | None = None, free: bool = True) -> dict[str, object]:
    """Render a street and write its drive into an empty folder.

    Args:
        samples: paths a pixel, None for as many as its size asks for; free: whether truth/free/ is written, too.
    Returns:
        what ``street.json`` says of the drive.
    """
    rig = plan.rig
    if samples is None:
        samples = LARGE_SAMPLES if rig.width * rig.height_px > LARGE_PX else SAMPLES
    scratch = folder / ".scratch"
    scratch.mkdir(parents=True)
    scene, objects = build(plan)
    studio, stage = Studio(scene, scratch, samples=samples), Stage(plan, objects)
    frames = shots(plan)
    views = [view_of(plan, s) for s in frames]
    full: list[Picture] = []
    for number, (shot, view) in enumerate(zip(frames, views, strict=True)):
        stage.at(shot.time)
        full.append(studio.take(view, number + 1))
        print(f"seed {plan.seed}: crowded {number + 1}/{len(frames)}", flush=True)
    turns = _turns(plan, studio, stage, frames)
    stage.show(False)
    empty: list[Picture] = []
    for number, view in enumerate(views):
        empty.append(studio.take(view, number + 1))
        print(f"seed {plan.seed}: empty {number + 1}/{len(frames)}", flush=True)
    base = exposure.base_gain([p.light for p in full], plan.light.brightness)
    gains = exposure.gains(plan.light, plan.seed, rig.stations, base)
    removed = [studio.instances[p.index] > 0 for p in full]
    crowd = [Shown(v, p.depth, r) for v, p, r in zip(views, full, removed, strict=True)]
    _write_frames(plan, folder, studio, frames, full, empty, gains, crowd)
    stage.show(True)
    offset = OFFSET + np.array([2000.0 * plan.seed, 0.0, 0.0])
    pictures = [exposure.encode(p.light, base)[..., ::-1] for p in full]
    cloud = _cloud(plan, frames, views, pictures, full, turns)
    color = points.colored(cloud, views, pictures, [p.depth for p in full])
    points.write_points(cloud, color, folder / "points.ply", offset)
    seen = {int(i) for p in full for i in np.unique(studio.instances[p.index]) if i}
    _write_transforms(plan, folder, frames, views[0], [t for t in plan.things if t.number in seen], offset)
    found: dict[str, object] = {
        "points": len(cloud), "things_seen": len(seen), "removed_share": round(float(np.mean([r.mean() for r in removed])), 4),
        "nearest_m": round(min(float(p.depth.min()) for p in full), 2),
    }  # fmt: skip
    if free:
        fronts = [v for v, s in zip(views, frames, strict=True) if s.camera == "front"]
        found["free_views"] = write_free_views(studio, stage, fronts, crowd, folder / "truth/free", base, offset)
    (folder / "street.json").write_text(json.dumps({**describe(plan), **found}, indent=1, default=float))
    for path in scratch.iterdir():
        path.unlink()
    scratch.rmdir()
    return found


def _name(plan: Plan, shot: Shot) -> str:
    """A frame's files within a folder, without suffix: by camera where there are several."""
    return f"{shot.camera}/{shot.stem}" if len(plan.rig.cameras) > 1 else shot.stem


def _turns(plan: Plan, studio: Studio, stage: Stage, frames: list[Shot]) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """What the LiDAR measures at each station; nothing where there is none."""
    if not plan.scanner.beams:
        return []
    found = []
    for shot in frames:
        if shot.camera == "front":
            stage.at(shot.time)
            pose = shot.pose.copy()
            pose[2, 3] += points.ABOVE_CAMERA_M
            found.append(studio.sweep(pose, plan.scanner.beams, plan.scanner.low, plan.scanner.high, points.ACROSS))
    return found


def _cloud(plan: Plan, frames: list[Shot], views: list[View], pictures: list[np.ndarray], full: list[Picture], turns: list) -> np.ndarray:  # type: ignore[type-arg]
    """The drive's points (P, 3)."""
    rng = np.random.default_rng([plan.seed, 5])
    if turns:
        fronts = [s for s in frames if s.camera == "front"]
        parts = [points.measured(s.pose, t, plan.scanner.noise, rng) for s, t in zip(fronts, turns, strict=True)]
    else:
        parts = [points.features(v, np.ascontiguousarray(c), p.depth, rng) for v, c, p in zip(views, pictures, full, strict=True)]
    return points.thinned(np.concatenate(parts), np.stack([s.pose[:3, 3] for s in frames]))


def _write_frames(
    plan: Plan, folder: Path, studio: Studio, frames: list[Shot], full: list[Picture], empty: list[Picture], gains: np.ndarray, crowd: list[Shown]
) -> None:
    """Images, labels and all truth of each frame."""
    rng = np.random.default_rng([plan.seed, 6])
    for shot, crowded, bare, shown in zip(frames, full, empty, crowd, strict=True):
        gain, name, removed = float(gains[shot.number]), _name(plan, shot), shown.removed
        picture, street = exposure.encode(crowded.light, gain)[..., ::-1], exposure.encode(bare.light, gain)[..., ::-1]
        labels, ids = studio.labels[crowded.index], studio.instances[crowded.index]
        if plan.noise is not None:
            labels, ids = noisy(labels, ids, plan.noise, rng)
        unseen = never_seen(shown.view, removed, bare.depth, bare.normal, crowd)
        half = bare.depth[1::2, 1::2]
        depth = np.where(np.isfinite(half) & (half < 255), np.round(half * STEPS_A_METRE), 0).astype(np.uint16)
        for path, image, options in (
            (f"images/{name}.jpg", picture, JPEG), (f"truth/images/{name}.jpg", true_picture(picture, street, removed), JPEG),
            (f"semantics/{name}.png", labels.astype(np.uint8), []), (f"instances/{name}.png", ids.astype(np.uint16), []),
            (f"truth/depth/{name}.png", depth, [cv2.IMWRITE_PNG_COMPRESSION, 9]), (f"truth/removed/{name}.png", removed.astype(np.uint8) * 255, []),
            (f"truth/shadow/{name}.png", shadow_mask(picture, street, removed).astype(np.uint8) * 255, []),
            (f"truth/unseen/{name}.png", unseen.astype(np.uint8) * 255, []),
        ):  # fmt: skip
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / path), image, options)


def _write_transforms(plan: Plan, folder: Path, frames: list[Shot], view: View, things: list[Thing], offset: np.ndarray) -> None:
    rows = []
    for shot in frames:
        matrix, name = shot.told.copy(), _name(plan, shot)
        matrix[:3, 3] += offset
        rows.append({
            "file_path": f"images/{name}.jpg", "semantic_path": f"semantics/{name}.png", "instance_path": f"instances/{name}.png",
            "timestamp": round(shot.time, 3), "camera": shot.camera, "transform_matrix": matrix.tolist(),
        })  # fmt: skip
    document = {
        "camera_model": "PINHOLE", **view.intrinsics(), "metric": True, "ply_file_path": "points.ply", "semantic_classes": "cityscapes",
        "instances": [{"id": t.number, "class": CLASS_NAMES[KINDS[t.kind].label], "name": f"{t.kind} {t.number}"} for t in things], "frames": rows,
    }  # fmt: skip
    (folder / "transforms.json").write_text(json.dumps(document, indent=1))


def describe(plan: Plan) -> dict[str, object]:
    """Everything that was drawn, as JSON."""
    legs = []
    for leg in plan.legs:
        legs.append({
            "section": asdict(leg.section), "s0": leg.s0, "s1": leg.s1, "cuts": leg.cuts, "lots": [asdict(v) for v in leg.lots],
            "posts": [asdict(v) for v in leg.posts], "marks": [asdict(v) for v in leg.marks],
        })  # fmt: skip
    counts: dict[str, int] = {}
    for thing in plan.things:
        counts[thing.kind] = counts.get(thing.kind, 0) + 1
    found: dict[str, object] = {
        "seed": plan.seed, "course": plan.course, "character": plan.character, "wear": plan.wear, "light": asdict(plan.light),
        "rig": asdict(plan.rig), "lidar": asdict(plan.scanner), "label_noise": None if plan.noise is None else asdict(plan.noise), "counts": counts,
        "moving": sum(t.speed > 0 for t in plan.things), "things": [asdict(t) for t in plan.things], "legs": legs,
    }  # fmt: skip
    return found
