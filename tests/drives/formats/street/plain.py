"""The street as nerfstudio, COLMAP and Metashape have it: photographs, masks of what goes, and points without labels."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np

from tests.drives.formats.street.street import Street, rigid, saved, transformed
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.points import write_points
from unveil_core.geometry.transforms import rotation_to_quat

__all__ = ["COLMAP_SCALE", "write_colmap", "write_metashape", "write_nerfstudio"]

REMOVABLE = range(11, 19)
"""TrainIds of people and vehicles."""
COLMAP_SCALE = 0.37
"""Units of the model per metre."""


def write_nerfstudio(root: Path, street: Street) -> Path:
    """transforms.json with masks, 0 where something goes, in the axes of OpenGL."""
    frames = []
    for i in range(street.count):
        name = f"frame_{i + 1:05d}"
        saved(root / f"images/{name}.jpg", street.images[i])
        saved(root / f"masks/{name}.png", np.where(np.isin(street.semantics[i], REMOVABLE), 0, 255).astype(np.uint8))
        pose = street.poses[i].copy()
        pose[:3, 1:3] *= -1
        entry = {"file_path": f"images/{name}.jpg", "mask_path": f"masks/{name}.png"}
        frames.append({**entry, "transform_matrix": pose.tolist()})
    write_points(PointCloud(street.points, street.colors), root / "sparse_pc.ply")
    width, height = street.size
    content = {
        "camera_model": "OPENCV", "w": width, "h": height, "fl_x": street.focal, "fl_y": street.focal,
        "cx": street.centre[0], "cy": street.centre[1], "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0,
        "ply_file_path": "sparse_pc.ply", "frames": frames,
    }  # fmt: skip
    (root / "transforms.json").write_text(json.dumps(content))
    return root


def write_colmap(root: Path, street: Street) -> Path:
    """A binary model whose scale and axes are its own, with masks beside the photographs."""
    folder = root / "sparse/0"
    folder.mkdir(parents=True)
    tilt = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # y is down there
    back = np.linalg.inv(rigid(street.vehicles[0][:3, :3], street.poses[0][:3, 3]))
    width, height = street.size
    lens = struct.pack("<4d", street.focal, street.focal, *street.centre)
    (folder / "cameras.bin").write_bytes(struct.pack("<QiiQQ", 1, 1, 1, width, height) + lens)
    data = struct.pack("<Q", street.count)
    for i in range(street.count):
        name = f"{i:04d}.jpg"
        saved(root / "images" / name, street.images[i])
        gone = np.isin(street.semantics[i], REMOVABLE)
        saved(root / "masks" / f"{name}.png", np.where(gone, 0, 255).astype(np.uint8))
        pose = back @ street.poses[i]
        turn = (tilt @ pose[:3, :3]).T
        shift = -turn @ (COLMAP_SCALE * (tilt @ pose[:3, 3]))
        data += struct.pack("<i7di", i + 1, *rotation_to_quat(turn), *shift, 1) + name.encode() + b"\0"
        data += struct.pack("<Q", 0)
    (folder / "images.bin").write_bytes(data)
    points = COLMAP_SCALE * transformed(back, street.points) @ tilt.T
    parts = [struct.pack("<Q", len(points))]
    for k, (p, c) in enumerate(zip(points, street.colors, strict=True)):
        parts.append(struct.pack("<QdddBBBdQ", k, *p, *c, 0.5, 3) + struct.pack("<6i", 1, 0, 2, 0, 3, 0))
    (folder / "points3D.bin").write_bytes(b"".join(parts))
    return root


def write_metashape(root: Path, street: Street) -> Path:
    """Metashape's cameras in metres, with masks beside the photographs."""
    cameras = []
    for i in range(street.count):
        name = f"frame_{i + 1:05d}"
        saved(root / f"images/{name}.jpg", street.images[i])
        saved(root / f"masks/{name}.png", np.where(np.isin(street.semantics[i], REMOVABLE), 0, 255).astype(np.uint8))
        numbers = " ".join(f"{v:.12g}" for v in street.poses[i].ravel())
        cameras.append(f'<camera id="{i}" sensor_id="0" label="{name}"><transform>{numbers}</transform></camera>')
    write_points(PointCloud(street.points, street.colors), root / "points.ply")
    width, height = street.size
    cx, cy = street.centre[0] - width / 2, street.centre[1] - height / 2
    (root / "cameras.xml").write_text(
        f'<document version="2.0.0"><chunk><sensors><sensor id="0" type="frame"><calibration class="adjusted"><resolution '
        f'width="{width}" height="{height}"/><f>{street.focal!r}</f><cx>{cx!r}</cx><cy>{cy!r}</cy></calibration></sensor>'
        f"</sensors><cameras>{''.join(cameras)}</cameras><transform><scale>1</scale></transform></chunk></document>"
    )
    return root
