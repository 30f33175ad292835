"""Readers of single binary files, each with small sound files."""

from __future__ import annotations

import gzip
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import torch
from pyarrow import feather, parquet

from tests.base.pictures.files import animated_png, jpeg2000
from tests.base.plates.plates import write_dpx, write_exr
from tests.drives.formats.street.all_formats import WRITERS
from tests.drives.formats.street.street import tiny_street
from tests.fuzz.reader import Opened, Reader, Wrong
from tests.fuzz.sound import sound_drive, sound_points
from tests.surfels.test_scene_edit import an_edit, some_surfels
from unveil_core.base.files import write_image_atomic
from unveil_core.base.pictures.decoding import (
    decode_image,
    read_image,
    read_image_as_it_is,
    read_instance_image,
    read_label_image,
)
from unveil_core.base.plates.files import read_plate
from unveil_core.base.resume.checkpoint import Checkpoint
from unveil_core.drives.drive import Distortion, PointCloud
from unveil_core.drives.formats.binary import read_archive, read_floats
from unveil_core.drives.formats.cameras import picture_size
from unveil_core.drives.formats.colmap.reader import read_colmap
from unveil_core.drives.formats.kitti.sweeps import read_velodyne
from unveil_core.drives.formats.nerfstudio.depth import assumed_unit, depth_points
from unveil_core.drives.formats.pandas_tables import read_table
from unveil_core.drives.formats.processed.lidar_columns import OF_WAYMO, WITHOUT_ORIGIN, read_sweep
from unveil_core.drives.formats.safe_pickle import read_archived_object, read_arrays
from unveil_core.drives.formats.tables import Rows, read_columns
from unveil_core.drives.points import read_points, write_points
from unveil_core.geometry.camera import Camera
from unveil_core.ground.files import read_ground, write_ground
from unveil_core.ground.fit import DriveGround
from unveil_core.ground.height_field import HeightField
from unveil_core.ground.path import StreetPath
from unveil_core.inpaint.chart.files import ChartSources, read_chart_sources, save_chart
from unveil_core.mesh.export import read_ply, write_ply
from unveil_core.mesh.mesh import Mesh
from unveil_core.surfels.ply import read_surfels, write_surfels
from unveil_core.surfels.scene_edit import read_edit, write_edit
from unveil_core.surfels.sky import Sky, load_sky, save_sky
from unveil_core.surfels.surfels import Surfels
from unveil_core.workspace.files import load_array, load_mask, save_array, save_mask

__all__ = ["READERS", "mesh_file", "points_file", "surfels_file"]

CAMERA = Camera(48, 32, 40.0, 40.0, 24.0, 16.0, np.eye(4))
SIZE = (48, 32)
PNG = b"\x89PNG\r\n\x1a\n"


def _photograph(channels: int = 3, kind: type[np.generic] = np.uint8) -> np.ndarray:
    top = np.iinfo(kind).max  # type: ignore[type-var]
    shape = (32, 48, channels) if channels > 1 else (32, 48)
    rough = np.random.default_rng(0).integers(0, top, shape).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(rough, (0, 0), 3).clip(0, top)).astype(kind)


def points_file(folder: Path) -> Path:
    """A cloud of four points with colours and classes."""
    path, some = folder / "points.ply", np.zeros(4, np.uint8)
    positions = np.array([[4.0, 0, 1], [5, 1, 0], [6, -1, 0.5], [9, 2, 1]])
    write_points(PointCloud(positions, np.full((4, 3), 90, np.uint8), False, some, some > 0), path)
    return path


def mesh_file(folder: Path) -> Path:
    """A mesh of two triangles."""
    path, corners = folder / "mesh.ply", np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    write_ply(Mesh(corners, faces, np.full((4, 3), 200, np.uint8)), path)
    return path


def surfels_file(folder: Path) -> Path:
    """Three discs of degree 1."""
    path, rng = folder / "surfels.ply", np.random.default_rng(0)

    def some(*shape: int) -> torch.Tensor:
        return torch.from_numpy(rng.normal(size=shape).astype(np.float32))

    discs = Surfels(some(3, 3), some(3, 4), some(3, 2), some(3), some(3, 4, 3), torch.tensor([0, 1, 2]))
    write_surfels(discs, path, comments=("labels road, car",))
    return path


def _points(folder: Path) -> Opened:
    path, text = points_file(folder), folder / "ascii.ply"
    names = "property float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\n"
    text.write_text(
        f"ply\nformat ascii 1.0\nelement vertex 3\n{names}property uchar blue\nproperty list uchar int of\n"
        "property ushort intensity\nend_header\n1 2 3 4 5 6 1 9 8\n1 2 3 4 5 6 0 8\n7 8 9 1 2 3 2 1 1 3\n"
    )

    def read(file: Path) -> None:
        sound_points(read_points(file))

    return Opened((path, text), read)


def _surfels(folder: Path) -> Opened:
    def read(file: Path) -> None:
        found = read_surfels(file)
        count = len(found)
        for name in ("means", "quats", "log_scales", "opacity_logits", "sh"):
            values = getattr(found, name)
            if len(values) != count or not bool(torch.isfinite(values).all()):
                raise Wrong(f"{name} that are not finite are taken")
        if count and int(found.labels.min()) < -1:
            raise Wrong("a label below -1 is taken")
        if found.sh.shape[1] not in (1, 4, 9, 16):
            raise Wrong("colours of no degree are taken")

    return Opened((surfels_file(folder),), read)


def _mesh(folder: Path) -> Opened:
    def read(file: Path) -> None:
        mesh = read_ply(file)
        if not np.isfinite(mesh.vertices).all():
            raise Wrong("a vertex that is not finite is taken")
        if len(mesh.faces) and not 0 <= mesh.faces.min() <= mesh.faces.max() < len(mesh.vertices):
            raise Wrong("a triangle of a vertex that is not there is taken")

    return Opened((mesh_file(folder),), read)


def _colmap(folder: Path) -> Opened:
    root = WRITERS["COLMAP"](folder, tiny_street(2))
    points = root / "sparse/0/points3D.bin"
    rows = points.read_bytes()
    points.write_bytes(struct.pack("<Q", 8) + rows[8 : 8 + 8 * 75])  # the first points are enough
    return Opened(tuple(sorted((root / "sparse/0").glob("*.bin"))), lambda _: sound_drive(read_colmap(root)))


def _written(folder: Path, images: dict[str, np.ndarray]) -> tuple[Path, ...]:
    for name, image in images.items():
        write_image_atomic(folder / name, image)
    return tuple(folder / name for name in images)


def _check_shape(image: np.ndarray, file: Path) -> None:
    if image.shape[:2] != SIZE[::-1]:
        raise Wrong(f"an image of {image.shape} is taken for one of {SIZE}")


def _png(folder: Path) -> Opened:
    color, wide = _photograph(), _photograph(4, np.uint16)
    files = _written(folder, {"color.png": color, "grey.png": _photograph(1), "alpha.png": wide})

    def read(file: Path) -> None:
        _check_shape(read_image(file, SIZE), file)

    return Opened(files, read)


def _jpeg(folder: Path) -> Opened:
    files = _written(folder, {"color.jpg": _photograph(), "grey.jpg": _photograph(1)})
    other = folder / "progressive.jpg"
    cv2.imwrite(str(other), _photograph(), [cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_RST_INTERVAL, 2])

    def read(file: Path) -> None:
        _check_shape(decode_image(file.read_bytes(), file, SIZE), file)

    return Opened((*files, other), read)


def _any_image(folder: Path) -> Opened:
    """Pictures whose size nothing tells beforehand, in all formats that mattes may have."""
    names = ("a.png", "a.jpg", "a.bmp", "a.tiff", "a.webp")
    files = _written(folder, {name: _photograph() for name in names})
    wide = _written(folder, {"b.png": _photograph(3, np.uint16), "b.tiff": _photograph(1, np.uint16)})

    def read(file: Path) -> None:
        read_image_as_it_is(file)
        read_image(file)
        if file.suffix in (".png", ".jpg"):
            picture_size(file)

    return Opened((*files, *wide), read)


def _animated_png(folder: Path) -> Opened:
    """Animated ones are refused however they are changed, unless that makes them still pictures."""
    (still,) = _written(folder, {"still.png": _photograph()})
    frames = {"own": (0, 0, 48, 32), "large": (0, 0, 480, 320), "beside": (40, 30, 48, 32), "row": (0, 0, 48, 1)}
    files = [folder / f"{name}.png" for name in frames]
    for file, frame in zip(files, frames.values(), strict=True):
        file.write_bytes(animated_png(48, 32, frame))

    def read(file: Path) -> None:
        _check_shape(read_image(file, SIZE), file)

    return Opened((still, *files), read)


def _jpeg_2000(folder: Path) -> Opened:
    (still,) = _written(folder, {"still.png": _photograph()})
    whole = folder / "whole.jp2"
    whole.write_bytes(cv2.imencode(".jp2", _photograph())[1].tobytes())
    streams = (b"", b"\xff\x4f", b"\xff\x4f\xff\x51\0\x2f")
    files = [folder / f"{k}.png" for k in range(len(streams))]
    for file, stream in zip(files, streams, strict=True):
        file.write_bytes(jpeg2000(48, 32, stream))

    def read(file: Path) -> None:
        _check_shape(read_image(file, SIZE), file)
        if file.read_bytes()[:8] != PNG:
            raise Wrong("what is no PNG is taken")

    return Opened((still, whole, *files), read)


def _tiff(folder: Path) -> Opened:
    folder.mkdir(parents=True)
    files = []
    for packing in (1, 5, 8, 32773):
        for name, pixels in (("color", _photograph()), ("wide", _photograph(1, np.uint16)), ("alpha", _photograph(4))):
            files.append(folder / f"{name}_{packing}.tiff")
            cv2.imwrite(str(files[-1]), pixels, [cv2.IMWRITE_TIFF_COMPRESSION, packing])

    def read(file: Path) -> None:
        _check_shape(read_image(file, SIZE), file)
        _check_shape(read_image_as_it_is(file), file)

    return Opened(tuple(files), read)


def _labels(folder: Path) -> Opened:
    labels = (_photograph(1) % 20).astype(np.uint8)
    files = _written(folder, {"labels.png": labels, "color.png": np.stack([labels] * 3, axis=2)})
    mask, ids = folder / "mask.png", folder / "ids.png"
    save_mask(labels > 5, mask)
    write_image_atomic(ids, _photograph(1, np.uint16))

    def read(file: Path) -> None:
        if file == ids:
            read_instance_image(file)
        elif file == mask:
            load_mask(file)
        else:
            _check_shape(read_label_image(file, SIZE), file)

    return Opened((*files, mask, ids), read)


def _depth(folder: Path) -> Opened:
    (png,) = _written(folder, {"depth.png": np.full((16, 24), 5000, np.uint16)})
    arrays = []
    for name, kind in (("a", np.float32), ("b", np.uint16)):
        np.save(folder / f"{name}.npy", np.full((16, 24, 1) if name == "b" else (16, 24), 7, kind))
        arrays.append(folder / f"{name}.npy")
    lens = Distortion("OPENCV", (0.1, 0.0, 0, 0, 0, 0, 0, 0))

    def read(file: Path) -> None:
        assumed_unit(file)
        sound_points(depth_points(file, CAMERA, None, 0.001))
        sound_points(depth_points(file, CAMERA, lens, 0.001))

    return Opened((png, *arrays), read)


def _sweeps(folder: Path) -> Opened:
    folder.mkdir(parents=True)
    rng = np.random.default_rng(0)
    widths = {"velodyne": 4, "nuscenes": 5, "bare": 6, "waymo": 14}
    for name, width in widths.items():
        rows = rng.uniform(0, 5, (9, width))
        rows[:, 4:] = np.round(rows[:, 4:])
        rows.astype("<f4").tofile(folder / f"{name}.bin")

    def read(file: Path) -> None:
        if file.stem == "velodyne":
            read_velodyne(file)
        elif file.stem == "nuscenes":
            read_floats(file, 5)
        else:
            found = read_sweep(file, np.eye(4), OF_WAYMO if file.stem == "waymo" else WITHOUT_ORIGIN)
            sound_points(found)

    return Opened(tuple(folder / f"{n}.bin" for n in widths), read)


def _archives(folder: Path) -> Opened:
    folder.mkdir(parents=True)
    plain, held = folder / "plain.npz", folder / "object.npz"
    np.savez_compressed(plain, rays=np.ones((5, 3), np.float32), ranges=np.arange(5.0))
    points = {0: np.ones((3, 3)), 1: np.zeros((2, 3))}
    np.savez(held, pointcloud=np.array(points, dtype=object), allow_pickle=True)

    def read(file: Path) -> None:
        if file == plain:
            read_archive(file, ("rays", "ranges"))
        else:
            read_archived_object(file, "pointcloud")

    return Opened((plain, held), read)


def _pickles(folder: Path) -> Opened:
    root = WRITERS["PandaSet"](folder / "pandaset", tiny_street(1))
    other = WRITERS["neuralsim and StreetUnveiler"](folder / "neuralsim", tiny_street(1))
    tables = [next(root.rglob(f"{place}/00.pkl")) for place in ("cuboids", "semseg")]
    packed = tables[0].with_suffix(".pkl.gz")
    packed.write_bytes(gzip.compress(tables[0].read_bytes()))
    scenario = next(other.rglob("scenario.pt"))
    return Opened((*tables, packed, scenario), lambda p: read_arrays(p) if p == scenario else read_table(p))


def _feather(folder: Path) -> Opened:
    argoverse = WRITERS["Argoverse 2"](folder / "argoverse", tiny_street(2))
    poses = next(argoverse.rglob("city_SE3_egovehicle.feather"))
    boxes = next(argoverse.rglob("annotations.feather"))
    plain = poses.with_name("plain.feather")
    feather.write_feather(feather.read_table(poses), str(plain), compression="uncompressed")
    return _tables(poses, boxes, plain)


def _parquet(folder: Path) -> Opened:
    waymo = WRITERS["Waymo Open v2"](folder / "waymo", tiny_street(1))
    pictures, vehicle = (next(waymo.rglob(f"{n}/*.parquet")) for n in ("camera_image", "vehicle_pose"))
    other = vehicle.with_name("other.parquet")
    parquet.write_table(parquet.read_table(vehicle), other, compression="gzip", data_page_version="2.0")
    return _tables(vehicle, pictures, other)


def _tables(*files: Path) -> Opened:
    names = {p: _columns_of(p) for p in files}

    def read(file: Path) -> None:
        if file.parent.name == "camera_image":
            Rows(file, tuple(names[file])).row(0)
            return
        found = read_columns(file, names[file])
        for name in found.columns:
            for way in (found.words, found.numbers, found.lists):
                try:
                    way(name)
                except Exception as error:
                    # A column of another kind is asked for, too: each way is to refuse it in one line.
                    if type(error).__name__ != "DriveError":
                        raise

    return Opened(files, read)


def _columns_of(path: Path) -> list[str]:
    if path.suffix == ".parquet":
        return list(parquet.read_schema(path).names)
    return list(feather.read_table(path).column_names)


def _workspace_arrays(folder: Path) -> Opened:
    """What a workspace keeps as NumPy arrays, its checkpoints among it."""
    folder.mkdir(parents=True)
    ground, sky, chart, points, kept, edit = (
        folder / n for n in ("ground.npz", "sky.npz", "chart.npz", "points.npy", "kept.npz", "edit.npz")
    )
    nodes = np.stack([np.arange(5.0), np.zeros(5)], axis=1)
    way = StreetPath(np.eye(3), nodes, np.zeros(5), 0.0, 1.0)
    write_ground(DriveGround(way, None, HeightField(np.eye(3), np.zeros(2), 0.5, np.ones((3, 3)))), ground)
    save_sky(Sky(torch.full((3, 4, 8), 0.5), np.eye(3)), sky)
    save_chart(ChartSources(np.ones((3, 4), np.uint8), np.zeros((3, 4), np.int16), 0.0, -1.0, 0.05), chart)
    save_array(np.arange(6, dtype=np.uint8), points)
    write_edit(an_edit(), edit)
    Checkpoint(kept).save({"means": np.ones((3, 3), np.float32)}, {"frames": 3, "loss": 0.5})
    ways: dict[Path, Callable[[Path], object]] = {
        ground: read_ground, sky: load_sky, chart: read_chart_sources,
        points: load_array, edit: lambda p: read_edit(p, 5).apply(some_surfels(5)), kept: lambda p: Checkpoint(p).load(),
    }  # fmt: skip
    return Opened(tuple(ways), lambda p: ways[p](p))


def _plates(folder: Path) -> Opened:
    """OpenEXR of several types and compressions, and DPX."""
    folder.mkdir(parents=True)
    light = np.random.default_rng(0).uniform(0, 2, (6, 9, 3)).astype(np.float32)
    files = [
        write_exr(folder / f"{c}.exr", light, half=half, compression=c)
        for c, half in (("none", True), ("zips", False), ("piz", True), ("dwaa", True))
    ]
    codes = (light * 400).astype(np.uint16)
    files += [
        write_dpx(folder / f"{bits}.dpx", codes, bits=bits, transfer="Linear", little=bits == 10)
        for bits in (10, 12, 16)
    ]

    def read(path: Path) -> None:
        values = read_plate(path, (9, 6)).values
        if values.ndim != 3 or values.shape[2] != 3:
            raise Wrong("a plate without colours is taken")

    return Opened(tuple(files), read)


READERS = (
    Reader("PLY of points", "binary", _points),
    Reader("PLY of surfels", "binary", _surfels),
    Reader("PLY of a mesh", "binary", _mesh),
    Reader("COLMAP binary", "binary", _colmap),
    Reader("PNG photographs", "binary", _png),
    Reader("JPEG photographs", "binary", _jpeg),
    Reader("animated PNG", "binary", _animated_png),
    Reader("JPEG 2000", "binary", _jpeg_2000),
    Reader("TIFF photographs", "binary", _tiff),
    Reader("pictures of any format and size", "binary", _any_image),
    Reader("plates", "binary", _plates),
    Reader("labels, masks, instances", "binary", _labels),
    Reader("depth images", "binary", _depth),
    Reader("LiDAR sweeps", "binary", _sweeps),
    Reader("archives of arrays", "binary", _archives),
    Reader("pickles", "binary", _pickles),
    Reader("feather", "binary", _feather),
    Reader("parquet", "binary", _parquet),
    Reader("arrays of a workspace", "binary", _workspace_arrays),
)
