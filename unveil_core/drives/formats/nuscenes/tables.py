"""The rows of one scene out of the tables of nuScenes.

    v1.0-*/{scene,sample,sample_data,ego_pose,calibrated_sensor,sensor,sample_annotation,instance,category,lidarseg}.json

Each table is a list of rows with a token; rows refer to each other by tokens. A sample is an annotated moment; sample_data are the
files of all sensors, at samples and between them, each with the pose of the vehicle at its own time. Facts:
nutonomy/nuscenes-devkit, ``docs/schema_nuscenes.md``.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_json
from unveil_core.drives.formats.nuscenes.json_rows import json_rows

__all__ = ["MEND", "SceneRows", "SensorFile", "is_tables", "read_scene", "scene_names", "table_folders"]

Row = dict[str, Any]
MEND = "unpack the tables of v1.0-mini or v1.0-trainval again"
LIDAR = "LIDAR_TOP"
TABLES = (
    "scene",
    "sample",
    "sample_data",
    "ego_pose",
    "calibrated_sensor",
    "sensor",
    "sample_annotation",
    "instance",
    "category",
)


@dataclass(frozen=True, eq=False)
class SensorFile:
    """A row of sample_data.

    Attributes:
        token: of the row. filename: below the dataset's folder.
        channel: name of the sensor. calibrated, ego_pose: tokens of its poses.
        seconds: when it was taken. key: whether that is an annotated moment.
        size: width and height of a photograph, pixels, 0 where the row has none.
    """

    token: str
    filename: str
    channel: str
    calibrated: str
    ego_pose: str
    seconds: float
    key: bool
    size: tuple[int, int]


@dataclass(frozen=True, eq=False)
class SceneRows:
    """What the tables say of one scene.

    Attributes:
        folder: of the tables.
        samples: time of each annotated moment by its token, seconds, in order.
        files: of cameras and the LiDAR, in order of time.
        calibrated, ego_poses: rows by token.
        annotations: rows of sample_annotation.
        classes: category name of each instance token.
        categories: category name by number of the LiDAR's labels; empty where the tables do not number them.
        labels: file of labels by token of sample_data.
    """

    folder: Path
    samples: dict[str, float]
    files: tuple[SensorFile, ...]
    calibrated: dict[str, Row]
    ego_poses: dict[str, Row]
    annotations: tuple[Row, ...]
    classes: dict[str, str]
    categories: dict[int, str]
    labels: dict[str, str]

    def table(self, name: str) -> Path:
        """The file of a table."""
        return self.folder / f"{name}.json"


def is_tables(folder: Path) -> bool:
    """Whether a folder holds the tables of nuScenes."""
    return (folder / "sample_data.json").is_file() and (folder / "scene.json").is_file()


def table_folders(path: Path) -> list[Path]:
    """Folders of tables in a dataset's folder, small versions first; or the path itself where it is one."""
    if is_tables(path):
        return [path]
    found = [p for p in sorted(path.glob("v1.0-*")) if is_tables(p)] if path.is_dir() else []
    return sorted(found, key=lambda p: (p / "sample_data.json").stat().st_size)


def scene_names(folder: Path) -> list[str]:
    """Names of the scenes of a folder of tables.

    Raises:
        DriveError: its table of scenes is damaged.
    """
    rows = _whole(folder / "scene.json")
    try:
        return [str(row["name"]) for row in rows]
    except KeyError as error:
        raise DriveError(f"has a row without {error}", path=folder / "scene.json", mend=MEND) from error


def read_scene(folder: Path, scene: str) -> SceneRows:
    """The rows of a scene, which are kept while the tables stay as they are: a drive is opened several times a run.

    Raises:
        DriveError: a table is missing or damaged, or lacks a row that another refers to.
    """
    for name in TABLES:
        if not (folder / f"{name}.json").is_file():
            raise DriveError("Not found", path=folder / f"{name}.json", mend=MEND)
    stats = [(folder / f"{name}.json").stat() for name in TABLES]
    try:
        return _read_scene(folder, scene, tuple((s.st_size, s.st_mtime_ns) for s in stats))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        problem = f"a row lacks {error}" if isinstance(error, KeyError) else f"a row cannot be read: {error}"
        raise DriveError(f"Damaged: {problem}", path=folder, mend=MEND) from error


def _whole(path: Path) -> list[Row]:
    rows = read_json(path)
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise DriveError("Not a list of rows", path=path, mend=MEND)
    return rows


@lru_cache(maxsize=2)
def _read_scene(folder: Path, scene: str, stamps: tuple[tuple[int, int], ...]) -> SceneRows:
    def rows(name: str, field: str, wanted: Collection[str]) -> list[Row]:
        return list(json_rows(folder / f"{name}.json", field, wanted))

    token = next((str(r["token"]) for r in _whole(folder / "scene.json") if r["name"] == scene), None)
    if token is None:
        raise DriveError(f"has no scene {scene}", path=folder / "scene.json", mend=MEND)
    samples = {str(r["token"]): float(r["timestamp"]) / 1e6 for r in rows("sample", "scene_token", {token})}
    if not samples:
        raise DriveError(f"scene {scene} has no samples", path=folder / "sample.json", mend=MEND)
    channels = _channels(folder)
    data = [r for r in rows("sample_data", "sample_token", samples) if r["calibrated_sensor_token"] in channels]
    files = sorted((_file(r, channels[r["calibrated_sensor_token"]]) for r in data), key=lambda f: f.seconds)
    annotations = rows("sample_annotation", "sample_token", samples)
    categories = {str(r["token"]): r for r in _whole(folder / "category.json")}
    instances = rows("instance", "token", {str(r["instance_token"]) for r in annotations})
    labels = folder / "lidarseg.json"
    of_lidar = {f.token for f in files if f.channel == LIDAR}
    return SceneRows(
        folder,
        dict(sorted(samples.items(), key=lambda item: item[1])),
        tuple(files),
        {str(r["token"]): r for r in _whole(folder / "calibrated_sensor.json")},
        _poses(folder / "ego_pose.json", {f.ego_pose for f in files}),
        tuple(annotations),
        {str(r["token"]): str(categories[r["category_token"]]["name"]) for r in instances},
        {int(r["index"]): str(r["name"]) for r in categories.values() if "index" in r},
        {str(r["sample_data_token"]): str(r["filename"]) for r in json_rows(labels, "sample_data_token", of_lidar)}
        if labels.is_file()
        else {},
    )


def _file(row: Row, channel: str) -> SensorFile:
    return SensorFile(
        str(row["token"]),
        str(row["filename"]),
        channel,
        str(row["calibrated_sensor_token"]),
        str(row["ego_pose_token"]),
        float(row["timestamp"]) / 1e6,
        bool(row["is_key_frame"]),
        (int(row.get("width") or 0), int(row.get("height") or 0)),
    )


def _channels(folder: Path) -> dict[str, str]:
    """Name of the sensor by token of calibrated_sensor: cameras and the LiDAR, no radars."""
    names = {str(r["token"]): str(r["channel"]) for r in _whole(folder / "sensor.json")}
    found = {str(r["token"]): names[r["sensor_token"]] for r in _whole(folder / "calibrated_sensor.json")}
    return {t: n for t, n in found.items() if n == LIDAR or n.startswith("CAM_")}


def _poses(path: Path, wanted: set[str]) -> dict[str, Row]:
    """Rows of ego_pose by token, which are looked for no further than the last one that is wanted."""
    found: dict[str, Row] = {}
    for row in json_rows(path, "token", wanted):
        found[row["token"]] = row
        if len(found) == len(wanted):
            break
    return found
