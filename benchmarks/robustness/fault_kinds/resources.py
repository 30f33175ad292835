"""Too little memory, too little disk, and places that cannot be written."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from benchmarks.robustness.fault_kinds.bench import Bench
from benchmarks.robustness.fault_kinds.runs import Tally, done, everything

MB = 2**20
NOBODY = 65534


def address_space(bench: Bench, times: int) -> Tally:
    """A limit of the process's address space, so that allocations fail."""
    tally = Tally("memory: a limit (RLIMIT_AS)", "1, one line that says what would fit, goes on")

    def prepare(_: Path) -> Callable[[], object]:
        room = int(bench.generator.uniform(16, 500) * MB)

        def limit() -> None:
            held = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
            resource.setrlimit(resource.RLIMIT_AS, (held + room, held + room))

        return limit

    bench.series(tally, times, prepare=prepare)
    return tally


def control_group(bench: Bench, times: int) -> Tally:
    """A group of processes with a limit: the system kills the one that holds most."""
    tally = Tally("memory: the system's killer (control group)", "killed by the system, goes on")
    second = Path("/sys/fs/cgroup/cgroup.subtree_control").is_file()
    group = Path("/sys/fs/cgroup" if second else "/sys/fs/cgroup/memory") / "unveil_faults"
    limit = group / ("memory.max" if second else "memory.limit_in_bytes")
    try:
        group.mkdir(exist_ok=True)
        limit.write_text(str(400 * MB))
    except OSError as error:
        tally.skipped = f"no control group for memory can be made here: {error}"
        return tally

    def prepare(_: Path) -> Callable[[], object]:
        room = int(bench.generator.uniform(12, 150) * MB)

        def enter() -> None:
            limit.write_text(str(room))
            (group / "cgroup.procs").write_text(str(os.getpid()))

        return enter

    try:
        bench.series(tally, times, prepare=prepare, lines=None)
    finally:
        with suppress(OSError):
            group.rmdir()
    return tally


@contextmanager
def mounted(place: Path, *options: str) -> Iterator[None]:
    """Something mounted at a folder, as long as the block lasts.

    Raises:
        OSError: there is no right to.
    """
    place.mkdir(parents=True, exist_ok=True)
    made = subprocess.run(["mount", *options, str(place)], capture_output=True, text=True)
    if made.returncode:
        raise OSError(made.stderr.strip())
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(place)], capture_output=True)


def full_disk(bench: Bench, times: int) -> Tally:
    """A small disk that grows by a little each time it was full."""
    tally = Tally("disk full (small tmpfs)", "1, one line, goes on")
    disk = bench.root / "disk"
    try:
        with mounted(disk, "-t", "tmpfs", "-o", "size=64k", "tmpfs"):
            room = [64]

            def grow(_: Path | None = None) -> None:
                # The last run is to come to its end.
                room[0] += int(bench.generator.uniform(16, 400)) if tally.times < times else 64 * 1024
                subprocess.run(["mount", "-o", f"remount,size={room[0]}k", str(disk)], check=True)

            def new() -> Path:
                room[0] = 16
                grow()
                return disk / f"ws{tally.times}"

            bench.series(tally, times, between=grow, new=new)
    except OSError as error:
        tally.skipped = f"no disk can be mounted here: {error}"
    return tally


def read_only(bench: Bench, times: int) -> Iterator[Tally]:
    """Workspaces, their parents and drives that cannot be written."""

    def as_nobody() -> None:
        os.setgroups([])
        os.setgid(NOBODY)
        os.setuid(NOBODY)

    bench.root.chmod(0o755)
    for fault, parent in (("workspace", False), ("parent folder", True)):
        tally = Tally(f"read-only {fault}", "2, one line, nothing changed")
        for turn in range(times):
            place = bench.new("place")
            workspace = place / "ws"
            place.mkdir()
            if not parent:
                bench.start(workspace, "--until", "segment").wait()
            finished, before = done(workspace), everything(place)
            _on_read_only(bench, tally, place, workspace, None if turn % 2 else as_nobody)
            tally.changed += before != everything(place)
            if not turn:
                bench.go_on(tally, workspace, finished)
            shutil.rmtree(place)
        yield tally
    tally = Tally("read-only drive", "0, as if it could be written")
    try:
        with mounted(bench.root / "ro", "--bind", "-o", "ro", str(bench.drive)):
            subprocess.run(["mount", "-o", "remount,bind,ro", str(bench.root / "ro")], check=True)
            workspace = bench.new()
            tally.times, tally.codes = 1, {"0": 1}
            bench.go_on(tally, workspace, set(), drive=bench.root / "ro", but=("drive/cameras.json",))  # names the drive's folder
    except (OSError, subprocess.CalledProcessError) as error:
        tally.skipped = f"nothing can be mounted read-only here: {error}"
    yield tally


def _on_read_only(bench: Bench, tally: Tally, place: Path, workspace: Path, nobody: Callable[[], None] | None) -> None:
    """A run there by a user who may not write (``nobody``), or on a mount that may not be written."""
    if nobody is not None:
        ended = bench.start(workspace, prepare=nobody).wait()
    else:
        try:
            with mounted(place, "--bind", str(place)):
                subprocess.run(["mount", "-o", "remount,bind,ro", str(place)], check=True)
                ended = bench.start(workspace).wait()
        except (OSError, subprocess.CalledProcessError) as error:
            tally.trouble.append(f"nothing can be mounted read-only here: {error}")
            return
    assert ended is not None
    tally.note(ended, hide=(place, bench.root))
