"""Inputs by which readers failed once: each is refused in one clear line now, or read."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.fuzz.hostile import ESCAPE, LONG
from tests.fuzz.table import READERS
from tests.fuzz.verdict import judged
from unveil_core.base.errors import UnveilError
from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.pictures.headers import header_of
from unveil_core.drives.marked import files_named

HUGE = 10**400
"""What no float holds."""
DEEP = "[" * 5000
FRAME = ("frames", 0)
VALUES: tuple[tuple[str, str, tuple[str | int, ...], object], ...] = (
    ("transforms.json", "transforms.json", (*FRAME, "file_path"), "a\0b"),
    ("transforms.json", "transforms.json", (*FRAME, "file_path"), LONG),
    ("transforms.json", "transforms.json", (*FRAME, "file_path"), "\ud800"),
    ("transforms.json", "transforms.json", (*FRAME, "file_path"), "/"),
    ("transforms.json", "transforms.json", (*FRAME, "semantic_path"), LONG),
    ("transforms.json", "transforms.json", (*FRAME, "transform_matrix", 0, 3), HUGE),
    ("transforms.json", "transforms.json", ("w",), HUGE),
    ("transforms.json", "transforms.json", ("w",), 1e300),
    ("transforms.json", "transforms.json", ("ply_file_path",), LONG),
    ("transforms.json", "transforms.json", ("camera_model",), ESCAPE),
    ("transforms.json", "transforms.json", ("camera_model",), LONG),
    ("transforms.json", "angle.json", ("camera_angle_x",), 5e-324),
    ("transforms.json", "more.json", ("up", 0), HUGE),
    ("transforms.json", "more.json", ("up", 0), 1e300),
    ("transforms.json", "more.json", ("up",), [0.0, 0.0, 1e-200]),
    ("transforms.json", "more.json", ("applied_transform", 0, 0), HUGE),
    ("marked objects", "marked.json", (0, "size", 0), HUGE),
    ("marked objects", "marked.json", (0, "id"), LONG),
    ("marked objects", "marked.json", (1, "mattes"), LONG),
    ("marked objects", "marked.json", (1, "mattes"), ESCAPE),
    ("camera path", "viewer.json", ("camera_type",), ESCAPE),
    ("camera path", "viewer.json", ("camera_path", 0, "fov"), 5e-324),
    ("PandaSet JSON", "timestamps.json", (0,), HUGE),
    ("PandaSet JSON", "intrinsics.json", ("fx",), HUGE),
    ("PandaSet JSON", "poses.json", (0, "position", "x"), HUGE),
    ("DriveStudio and Street Gaussians text", "timestamps.json", ("FRAME", "0"), HUGE),
    ("workspace.json", "workspace.json", ("settings", "unknown"), 1),
    ("workspace.json", "workspace.json", ("settings", "seed"), None),
    ("workspace.json", "workspace.json", ("settings", "memory"), []),
    ("workspace.json", "workspace.json", ("settings", "frames"), "9" * 5000),
    ("workspace.json", "workspace.json", ("settings", "sweeps"), "\u00b2"),
    ("workspace.json", "workspace.json", ("settings", "inpainter"), None),
    ("workspace.json", "workspace.json", ("settings",), None),
    ("workspace.json", "workspace.json", ("format",), LONG),
    ("workspace.json", "workspace.json", ("stages", "import", "assumptions"), None),
    ("labels.json, selection.json", "labels.json", ("disk_ids", 0), 1e400),
    ("labels.json, selection.json", "labels.json", ("disk_ids", 0), 4000),
    ("labels.json, selection.json", "labels.json", ("names", 0), None),
    ("labels.json, selection.json", "labels.json", ("names",), ["road"]),
    ("objects.json, instances.json, movers.json", "objects.json", ("objects",), None),
    ("objects.json, instances.json, movers.json", "objects.json", ("objects", 0, "id"), 1e400),
    ("objects.json, instances.json, movers.json", "instances.json", (0, "id"), 1e400),
    ("exposure.json", "exposure.json", ("frames", 0, "gain", 0), float("nan")),
    ("exposure.json", "exposure.json", ("frames", 0, "gain", 0), 0),
    ("exposure.json", "exposure.json", ("frames", 0, "bias", 0), HUGE),
    ("cameras.json", "cameras.json", (*FRAME, "fx"), float("nan")),
    ("cameras.json", "cameras.json", (*FRAME, "width"), 0),
    ("cameras.json", "cameras.json", (*FRAME, "timestamp"), "soon"),
    ("cameras.json", "cameras.json", (*FRAME, "name"), "../x"),
    ("events.jsonl, digests", ".digests.json", ("é" * 200,), [1, 2, "3"]),
    ("events.jsonl, digests", ".digests.json", ("events.jsonl",), [float("nan")]),
    ("journal of a stage", ".journal.json", ("record", "seconds"), float("nan")),
    ("journal of a stage", ".journal.json", ("outputs",), [LONG]),
    ("journal of a stage", ".journal.json", ("outputs",), ["meshes/new.ply/x"]),
    ("journal of a stage", ".journal.json", ("outputs",), ["a\0"]),
    ("journal of a stage", ".journal.json", ("partial",), ".partial-" + LONG),
    ("batch and tasks of a farm", "batch.json", ("tasks", 0, "drive"), "nobody"),
    ("batch and tasks of a farm", "batch.json", ("tasks", 0, "arguments"), []),
    ("batch and tasks of a farm", "batch.json", ("tasks", 0, "arguments", 0), 5),
    ("batch and tasks of a farm", "batch.json", ("tasks", 0, "id"), ESCAPE),
    ("batch and tasks of a farm", "batch.json", ("tasks", 0, "id"), "\u00e9" * 150),
    ("batch and tasks of a farm", "batch.json", ("tasks", 0, "arguments"), ["run", "--until"]),
    ("batch and tasks of a farm", "one.prepare.json", ("tries",), "many"),
    ("batch and tasks of a farm", "one.inpaint.0000.json", ("process",), 2**70),
    ("timings of the machine", "timings.json", ("another",), float("nan")),
    ("figures of a run (closing lines)", "metrics.json", ("truth", "regions"), None),
    ("figures of a run (closing lines)", "metrics.json", ("flicker",), []),
    ("figures of a run (closing lines)", "metrics.json", ("coverage", "removed"), "much"),
    ("figures of a run (closing lines)", "workspace.json", ("stages", "mesh"), {"seconds": 1e400}),
    ("add-on: cameras.json", "cameras.json", ("to_world", "scale"), 1e308),
    ("add-on: cameras.json", "cameras.json", ("to_world", "translation"), LONG),
    ("add-on: cameras.json", "cameras.json", (*FRAME, "footage"), 5),
    ("add-on: states of stages", "workspace.json", ("stages", "mesh"), None),
    ("add-on: states of stages", "workspace.json", ("stages", "import", "seconds"), float("nan")),
    ("add-on: states of stages", "workspace.json", ("stages", "import", "settings"), 7),
)
"""Reader, file, place in it, and what stands there instead."""
TEXTS = (
    ("COLMAP text", "cameras.txt", "48 32", "0 32"),
    ("COLMAP text", "cameras.txt", "48 32", "48 99999999999999999999"),
    ("COLMAP text", "cameras.txt", "40 40", "inf 40"),
    ("COLMAP text", "cameras.txt", "40 40", "-40 40"),
    ("COLMAP text", "cameras.txt", "0.1", "nan"),
    ("COLMAP text", "cameras.txt", "PINHOLE", LONG),
    ("COLMAP text", "images.txt", "1.jpg", "/"),
    ("KITTI text", "timestamps.txt", "2011-09-26", LONG),
    ("KITTI text", "calib_velo_to_cam.txt", "R: 0", f"R: {LONG}"),
    ("KITTI text", "0000000000.txt", " 8.416", " 1e308"),
    ("KITTI tracklets", "tracklet_labels.xml", "<h>", f"<h>{LONG}"),
    ("settings of a network", "network.toml", "512", "9" * 5000),
    ("settings of a network", "network.toml", '"BGR"', f'"{LONG}"'),
    ("timings of the machine", "timings.json", "{", DEEP),
    ("exposure.json", "exposure.json", "{", DEEP),
    ("figures of a run (closing lines)", "metrics.json", "{", DEEP),
    ("add-on: states of stages", "workspace.json", "{", DEEP),
    ("add-on: states of stages", "selection.json", "{", DEEP),
    ("add-on: states of stages", "events.jsonl", "{", "[1]\n" + DEEP + "\n7\n{"),
    ("add-on: lines of a job", "output.txt", '"done": 3', '"done": 1e999'),
    ("add-on: lines of a job", "output.txt", '"done": 3', '"done": "x"'),
    ("add-on: lines of a job", "output.txt", '"left_s": 60.0', '"left_s": NaN'),
    ("add-on: lines of a job", "output.txt", '{"t"', '{"stage": ' + DEEP + '\n{"t"'),
)
"""Reader, file, words in it, and what stands there instead."""
BYTES = (
    ("PLY of surfels", "surfels.ply", b"float label", b"int label"),
    ("PLY of surfels", "surfels.ply", b"element vertex 3", b"element vertex 3000000000"),
    ("PLY of surfels", "surfels.ply", b"property float x", b"property list uchar float x"),
    ("PLY of surfels", "surfels.ply", b"f_rest_8", b"other_08"),
    ("PLY of a mesh", "mesh.ply", b"element face 2", b"element face -2"),
    ("PLY of a mesh", "mesh.ply", b"element face 2", b"element face x"),
    ("PLY of a mesh", "mesh.ply", b"element face 2", b"element fac 2"),
    ("PLY of a mesh", "mesh.ply", b"\x02\0\0\0", b"\xff\xff\xff\x7f"),
    ("PLY of points", "points.ply", b"vertex 4", b"vertex " + b"4" * 5000),
    ("add-on: PLY", "mesh.ply", b"property float x", b"property float \x1b"),
    ("depth images", "a.npy", b"'<f4'", b"'<f4"),
    ("depth images", "a.npy", b"(16, 24)", b"(" * 300),
    ("COLMAP binary", "images.bin", b"0000.jpg", b"0" * 300),
    ("arrays of a workspace", "points.npy", b"(6,)", b"(6,"),
)
ARRAYS = (
    ("archives of arrays", "plain.npz", "rays"),
    ("archives of arrays", "object.npz", "pointcloud"),
    ("arrays of a workspace", "kept.npz", "facts"),
    ("arrays of a workspace", "chart.npz", "label"),
    ("arrays of a workspace", "sky.npz", "texture"),
    ("arrays of a workspace", "ground.npz", "axes"),
)
HEADERS = (
    b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }",
    b"{'descr': '|O', 'fortran_order': False, 'shape': (), }",
    b"{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }",
    b"{'descr': '<f8, 'fortran_order': False, 'shape': (3,",
    b"{'descr': '<f8', 'fortran_order': False, 'shape': 5, 7: (), }",
)
"""Of arrays: too large, of objects, of no shape, and two that are no Python."""


def tried(name: str, file: str, folder: Path, changed: Any) -> bool:
    """Whether a reader takes a file that ``changed`` makes of its bytes; a finding fails the test."""
    reader = READERS[name]
    opened = reader.prepare(folder / "files")
    path = next(p for p in opened.files if p.name == file)
    before = path.read_bytes()
    after = changed(before)
    assert after != before
    path.write_bytes(after)
    found = judged(reader, opened, path)
    assert isinstance(found, bool), found
    return found


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("case", VALUES, ids=lambda c: f"{c[0]} {c[2][-1]}")
def test_values(case: tuple[str, str, tuple[str | int, ...], object], tmp_path: Path) -> None:
    name, file, place, value = case

    def changed(content: bytes) -> bytes:
        document = json.loads(content)
        inner = document
        for key in place[:-1]:
            inner = inner[key]
        inner[place[-1]] = "@@"
        # Numbers that Python itself does not write stand in the text.
        raw = {float("inf"): "1e400", HUGE: str(HUGE)[:401]}.get(value) if isinstance(value, int | float) else None
        return json.dumps(document).replace('"@@"', json.dumps(value) if raw is None else raw).encode()

    tried(name, file, tmp_path, changed)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("case", TEXTS, ids=lambda c: f"{c[0]} {c[2]}")
def test_words(case: tuple[str, str, str, str], tmp_path: Path) -> None:
    name, file, old, new = case
    tried(name, file, tmp_path, lambda content: content.replace(old.encode(), new.encode(), 1))


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("case", BYTES, ids=lambda c: f"{c[0]} {c[2]!r}")
def test_bytes(case: tuple[str, str, bytes, bytes], tmp_path: Path) -> None:
    name, file, old, new = case
    tried(name, file, tmp_path, lambda content: content.replace(old, new))


@pytest.mark.parametrize("header", HEADERS)
@pytest.mark.parametrize(("name", "file", "array"), ARRAYS)
def test_headers_of_arrays(name: str, file: str, array: str, header: bytes, tmp_path: Path) -> None:
    def changed(content: bytes) -> bytes:
        stream = io.BytesIO()
        with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(stream, "w") as new:
            for part in old.namelist():
                length = len(header + b"\n").to_bytes(2, "little")
                made = b"\x93NUMPY\x01\x00" + length + header + b"\n" + bytes(24)
                new.writestr(part, made if part == f"{array}.npy" else old.read(part))
        return stream.getvalue()

    taken = tried(name, file, tmp_path, changed)
    assert not taken or file == "kept.npz"  # what cannot be read of a checkpoint is computed again


def test_a_jpeg_of_a_thousand_bytes_has_no_million_pixels(tmp_path: Path) -> None:
    opened = READERS["JPEG photographs"].prepare(tmp_path / "files")
    content = opened.files[0].read_bytes()
    at = content.index(b"\xff\xc0")
    path = tmp_path / "large.jpg"
    path.write_bytes(content[: at + 5] + (16_000).to_bytes(2, "big") * 2 + content[at + 9 :])
    header = header_of(path.read_bytes())
    assert header is not None and (header.width, header.height, header.whole) == (16_000, 16_000, False)
    with pytest.raises(UnveilError, match="Cut short"):
        read_image(path)
    plain = header_of(content)
    assert plain is not None and plain.whole


def test_a_flat_photograph_is_no_bomb(tmp_path: Path) -> None:
    """An even sky compresses well: to a few hundred pixels a byte, and is read."""
    import cv2

    for name, options in (
        ("flat", []),
        ("progressive", [cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_OPTIMIZE, 1]),
    ):
        path = tmp_path / f"{name}.jpg"
        cv2.imwrite(str(path), np.full((1080, 1920, 3), 255, np.uint8), options)
        assert read_image(path).shape == (1080, 1920, 3)


def test_the_root_of_a_disk_is_refused_soon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from unveil_core.drives import marked

    monkeypatch.setattr(marked, "MOST_FILES", 30)
    for k in range(40):
        (tmp_path / f"{k}.png").write_bytes(b"")
    with pytest.raises(UnveilError, match="holds more than 30 files or"):
        files_named(tmp_path)
    monkeypatch.setattr(marked, "MOST_FILES", 300)
    assert len(files_named(tmp_path)) == 40
    monkeypatch.setattr(marked, "MOST_FOLDERS", 5)
    for k in range(6):
        (tmp_path / f"of_{k}").mkdir()
    with pytest.raises(UnveilError, match="or 5 folders"):
        files_named(tmp_path)
