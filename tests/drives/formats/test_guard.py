"""What no reader foresaw is one line, also where it is read later."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path

import pytest

from tests.drives.formats.street.all_formats import WRITERS
from tests.drives.formats.street.street import tiny_street
from unveil_core.base.errors import UnveilError
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Sweep
from unveil_core.drives.formats.guard import with_guarded_readers

TRIES = 60
SLOW = {"Waymo Open v2": 12}
"""Its range images take a second to read."""


def read_all(path: Path) -> None:
    """Open a drive and read what is only read later."""
    drive = open_drive(path)
    for frame in drive.frames[:1]:
        for read in (frame.labels, frame.image_bytes):
            if read is not None:
                read()
    for sweep in drive.sweeps[:1]:
        sweep.read()


@pytest.mark.parametrize("kind", WRITERS)
def test_damaged_files_are_refused_or_read(kind: str, tmp_path: Path) -> None:
    path = WRITERS[kind](tmp_path, tiny_street(2))
    files = sorted(p for p in tmp_path.rglob("*") if p.is_file())
    generator = random.Random(1)
    refused = 0
    for _ in range(SLOW.get(kind, TRIES)):
        file = generator.choice(files)
        content = file.read_bytes()
        damaged = bytearray(content)
        for _ in range(generator.choice((1, 4, 30))):
            damaged[generator.randrange(len(damaged))] = generator.randrange(256)
        if generator.random() < 0.3:
            del damaged[generator.randrange(len(damaged)) :]
        file.write_bytes(bytes(damaged))
        try:
            read_all(path)
        except UnveilError as error:
            assert "\n" not in str(error)
            refused += 1
        finally:
            file.write_bytes(content)
    assert refused
    read_all(path)


def test_errors_of_a_sweep_name_its_file(tmp_path: Path) -> None:
    def read() -> None:
        raise IndexError("7 is out of range")

    drive = open_drive(WRITERS["KITTI raw"](tmp_path, tiny_street(2)))
    broken = replace(drive, sweeps=(Sweep(tmp_path / "7.bin", read),))
    with pytest.raises(UnveilError, match="7.bin: holds something that no drive of KITTI raw has: IndexError 7"):
        with_guarded_readers(broken, "KITTI raw").sweeps[0].read()
