"""Files that are changed under a run, clocks that jump, names that are hard, workspaces of other versions."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from benchmarks.robustness.fault_kinds.bench import HERE, Bench
from benchmarks.robustness.fault_kinds.runs import Run, Tally, digests, done, everything, whole

NAMES = (
    "with spaces and 'quotes' \"both\"",
    "Straße 東京 🚗 дорога",
    "e\u0301tude-o\u0308-\u1100\u1161",  # combining characters
    "-rf",
    "percent %s {0} $HOME `x`",
    "n" * 200,
    "🚙" * 63 + "abc",  # 255 bytes
    b"no text \xff\xfe".decode(errors="surrogateescape"),
    "line\nbreak",
    "/".join(["a folder that is deep"] * 40),
)


def changed(bench: Bench, times: int) -> Iterator[Tally]:
    """Files of the drive changed, cut or removed at a random moment, and put back when the run has ended."""
    names = [p for folder in ("images", "semantics") for p in sorted((bench.drive / folder).iterdir())]
    names += [bench.drive / "points.ply", bench.drive / "transforms.json"]
    for how in ("replaced", "cut short in place", "removed"):
        tally = Tally(f"file of the drive {how} under a run", "goes through, or one line; put back: as if undisturbed")
        for _ in range(times):
            workspace = bench.new()
            run = bench.start(workspace)
            time.sleep(bench.moment(0.2, 0.8))
            path = names[int(bench.generator.integers(len(names)))]
            content, stage = path.read_bytes(), ""
            if how == "replaced":
                other = next(p for p in names if p.parent == path.parent and p.suffix == path.suffix and p != path or p == path)
                new = path.with_name("new")
                new.write_bytes(other.read_bytes() if other != path else content[:-2])
                os.replace(new, path)
            elif how == "removed":
                path.unlink()
            else:
                with path.open("r+b") as stream:
                    stream.truncate(len(content) // 2)
            ended = run.wait()
            assert ended is not None
            if how == "cut short in place":  # the workspace may link this very file
                with path.open("r+b") as stream:
                    stream.write(content)
            else:
                path.unlink(missing_ok=True)
                path.write_bytes(content)
            tally.note(ended, stage=stage, lines=1 if ended.code else 0, hide=(workspace, bench.root))
            # What was finished before the change is not known here; what was made of the changed file is made again.
            bench.go_on(tally, workspace, set())
            shutil.rmtree(workspace, ignore_errors=True)
        yield tally


def times_of_the_future(bench: Bench, times: int) -> Tally:
    """All files are from the future, or from before 1980, after a run was ended half-way."""
    tally = Tally("file times of 2100 and of 1970", "goes on")
    for turn in range(times):
        workspace = bench.new()
        run = bench.start(workspace)
        time.sleep(bench.moment(3.0, 0.6))
        run.send(9)
        ended = run.wait()
        assert ended is not None
        when = 4_102_444_800 if turn % 2 else 1000
        for folder in (workspace, bench.drive):
            for path in folder.rglob("*"):
                os.utime(path, (when, when))
        tally.note(ended, lines=0)
        bench.go_on(tally, workspace, done(workspace))
        shutil.rmtree(workspace, ignore_errors=True)
    return tally


def shim(bench: Bench) -> Path | None:
    """The library of shim.c; None where it cannot be compiled."""
    library = bench.root / "shim.so"
    if not library.is_file():
        command = ["gcc", "-shared", "-fPIC", "-O1", "-o", str(library), str(HERE / "shim.c"), "-ldl"]
        if not shutil.which("gcc") or subprocess.run(command).returncode:
            return None
    return library


def preloaded(bench: Bench, library: Path, workspace: Path, *more: str, **variables: str) -> tuple[int, str]:
    """Exit code and standard error of a whole run as a command of its own, with the library before the C library."""
    environment = {**os.environ, "PYTHONPATH": str(HERE.parents[2]), "LD_PRELOAD": str(library), **variables}
    command = [sys.executable, "-m", "unveil_core", *map(os.fspath, whole(bench.drive, workspace, *more))]
    ended = subprocess.run(command, env=environment, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    return ended.returncode, ended.stderr


def clock(bench: Bench, times: int) -> Tally:
    """The time of day jumps twice a second while a run goes on."""
    tally = Tally("clock set by years twice a second", "0, as if undisturbed")
    library = shim(bench)
    if library is None:
        tally.skipped = "no gcc"
        return tally
    for turn in range(times):
        workspace = bench.new()
        code, text = preloaded(bench, library, workspace, UNVEIL_CLOCK_STEP=("-300000000", "300000000")[turn % 2])
        tally.times += 1
        tally.codes[str(code)] = tally.codes.get(str(code), 0) + 1
        if code:
            tally.trouble.append(text[-1500:])
        tally.compare(digests(workspace), bench.wanted)
        shutil.rmtree(workspace, ignore_errors=True)
    return tally


def hard_names(bench: Bench) -> Iterator[Tally]:
    """Workspaces, drives and photographs with hard names."""
    tally = Tally("hard names of workspace and drive", "0, as if undisturbed")
    until = ("--until", "remove")
    plain = bench.new()
    bench.start(plain, *until).wait()
    wanted = digests(plain)
    wanted.pop("drive/cameras.json")  # names the drive's folder
    for name in NAMES:
        place = bench.new("place")
        place.mkdir()
        drive, workspace = place / "drive" / name, place / "ws" / name
        shutil.copytree(bench.drive, drive)
        ended = Run(whole(drive / "transforms.json", workspace, *until), bench.root / "errors").wait()
        assert ended is not None
        tally.note(ended, lines=0)
        found = digests(workspace)
        found.pop("drive/cameras.json", None)
        tally.compare(found, wanted)
        shutil.rmtree(place)
    yield tally
    tally = Tally("hard names of photographs, up to 255 bytes", "0, the same pictures")
    drive = bench.root / "named"
    shutil.copytree(bench.drive, drive)
    document = json.loads((drive / "transforms.json").read_text())
    for frame, stem in zip(document["frames"], ("a b", "é🚗", "x" * 251, "🚙" * 62 + "abc"), strict=True):
        for key in ("file_path", "semantic_path", "instance_path"):
            old = drive / frame[key]
            frame[key] = f"{old.parent.name}/{stem}.png"
            old.rename(drive / frame[key])
    (drive / "transforms.json").write_text(json.dumps(document))
    workspace = bench.new()
    ended = bench.start(workspace, drive=drive).wait()
    assert ended is not None
    tally.note(ended, lines=0)
    ours, theirs = (Counter(p for n, p in found.items() if n.startswith("frames/")) for found in (digests(workspace), bench.wanted))
    tally.wrong += sum(((ours - theirs) + (theirs - ours)).values())
    yield tally


def versions(bench: Bench) -> Tally:
    """Half-finished workspaces that an older and a newer version made, with what interrupted runs leave."""
    tally = Tally("workspace of an older or newer version", "2, one line, nothing changed")
    workspace = bench.new()
    bench.start(workspace, "--until", "choose").wait()
    (workspace / ".partial-other").mkdir()
    (workspace / ".partial-other" / "file").write_text("of another version")
    (workspace / "events.jsonl").open("a").write('{"cut')
    state = workspace / "workspace.json"
    for number in (0, 2, 99, "3.1"):
        state.write_text(json.dumps({**json.loads(state.read_text()), "format": number}))
        before = everything(workspace)
        for verb in (
            whole(bench.drive, workspace),
            ["segment", workspace],
            ["status", workspace],
            ["render", workspace, "-o", bench.root / "views"],
        ):
            ended = Run(verb, bench.root / "errors").wait()
            assert ended is not None
            tally.note(ended, hide=(workspace, bench.root))
            tally.wrong += ended.code != 2
        tally.changed += before != everything(workspace)
    return tally
