"""Runs a reader on many changed files in a process of its own, which is watched, and counts what went wrong."""

from __future__ import annotations

import ctypes
import gc
import json
import mmap
import os
import resource
import signal
import tempfile
import time
import warnings
import zlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from random import Random

from tests.fuzz.mutate import Mutator, mutator_of
from tests.fuzz.reader import Opened, Reader
from tests.fuzz.shrink import shrunk
from tests.fuzz.verdict import Finding, judged

__all__ = ["HANG_S", "MEMORY_MB", "Case", "Tally", "fuzz", "input_of"]

HANG_S = {"text": 5.0, "binary": 5.0, "drive": 20.0}
"""Seconds that an input may take."""
MEMORY_MB = {"text": 128, "binary": 128, "drive": 512}
"""That it may take beyond what the process holds; the files have a few kilobytes."""
ADDRESS_SPACE = 1 << 30
"""Bytes that a process may ask for beyond what it has: what asks for more fails."""
KEPT_OF_ONE_KIND = 3
OWN_FAULT, BROKEN = 113, "broken"
"""Exit code of a process that failed in this module, and how that is called."""


class State(ctypes.Structure):
    """What the watched process tells of itself, in memory that both share."""

    _fields_ = [
        ("index", ctypes.c_int64),
        ("begun", ctypes.c_double),
        ("tried", ctypes.c_int64),
        ("read", ctypes.c_int64),
    ]


@dataclass
class Case:
    """An input that was found wrong: its number, the file that was changed, what it showed, and its content, made small."""

    index: int
    file: str
    finding: Finding
    content: bytes = b""


@dataclass
class Tally:
    """Attributes:
    tried: inputs; read: of these taken as sound, the others were refused or are findings.
    seconds: it took.
    counts: findings by kind.
    cases: the first of each.
    """

    tried: int = 0
    read: int = 0
    seconds: float = 0.0
    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(("crash", "hang", "memory", "wrong"), 0))
    cases: list[Case] = field(default_factory=list)


def input_of(reader: Reader, mutators: list[Mutator], seed: int, index: int) -> tuple[int, bytes]:
    """Which of its files an input changes, and to what: the same for the same seed and number."""
    rng = Random((zlib.crc32(reader.name.encode()) << 64) + (seed << 48) + index)
    k = rng.randrange(len(mutators))
    return k, mutators[k].mutate(rng)


def fuzz(
    reader: Reader,
    inputs: int,
    *,
    seed: int = 0,
    seconds: float | None = None,
    findings: Path | None = None,
    say: Callable[[str], None] = print,
) -> Tally:
    """Try a reader.

    Args:
        inputs: how many; seconds: after which it ends in any case.
        findings: folder for the inputs that went wrong.
    """
    begun, tally = time.monotonic(), Tally()
    until = None if seconds is None else begun + seconds
    memory = Path("/dev/shm") if os.access("/dev/shm", os.W_OK) else None
    with tempfile.TemporaryDirectory(prefix="fuzz_", dir=memory) as folder:
        opened = reader.prepare(Path(folder) / "files")
        originals = [file.read_bytes() for file in opened.files]
        shared = mmap.mmap(-1, ctypes.sizeof(State))
        state, log, first = State.from_buffer(shared), Path(folder) / "log.jsonl", 0
        work = _Work(reader, opened, originals, state, seed, until, log)
        while first < inputs and (until is None or time.monotonic() < until):
            state.index, state.begun = first, time.monotonic()
            process = os.fork()
            if process == 0:
                _child(work, range(first, inputs))
            ended = _watched(process, state, HANG_S[reader.kind])
            if ended == "":
                break
            if ended == BROKEN:
                raise RuntimeError(log.with_suffix(".error").read_text())
            # The input that it died of is left out, and the work goes on behind it.
            k, content = input_of(reader, [mutator_of(c) for c in originals], seed, state.index)
            kind = "hang" if ended == "hang" else "crash"
            case = Case(state.index, opened.files[k].name, Finding(kind, ended, ""), content)
            tally.counts[kind] += 1
            state.tried += 1
            tally.cases.append(case)
            first = state.index + 1
            for file, original in zip(opened.files, originals, strict=True):
                _put(file, original)
        tally.tried, tally.read = state.tried, state.read
        del state, work
        shared.close()
        for line in log.read_text().splitlines() if log.is_file() else ():
            entry = json.loads(line)
            finding = Finding(entry["kind"], entry["where"], entry["trace"])
            tally.counts[finding.kind] += 1
            if entry["content"] is not None:
                tally.cases.append(Case(entry["index"], entry["file"], finding, bytes.fromhex(entry["content"])))
    tally.seconds = time.monotonic() - begun
    for number, case in enumerate(tally.cases):
        say(f"  {reader.name}, input {case.index} ({case.file}): {case.finding.kind}: {case.finding.where}")
        if findings is not None:
            place = findings / f"{reader.name.replace('/', '_')}_{number:03d}"
            place.mkdir(parents=True, exist_ok=True)
            (place / case.file).write_bytes(case.content)
            (place / "finding.json").write_text(json.dumps({**asdict(case.finding), "index": case.index, "seed": seed}))
            (place / "trace.txt").write_text(case.finding.trace)
    return tally


def _watched(process: int, state: State, limit_s: float) -> str:
    """Wait for a process; "" where it came to its end, else what stopped it."""
    while True:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            if os.WIFSIGNALED(status):
                return f"died of signal {os.WTERMSIG(status)}"
            return {0: "", OWN_FAULT: BROKEN}.get(os.WEXITSTATUS(status), f"ended with {os.WEXITSTATUS(status)}")
        index, begun = state.index, state.begun
        if time.monotonic() - begun > limit_s and state.index == index and state.begun == begun:
            os.kill(process, signal.SIGKILL)
            os.waitpid(process, 0)
            return "hang"
        time.sleep(0.02)


@dataclass(frozen=True, eq=False)
class _Work:
    """What the watched processes of one reader have in common.

    Attributes:
        originals: of ``opened.files``, in their order.
        state: shared with the watcher.
        until: time of the monotonic clock at which it ends in any case.
        log: where findings are noted, a line each.
    """

    reader: Reader
    opened: Opened
    originals: list[bytes]
    state: State
    seed: int
    until: float | None
    log: Path


def _child(work: _Work, numbers: range) -> None:
    """The watched process; it never returns."""
    try:
        nothing = os.open(os.devnull, os.O_WRONLY)
        for stream in (1, 2):  # what libraries say of damaged files
            os.dup2(nothing, stream)
        warnings.simplefilter("ignore")
        gc.freeze()  # the modules are no garbage of the readers
        held = int(Path("/proc/self/statm").read_text().split()[0]) * mmap.PAGESIZE
        resource.setrlimit(resource.RLIMIT_AS, (held + ADDRESS_SPACE, held + ADDRESS_SPACE))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        _tried(work, numbers)
    except BaseException as error:
        with work.log.with_suffix(".error").open("a") as stream:
            stream.write(repr(error))
        os._exit(OWN_FAULT)
    os._exit(0)


def _tried(work: _Work, numbers: range) -> None:
    reader, opened, originals, state = work.reader, work.opened, work.originals, work.state
    mutators = [mutator_of(content) for content in originals]
    seen: dict[str, int] = {}
    allowed = MEMORY_MB[reader.kind] << 10
    judged(reader, opened, opened.files[0])  # what is loaded or compiled at the first call is no input's
    changed: int | None = None
    for index in numbers:
        if work.until is not None and time.monotonic() > work.until:
            return
        k, content = input_of(reader, mutators, work.seed, index)
        if changed not in (None, k):
            _put(opened.files[changed], originals[changed])
        file, changed = opened.files[k], k
        _put(file, content)
        held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        state.index, state.begun = index, time.monotonic()
        verdict = judged(reader, opened, file)
        state.begun = time.monotonic()
        taken = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - held
        if taken > allowed and isinstance(verdict, bool):
            verdict = Finding("memory", f"takes more than {MEMORY_MB[reader.kind]} MB", f"{taken >> 10} MB")
            Path("/proc/self/clear_refs").write_text("5")
        state.tried += 1
        if isinstance(verdict, Finding):
            known = seen[verdict.where] = seen.get(verdict.where, 0) + 1
            if known == 1:
                content = _small(reader, opened, file, content, verdict, state)
            kept = content.hex() if known <= KEPT_OF_ONE_KIND and len(content) < 1 << 22 else None
            entry = {**asdict(verdict), "index": index, "file": file.name, "content": kept}
            with work.log.open("a") as stream:
                stream.write(json.dumps(entry) + "\n")
        else:
            state.read += verdict


def _put(file: Path, content: bytes) -> None:
    """Write a file, quicker than ``Path.write_bytes``; it may have been removed."""
    handle = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    try:
        os.write(handle, content)
    finally:
        os.close(handle)


def _small(reader: Reader, opened: Opened, file: Path, content: bytes, verdict: Finding, state: State) -> bytes:
    """The content made small, where that shows the same again; what took much memory is left as it is."""
    if verdict.kind == "memory":
        return content

    def still(other: bytes) -> bool:
        _put(file, other)
        state.begun = time.monotonic()
        again = judged(reader, opened, file)
        return isinstance(again, Finding) and again.where == verdict.where

    return shrunk(content, still) if still(content) else content
