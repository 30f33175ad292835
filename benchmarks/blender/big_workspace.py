"""Writes the workspace of a big drive without running one: a straight street with two cameras, to measure what reads it.

    python benchmarks/blender/big_workspace.py FOLDER [FRAMES_A_CAMERA POINTS TRIANGLES]

Files have the formats, names and sizes of a real run's; pictures are few files under many names. Frames are named by time
stamps in microseconds, as nuScenes and Waymo do, so that Blender needs numbered links to them.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

__all__ = ["BigWorkspace", "make_big_workspace"]

TRACKS = {"front": 0.0, "left": np.pi / 2}
"""Cameras by name, with how far each is turned from the way of the drive, radians."""
HALF_WIDTH_M, HEIGHT_M, STEP_M = 10.0, 10.0, 2.0
"""Of the street: from its middle to the facades, of these, and from frame to frame."""
RATE = 10.0
"""Frames a second."""
OFFSET = (352.25, -125.5, 36.0)
"""From the workspace's coordinates to the drive's."""
DISTINCT = 8
"""Pictures of each kind that are really made."""
ROAD, BUILDING, CAR, PERSON = 0, 2, 13, 11
SH_C0 = 0.28209479177387814


@dataclass(frozen=True)
class BigWorkspace:
    """How big it is.

    Attributes:
        frames: of each of the two cameras.
        points: of ``drive/points.ply``.
        triangles: of each mesh, about.
        surfels: of each state.
        objects: how many cars and people.
        size: of pictures, pixels.
    """

    frames: int = 200
    points: int = 5_000_000
    triangles: int = 5_000_000
    surfels: int = 1_000_000
    objects: int = 400
    size: tuple[int, int] = (960, 640)
    seed: int = 0

    @property
    def length(self) -> float:
        """Of the street, metres."""
        return self.frames * STEP_M

    @property
    def names(self) -> list[str]:
        """Of the frames of a camera."""
        return [f"{1533151603 * 10**6 + round(i / RATE * 10**6)}" for i in range(self.frames)]


def make_big_workspace(folder: Path, big: BigWorkspace | None = None) -> Path:
    """Write a workspace into a folder that is not there yet; returns it."""
    big = big or BigWorkspace()
    generator = np.random.default_rng(big.seed)
    for name in ("drive", "objects", "meshes", "surfels"):
        (folder / name).mkdir(parents=True)
    _drive(folder, big)
    _points(folder, big, generator)
    _objects(folder, big, generator)
    for state in ("full", "empty"):
        _mesh(folder / "meshes" / f"{state}.ply", big, generator)
        _surfels(folder / "surfels" / f"{state}.ply", big, generator)
    _pictures(folder, big, generator)
    (folder / "workspace.json").write_text(json.dumps({"format": 1, "generator": "unveil", "drive": "/nowhere/big", "stages": {}}))
    return folder


def _pose(along: float, turn: float) -> list[list[float]]:
    """(4, 4) to a camera (x right, y down, z ahead) that stands on the middle of the street, 2 m above it."""
    ahead = np.array([np.cos(turn), np.sin(turn), 0.0])
    right, down = np.cross(ahead, (0, 0, 1.0)), np.array([0.0, 0.0, -1.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, down, ahead])
    pose[:3, 3] = -pose[:3, :3] @ np.array([along, 0.0, 0.0])
    return pose.tolist()


def _drive(folder: Path, big: BigWorkspace) -> None:
    width, height = big.size
    frames = [
        {
            "name": name,
            "camera": track,
            "width": width,
            "height": height,
            **{"fx": width * 0.7, "fy": width * 0.7, "cx": width / 2, "cy": height / 2},
            "world_to_camera": _pose(i * STEP_M - big.length / 2, turn),
            "timestamp": 1533151603 + i / RATE,
            "image": f"images/{track}/{name}.png",
        }
        for track, turn in TRACKS.items()
        for i, name in enumerate(big.names)
    ]
    similarity = {"scale": 1.0, "rotation": np.eye(3).tolist(), "translation": list(OFFSET)}
    document = {"source": "/nowhere/big", "to_world": similarity, "frame_rate": RATE, "frames": frames}
    (folder / "drive/cameras.json").write_text(json.dumps(document))


def _street(along: np.ndarray, across: np.ndarray, length: float) -> np.ndarray:
    """(N, 3) float32 of the street's surface: up one facade, over the road, down the other.

    Args:
        along, across: (N,) both from 0 to 1.
    """
    around = across * (2 * HEIGHT_M + 2 * HALF_WIDTH_M)
    left, right = np.maximum(HEIGHT_M - around, 0), np.maximum(around - HEIGHT_M - 2 * HALF_WIDTH_M, 0)
    y = np.clip(around - HEIGHT_M - HALF_WIDTH_M, -HALF_WIDTH_M, HALF_WIDTH_M)
    return np.stack([(along - 0.5) * length, y, left + right - 2.0], axis=1).astype(np.float32)


def _colours(places: np.ndarray) -> np.ndarray:
    """(N, 3) uint8: windows, paving and lines, by place."""
    x, y, z = places.T
    facade = np.abs(y) > HALF_WIDTH_M - 0.2
    window = facade & (np.mod(x, 3.0) < 1.4) & (np.mod(z, 3.0) > 1.2)
    line = ~facade & (np.abs(y) < 0.1) & (np.mod(x, 9.0) < 4.5)
    grey = np.where(facade, 150, 90) + 12 * np.sin(37 * x) * np.sin(41 * (y + z))
    found = np.stack([grey, grey * 0.97, grey * 0.92], axis=1)
    found[window], found[line] = (60, 80, 110), (235, 235, 230)
    return found.astype(np.uint8)


def _write_ply(path: Path, comments: list[str], vertices: np.ndarray, triangles: np.ndarray | None = None) -> None:
    kinds = {"<f4": "float", "<f8": "double", "|u1": "uchar", "<i4": "int"}
    lines = ["ply", "format binary_little_endian 1.0", *(f"comment {c}" for c in comments)]
    lines.append(f"element vertex {len(vertices)}")
    lines += [f"property {kinds[vertices.dtype[n].str]} {n}" for n in vertices.dtype.names or ()]
    if triangles is not None:
        lines += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
    with path.open("wb") as file:
        file.write(("\n".join([*lines, "end_header"]) + "\n").encode("ascii"))
        vertices.tofile(file)
        if triangles is not None:
            table = np.empty(len(triangles), np.dtype([("length", "u1"), ("corners", "<i4", 3)]))
            table["length"], table["corners"] = 3, triangles
            table.tofile(file)


def _coloured(places: np.ndarray, kind: str) -> np.ndarray:
    """A table of places and colours."""
    colours = _colours(places)
    table = np.empty(len(places), [*((n, kind) for n in "xyz"), *((n, "u1") for n in ("red", "green", "blue"))])
    for i, (axis, colour) in enumerate(zip("xyz", ("red", "green", "blue"), strict=True)):
        table[axis], table[colour] = places[:, i], colours[:, i]
    return table


def _points(folder: Path, big: BigWorkspace, generator: np.random.Generator) -> None:
    across = generator.uniform(0, 1, big.points)
    places = _street(generator.uniform(0, 1, big.points), across, big.length)
    places += generator.normal(0, 0.02, places.shape).astype(np.float32)
    _write_ply(folder / "drive/points.ply", [], _coloured(places, "<f8"))
    labels = np.where(np.abs(across - 0.5) > 0.25, BUILDING, ROAD).astype(np.uint8)
    labels[generator.integers(0, big.points, big.points // 20)] = CAR
    np.save(folder / "objects/point_labels.npy", labels)


def _objects(folder: Path, big: BigWorkspace, generator: np.random.Generator) -> None:
    track, names, entries = next(iter(TRACKS)), big.names, []
    small = generator.integers(0, 255, (96, 128, 3), dtype=np.uint8)
    for i in range(big.objects):
        person, seen = i % 5 == 0, i * (big.frames - 1) // max(big.objects - 1, 1)
        thumbnail = f"objects/{i + 1:04d}.png"
        cv2.imwrite(str(folder / thumbnail), np.roll(small, i))
        x = (i + 0.5) / big.objects * big.length - big.length / 2
        entries.append(
            {
                "id": i + 1,
                "class": "person" if person else "car",
                "source": "images",
                "box": {
                    "centre": [x, 7.0 * (-1) ** i, -1.2],
                    "size": [0.6, 0.6, 1.7] if person else [4.2, 1.8, 1.5],
                    "yaw": float(generator.normal(0, 0.05)),
                },
                "points": 4000,
                "frames": 12,
                "first_frame": names[max(seen - 6, 0)],
                "last_frame": names[min(seen + 6, big.frames - 1)],
                "best_camera": track,
                "best_frame": names[seen],
                "distance_m": 6.5,
                "thumbnail": thumbnail,
            }
        )
    counts = {"road": 0, "building": 0, "vegetation": 0, "sky": 0, "car": big.objects - big.objects // 5}
    counts["person"] = big.objects - counts["car"]
    classes = [
        {"name": name, "disk_id": 0, "pixels": 10**7, "points": 10**6, "objects": count, "removable": count > 0}
        for name, count in counts.items()
    ]
    document = {"source": "semantics", "classes": classes, "objects": entries}
    (folder / "objects.json").write_text(json.dumps(document))


def _mesh(path: Path, big: BigWorkspace, generator: np.random.Generator) -> None:
    around = 2 * HEIGHT_M + 2 * HALF_WIDTH_M
    cell = np.sqrt(2 * big.length * around / big.triangles)
    rows, columns = max(round(big.length / cell), 1), max(round(around / cell), 1)
    i, j = np.meshgrid(np.arange(rows + 1), np.arange(columns + 1), indexing="ij")
    places = _street(i.ravel() / rows, j.ravel() / columns, big.length)
    places += generator.normal(0, 0.01, places.shape).astype(np.float32)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    across, along, both = corner + 1, corner + columns + 1, corner + columns + 2
    triangles = np.stack([corner, along, both, corner, both, across], axis=1).reshape(-1, 3)
    offset = "offset " + " ".join(str(v) for v in OFFSET)
    table = _coloured(places, "<f4")
    for axis, value in zip("xyz", OFFSET, strict=True):
        table[axis] += np.float32(value)  # meshes lie where the drive's own files do
    _write_ply(path, ["unveil mesh, sRGB vertex colours", offset], table, triangles)


def _surfels(path: Path, big: BigWorkspace, generator: np.random.Generator) -> None:
    floats = [
        *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
        *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
    ]
    table = np.zeros(big.surfels, [(n, "<f4") for n in (*floats, "label")])
    across = generator.uniform(0, 1, big.surfels)
    places = _street(generator.uniform(0, 1, big.surfels), across, big.length)
    colours = _colours(places)
    for i, axis in enumerate("xyz"):
        table[axis], table[f"f_dc_{i}"] = places[:, i], (colours[:, i] / 255 - 0.5) / SH_C0
    table["opacity"], table["scale_0"], table["scale_1"], table["scale_2"] = 3.0, -3.0, -3.0, -9.2
    upright = np.abs(across - 0.5) > 0.25
    table["rot_0"], table["rot_1"] = np.where(upright, np.sqrt(0.5), 1), np.where(upright, np.sqrt(0.5), 0)
    table["label"] = upright
    _write_ply(path, ["labels road,building"], table)


def _pictures(folder: Path, big: BigWorkspace, generator: np.random.Generator) -> None:
    """Photographs, delivered frames, renderings and masks: a few files, linked to under the names of all frames."""
    width, height = big.size
    colour = [folder / n for n in ("drive/images", "frames", "renders", "inpainted")]
    masks = [folder / n for n in ("masks/removed", "masks/shadows", "masks/unobserved")]
    for place in (*colour, *masks, folder / "regions"):
        made: list[Path] = []
        for track in TRACKS:
            (place / track).mkdir(parents=True)
            for i, name in enumerate(big.names):
                path = place / track / f"{name}.png"
                if len(made) >= DISTINCT:
                    os.link(made[i % DISTINCT], path)
                    continue
                blobs = cv2.resize(generator.uniform(0, 1, (8, 12)).astype(np.float32), (width, height))
                if place in colour:
                    grain = generator.normal(0, 4, (height, width, 3))
                    picture = np.clip(blobs[..., None] * 200 + 20 + grain, 0, 255)
                elif place in masks:
                    picture = (blobs > 0.8) * 255
                else:
                    picture = np.digitize(blobs, (0.7, 0.8, 0.9))
                cv2.imwrite(str(path), picture.astype(np.uint8))
                made.append(path)


def main() -> None:
    """Write one of the size that the arguments say."""
    sizes = [int(a) for a in sys.argv[2:5]]
    big = BigWorkspace(**dict(zip(("frames", "points", "triangles"), sizes, strict=False)))
    print(make_big_workspace(Path(sys.argv[1]), big))


if __name__ == "__main__":
    main()
