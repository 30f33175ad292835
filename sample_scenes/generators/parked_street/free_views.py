"""True pictures of the empty street from where the drive never was: 1.5 m beside the path and 1 m above it.

A surfel scene can look right from the recorded cameras and fall apart a step to the side; only pictures from there tell.
"""

from __future__ import annotations

import json
import math
import tempfile
from pathlib import Path

import capture
import cv2
import numpy as np
from build_street import removable
from visibility import intrinsics, never_seen

BESIDE_M, ABOVE_M = 1.5, 1.0
EVERY = 4
"""Views are taken at every fourth frame's place."""
MARGIN_M = 0.3
"""Nothing may stand nearer to a free camera than this, crowded or empty."""


def free_poses(poses: list[np.ndarray]) -> dict[str, np.ndarray]:
    """Name to OpenGL camera-to-world (4, 4): each chosen frame beside the path, in turn right and left, and above it."""
    found = {}
    for turn, frame in enumerate(range(0, len(poses), EVERY)):
        shifts = {"beside": poses[frame][:3, 0] * BESIDE_M * (1 if turn % 2 == 0 else -1), "above": np.array([0, 0, ABOVE_M])}
        for kind, shift in shifts.items():
            pose = poses[frame].copy()
            pose[:3, 3] += shift
            found[f"{frame:04d}_{kind}"] = pose
    return found


def write_free_views(scene, poses: list[np.ndarray], folder: Path, offset: np.ndarray, *, pictures: bool = True) -> dict[str, object]:  # type: ignore[no-untyped-def]
    """Write truth/free/: images/ of the empty street, removed/ and unseen/ (masks as the recorded frames' have), transforms.json.

    Args:
        pictures: whether to render images/, which takes nearly all of the time.
    Returns:
        the number of views, and the distance of what stands nearest to one of them, metres.
    """
    target = folder / "truth/free"
    for name in ("images", "removed", "unseen"):
        (target / name).mkdir(parents=True, exist_ok=True)
    instances = capture.instance_table(scene)
    objects = removable(scene)
    views = free_poses(poses)
    free = list(views.values())
    removed, rows = [], []
    nearest = math.inf
    with tempfile.TemporaryDirectory() as scratch:
        for obj in objects:
            obj.hide_render = False
        for i in range(len(free)):
            index, depth = capture.render_passes(scene, free, i, Path(scratch))
            removed.append(instances[index] > 0)
            nearest = min(nearest, float(depth.min()))
        if nearest < MARGIN_M:
            raise SystemExit(f"a free camera stands {nearest:.2f} m before something: choose other shifts")
        # What the crowded drive shows of a place is asked of all of its frames, as for truth/unseen.
        crowd = capture.read_crowd(scene, poses, Path(scratch))
        for obj in objects:
            obj.hide_render = True
        bare = capture.surfaces(scene)
        for i, (stem, pose) in enumerate(views.items()):
            if pictures:
                picture = capture.render_color(scene, free, i, Path(scratch) / "color.png")
                cv2.imwrite(str(target / f"images/{stem}.jpg"), picture, capture.JPEG)
            _, depth = capture.render_passes(scene, free, i, Path(scratch))
            unseen = never_seen(pose, removed[i], depth, capture.normals(pose, removed[i], bare), crowd)
            for name, mask in (("removed", removed[i]), ("unseen", unseen)):
                cv2.imwrite(str(target / f"{name}/{stem}.png"), mask.astype(np.uint8) * 255)
            matrix = pose.copy()
            matrix[:3, 3] += offset
            rows.append({"file_path": f"images/{stem}.jpg", "camera": stem.split("_")[1], "transform_matrix": matrix.tolist()})
            print(f"free {stem} {i + 1}/{len(free)}", flush=True)
    document = {"camera_model": "PINHOLE", **intrinsics(), "frames": rows}
    (target / "transforms.json").write_text(json.dumps(document, indent=1))
    return {"views": len(free), "nearest_m": round(nearest, 2)}
