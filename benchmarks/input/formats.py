"""Every dataset format from its files to delivered frames, in one run each.

    python benchmarks/input/formats.py [FORMATS...]

The first frames of the sample street are written in the encoding of each dataset, by the writers of the tests, and unveiled from
there by a process of its own. The street has no boxes: they are put around the points that the instance images show. Results go
to benchmarks/results/formats.json after every run; `UNVEIL_KEEP=DIR` keeps the folders and workspaces, to be looked at.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.drives.formats.street.all_formats import WRITERS  # noqa: E402
from tests.drives.formats.street.street import Street  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.base.pictures.decoding import read_image  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402
from unveil_core.drives import open_drive  # noqa: E402
from unveil_core.drives.boxes import TrackedBox  # noqa: E402
from unveil_core.drives.cityscapes import VOID  # noqa: E402
from unveil_core.drives.drive import Drive  # noqa: E402
from unveil_core.drives.imported import read_imported  # noqa: E402
from unveil_core.drives.importing.whole_drive import localized  # noqa: E402
from unveil_core.semantics.labels import find_labels  # noqa: E402
from unveil_core.semantics.objects import find_objects  # noqa: E402

RESULTS = ROOT / "benchmarks/results/formats.json"
DRIVE = ROOT / "sample_scenes/parked_street"
FRAMES = 6
LEAST_POINTS = 30
"""An object with fewer gets no box: nobody could annotate it."""
SMALLEST_M = {"car": (3.6, 1.6, 1.3), "person": (0.5, 0.5, 1.5)}
"""Of a box: who annotates one knows the side that nobody saw."""


def sample_street(count: int = FRAMES) -> Street:
    """The first frames of the sample street; its points get their classes, and its objects their boxes, from all its frames."""
    drive = localized(open_drive(DRIVE))
    scene = find_labels(drive)
    found = find_objects(drive, scene)
    kinds = np.array([*scene.labels.disk_ids, VOID], np.uint8)[found.point_labels]
    boxes = []
    for thing in found.objects:
        if thing.box is not None and thing.points >= LEAST_POINTS:
            size = tuple(float(max(pair)) for pair in zip(thing.box.size, SMALLEST_M[thing.class_name], strict=True))
            # Its yaw counts from north, that of a dataset's box from x.
            yaw = thing.box.yaw - np.pi / 2
            boxes.append(TrackedBox(thing.id, thing.class_name, thing.box.centre, size, yaw))  # type: ignore[arg-type]
    frames = drive.frames[:count]
    assert drive.points.colors is not None
    camera = frames[0].camera
    street = Street(
        [cv2.imread(str(f.image_path)) for f in frames],
        [cv2.imread(str(f.semantic_path), cv2.IMREAD_UNCHANGED) for f in frames],
        [cv2.imread(str(f.instance_path), cv2.IMREAD_UNCHANGED) for f in frames],
        np.stack([f.camera.camera_to_world for f in frames]),
        camera.fx, (camera.cx, camera.cy), np.array([f.timestamp for f in frames], np.float64),
        drive.points.positions, kinds, drive.points.colors, tuple(boxes),
    )  # fmt: skip
    return street.moved(np.eye(3), drive.to_world.translation)


def pose_errors(drive: Drive, street: Street) -> dict[str, float]:
    """Largest error of a camera's place and direction relative to the first one, after the scale of their way is taken out."""
    found = np.stack([np.linalg.inv(f.camera.world_to_camera) for f in drive.frames])
    found, true = np.linalg.inv(found[0]) @ found, np.linalg.inv(street.poses[0]) @ street.poses
    scale = np.linalg.norm(found[:, :3, 3]) / np.linalg.norm(true[:, :3, 3])
    turned = found[:, :3, :3].transpose(0, 2, 1) @ true[:, :3, :3]
    angle = np.degrees(np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    return {
        "place_mm": round(1000 * float(np.linalg.norm(found[:, :3, 3] / scale - true[:, :3, 3], axis=1).max()), 3),
        "direction_degrees": round(float(angle.max()), 5),
        "scale": round(float(scale), 4),
    }


def delivered(workspace: Path, street: Street) -> dict[str, Any]:
    """What lies in the workspace: frames, how much of them was removed, and whether the rest is the footage's."""
    drive = read_imported(workspace / "drive")
    removed = wanted = both = pixels = 0
    sizes, untouched = set(), True
    for frame, semantic in zip(drive.frames, street.semantics, strict=True):
        (path,) = (workspace / "frames" / frame.camera_name).glob(f"{frame.name}.*")
        clean = read_image(path)
        footage = frame.image_path if frame.footage is None else frame.footage.path
        height, width = clean.shape[:2]
        sizes.add(f"{width}x{height}")
        masks = []
        for name in ("removed", "shadows"):
            mask = cv2.imread(str(workspace / "masks" / name / frame.camera_name / f"{frame.name}.png"), 0)
            masks.append(np.zeros((height, width)) if mask is None else cv2.resize(mask * 1.0, (width, height)))
        own = masks[0] > 127
        goes = np.isin(semantic, range(11, 19))
        removed, wanted, both = removed + int(own.sum()), wanted + int(goes.sum()), both + int((own & goes).sum())
        pixels += own.size
        # A pixel of the footage changes where one of the four masked ones about it does.
        free = cv2.dilate((masks[0] + masks[1] > 0).astype(np.uint8), np.ones((3, 3))) == 0
        untouched &= bool((clean[free] == read_image(footage)[free]).all())
    return {
        "frames": len(drive.frames),
        "size": ", ".join(sorted(sizes)),
        "labels_come_from": json.loads((workspace / "workspace.json").read_text())["stages"]["import"]["labels"],
        "pose_error": pose_errors(drive, street),
        "removed_share": round(removed / pixels, 4),
        "removable_share": round(wanted / pixels, 4),
        "mask_iou": round(both / max(1, removed + wanted - both), 3),
        "outside_the_masks_is_the_footage": untouched,
    }


def measure(name: str, street: Street, folder: Path) -> dict[str, Any]:
    """Write the street in a format and unveil it."""
    own = folder / name.replace(" ", "_")
    (own / "data").mkdir(parents=True)
    path, workspace = WRITERS[name](own / "data", street), own / "workspace"
    command = [sys.executable, "-m", "unveil_core", "run", str(path), "-o", str(workspace)]
    begun = time.perf_counter()
    ran = subprocess.run(
        [*command, "--quality", "draft", "--work-side", "192"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    seconds = round(time.perf_counter() - begun, 1)
    (own / "said.txt").write_text(ran.stdout + ran.stderr)
    row: dict[str, Any] = {"format": name, "exit": ran.returncode, "seconds": seconds}
    if ran.returncode:
        return {**row, "said": (ran.stderr or ran.stdout).strip().splitlines()[-1].replace(str(own), "")}
    return row | delivered(workspace, street)


def main() -> None:
    """Measure all formats, or those named on the command line."""
    names = sys.argv[1:] or list(WRITERS)
    rows = {r["format"]: r for r in json.loads(RESULTS.read_text())["formats"]} if RESULTS.is_file() else {}
    street = sample_street()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(os.environ.get("UNVEIL_KEEP", temporary))
        for name in names:
            rows[name] = measure(name, street, folder)
            measured = [rows[n] for n in WRITERS if n in rows]
            write_json_atomic(RESULTS, {"machine": machine(), "frames_given": FRAMES, "formats": measured})
            print(rows[name], flush=True)


if __name__ == "__main__":
    main()
