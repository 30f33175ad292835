"""Files of strangers that decoders and parsers must not be hurt by, through the whole command: python -m pytest tests/slow/attacks

Each is a drive, or comes with one. The command must end by itself, with exit code 2 and one line that names the file, in little
time and memory, and leave no workspace behind.
"""

from __future__ import annotations

import gzip
import os
import signal
import struct
import subprocess
import sys
import time
import zlib
from pathlib import Path

import numpy as np
import psutil
import pytest

from tests.base.networks.hostile import endless, greedy
from tests.base.pictures.files import animated_png, jpeg2000, tiff
from tests.drives.formats.street.all_formats import WRITERS
from tests.drives.formats.street.street import tiny_street
from tests.drives.tiny_drive import make_tiny_drive

LONGEST_S, MOST_MB = 60, 600
"""Of a command. An import of a tiny drive holds 200 MB."""


def command(*arguments: object) -> subprocess.Popen[str]:
    """The command, started in a folder of nobody."""
    return subprocess.Popen(
        [sys.executable, "-m", "unveil_core", *map(str, arguments)],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    )


def refused(*arguments: object) -> str:
    """The one line of a command that must refuse its input."""
    program = command(*arguments)
    watched, most, begun = psutil.Process(program.pid), 0, time.monotonic()
    while program.poll() is None:
        try:
            most = max(most, watched.memory_info().rss)
        except psutil.Error:
            break
        if time.monotonic() - begun > LONGEST_S:
            program.kill()
            pytest.fail(f"it did not end in {LONGEST_S} s")
        time.sleep(0.01)
    said = program.communicate()[1]
    assert program.returncode == 2, (program.returncode, said)
    assert most >> 20 < MOST_MB
    assert len(said.strip().splitlines()) == 1
    return said


PICTURES = {
    **{
        f"JPEG 2000, {len(s)} bytes of its stream": jpeg2000(32, 24, s)
        for s in (b"", b"\xff\x4f", b"\xff\x4f\xff\x51\0\x2f")
    },
    "JPEG 2000 without boxes": b"\xff\x4f\xff\x51\0\x2f" + bytes(80),
    "a frame larger than the canvas": animated_png(32, 24, (0, 0, 400, 300)),
    "a frame beyond the canvas": animated_png(32, 24, (30, 20, 32, 24)),
    "a frame of one row": animated_png(32, 24, (0, 0, 32, 1)),
    "frames that nothing announces": animated_png(32, 24, (0, 0, 400, 300), "fcTL fdAT"),
}


@pytest.mark.parametrize("place", ["images", "semantics", "instances"])
@pytest.mark.parametrize("name", PICTURES)
def test_no_such_picture_reaches_a_decoder(name: str, place: str, tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    (tmp_path / f"drive/{place}/01.png").write_bytes(PICTURES[name])
    assert f"{place}/01.png: is " in refused("import", drive, "-o", tmp_path / "ws")
    assert not (tmp_path / "ws").exists()


@pytest.mark.parametrize("side", [16_000, 30_000])
@pytest.mark.parametrize("place", ["images", "semantics", "masks"])
def test_a_tiff_of_gigabytes_is_compared_with_its_camera_first(side: int, place: str, tmp_path: Path) -> None:
    data = zlib.compress(bytes(64 << 20))
    tags = {
        256: (4, side), 257: (4, side), 258: (3, 8), 259: (3, 8), 262: (3, 2), 273: (4, 0), 277: (3, 3), 278: (4, side),
        279: (4, len(data)), 284: (3, 1),
    }  # fmt: skip
    drive = make_tiny_drive(tmp_path / "drive", masks=True, semantics=place != "masks")
    (tmp_path / f"drive/{place}/01.png").write_bytes(tiff(tags, data))
    assert f"Not the size of its camera: {side}x{side} pixels, the camera says 32x24" in refused(
        "import", drive, "-o", tmp_path / "ws"
    )


@pytest.mark.parametrize("batches", [1, 16])
def test_a_feather_table_of_gigabytes_is_not_unpacked(batches: int, tmp_path: Path) -> None:
    arrow = pytest.importorskip("pyarrow")
    log = WRITERS["Argoverse 2"](tmp_path / "log", tiny_street(2))
    path = next(log.rglob("city_SE3_egovehicle.feather"))
    names = ["timestamp_ns", "qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m"]
    zeros = np.zeros(16_000_000 // batches)
    batch = arrow.record_batch([zeros.astype(np.int64 if n == "timestamp_ns" else float) for n in names], names=names)
    with arrow.OSFile(str(path), "wb") as sink:
        options = arrow.ipc.IpcWriteOptions(compression="zstd")
        with arrow.ipc.new_file(sink, batch.schema, options=options) as writer:
            for _ in range(batches):
                writer.write_batch(batch)
    del batch
    said = refused("import", log, "-o", tmp_path / "ws")
    assert "city_SE3_egovehicle.feather: unpacks to 16,000,000 rows" in said


def test_a_parquet_table_of_gigabytes_is_not_unpacked(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    segment = WRITERS["Waymo Open v2"](tmp_path / "segment", tiny_street(1))
    path = next(segment.rglob("vehicle_pose/*.parquet"))
    table = parquet.read_table(path)
    name = next(n for n in table.column_names if n.endswith("transform"))
    arrow = pytest.importorskip("pyarrow")
    one = arrow.ListArray.from_arrays([0, 100_000_000], arrow.array(np.zeros(100_000_000)))
    parquet.write_table(
        table.slice(0, 1).set_column(table.column_names.index(name), name, one), path, compression="zstd"
    )
    assert path.stat().st_size < 200_000
    assert "unpacks to" in refused("import", segment, "-o", tmp_path / "ws")


TUPLES = b"(K\x01t" + b"2\x86" * 60
PICKLES = {
    "twelve million lists": b"\x80\x02(" + b"]" * 12_000_000 + b"l.",
    "a key that is never hashed": b"\x80\x02}" + TUPLES + b"K\x01s.",
    "the same in a call": b"\x80\x02ccollections\nOrderedDict\n((" + TUPLES + b"K\x01tltR.",
    "a number of four megabytes": b"\x80\x02\x8b" + struct.pack("<i", 4_000_000) + b"\xff" * 4_000_000 + b".",
    "zeros": b"\x80\x04B" + struct.pack("<I", 300 << 20) + bytes(300 << 20) + b".",
}


@pytest.mark.parametrize("name", PICKLES)
def test_pickles_end(name: str, tmp_path: Path) -> None:
    sequence = WRITERS["PandaSet"](tmp_path / "001", tiny_street(1))
    path = next(sequence.rglob("cuboids/00.pkl*"))
    path.unlink()
    (path.parent / "00.pkl.gz").write_bytes(gzip.compress(PICKLES[name]))
    assert "cuboids/00.pkl.gz: " in refused("import", sequence, "-o", tmp_path / "ws")


def test_empty_faces_and_lists_without_number_end(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    faces = b"element face 20000000\nproperty list uchar int vertex_indices\nend_header\n"
    head = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
    (tmp_path / "drive/points.ply").write_bytes(head + faces + bytes(20_000_012))
    assert "points.ply: " in refused("import", drive, "-o", tmp_path / "ws")
    drive.write_text('{"frames": [' + ",".join(["[]"] * 20_000_000) + "]}")
    assert "transforms.json: " in refused("import", drive, "-o", tmp_path / "ws")


def test_a_network_that_takes_all_memory_is_one_line(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    said = refused("import", drive, "-o", tmp_path / "ws", "--segmenter", greedy(tmp_path / "net.onnx"))
    assert "net.onnx: " in said and "of memory" in said


@pytest.mark.skipif(sys.platform == "win32", reason="Windows ends programs in another way")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_network_without_end_ends_with_the_command(number: int, tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    program = command("import", drive, "-o", tmp_path / "ws", "--segmenter", endless(tmp_path / "net.onnx"))
    end = time.monotonic() + 240
    while not (inner := psutil.Process(program.pid).children()) and time.monotonic() < end:
        time.sleep(0.1)
    assert inner and program.poll() is None
    os.kill(program.pid, number)
    program.communicate(timeout=60)
    assert program.returncode == 130
    assert not psutil.wait_procs(inner, timeout=60)[1]
