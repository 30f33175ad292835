"""A network in a process of its own, with limits of time and memory.

A file of 300 bytes can loop for ever, or ask for all memory there is, inside of a library that heeds neither Ctrl-C nor a limit. So
it runs beside this program: what goes beyond its limits, or is not wanted any more, is ended with its process, on every system.
"""

from __future__ import annotations

import json
import queue
import re
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from unveil_core.base.errors import Interrupted
from unveil_core.base.parallel import in_context
from unveil_core.base.progress import stop_asked
from unveil_core.base.surroundings.programs import environment

__all__ = ["Limits", "NetworkProblem", "OnnxSession", "OnnxValue", "limits_of"]

CHILD = Path(__file__).with_name("child.py")
LOOKS_S = 0.02
"""Between looks at a network that is at work: at its memory, and whether the program is to end."""
TRIED_S = 120.0
"""Seconds for opening a network, and for its first run, on a small picture. Those in use take ten on a slow machine."""
RUN_S = 3600.0
"""Seconds for one picture once it was tried. The largest take minutes."""
FIRST_BYTES, BYTES_OF_ONE = 2 << 30, 4
"""Memory for its first run: at first, and for each byte of its files, which a library copies more than once."""
MOST_OF_ALL = 0.9
"""Share of the machine's memory that it may have later."""
LONGEST_LINE = 4 << 20
KINDS = re.compile(r"[<>=|][fiub][1248]")


class NetworkProblem(Exception):
    """What a network does not do, in words for the user."""


@dataclass(frozen=True)
class OnnxValue:
    """An input or output: its name, its type as ``tensor(float)``, its shape with None for what is free."""

    name: str
    type: str
    shape: tuple[int | None, ...]


@dataclass(frozen=True)
class Limits:
    """Attributes: seconds: for one answer; memory_bytes: that the process may hold meanwhile."""

    seconds: float
    memory_bytes: int


def limits_of(size: int) -> Limits:
    """Of the first run of a network whose files have so many bytes."""
    return Limits(TRIED_S, FIRST_BYTES + BYTES_OF_ONE * size)


class OnnxSession:
    """An ONNX file, open on the CPU. May be shared by threads; one runs at a time.

    Attributes:
        inputs, outputs: what it takes and gives.
        metadata: what its maker wrote into it.
    """

    def __init__(self, path: Path, limits: Limits, *, threads: int | None = None) -> None:
        """Open the file; until :meth:`tried` the limits hold.

        Args:
            threads: how many compute one run; None = one per core.
        Raises:
            NetworkProblem: it cannot be opened, or not within the limits.
        """
        self._limits, self._lock = limits, threading.Lock()
        self._process = subprocess.Popen(
            [sys.executable, "-P", str(CHILD)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment(),
        )
        self._end = weakref.finalize(self, _ended, self._process)
        about, _ = self._asked({"path": str(Path(path).absolute()), "threads": threads}, [])
        try:
            self.inputs, self.outputs = (tuple(_value(v) for v in about[k]) for k in ("inputs", "outputs"))
            self.metadata = {str(k): str(v) for k, v in about["metadata"].items()}
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise self._ended_by("gives no inputs and outputs") from error

    def tried(self) -> None:
        """It does what it is for: from now on it may take what larger pictures need."""
        most = int(psutil.virtual_memory().total * MOST_OF_ALL)
        self._limits = Limits(RUN_S, max(most, self._limits.memory_bytes))

    def run(self, feeds: Mapping[str, NDArray[Any]]) -> list[Any]:
        """Its answers in the order of its outputs: arrays; of others, as lists of arrays, the name of their kind.

        Raises:
            NetworkProblem: it fails, or goes beyond its limits.
            Interrupted: the program is to end.
        """
        arrays = [np.ascontiguousarray(a) for a in feeds.values()]
        head = {"feeds": [[n, a.dtype.str, list(np.shape(a))] for n, a in zip(feeds, arrays, strict=True)]}
        about, answers = self._asked(head, arrays)
        kinds, found = about.get("kinds", []), iter(answers)
        return [kinds[k] if told is None else next(found) for k, told in enumerate(about.get("answers", []))]

    def _asked(self, head: dict[str, Any], arrays: list[NDArray[Any]]) -> tuple[dict[str, Any], list[NDArray[Any]]]:
        """Send a request and wait for its answer."""
        with self._lock:
            if not self._end.alive:
                raise NetworkProblem("has ended already")
            answer: queue.SimpleQueue[Any] = queue.SimpleQueue()
            work = threading.Thread(
                target=in_context(_exchange), args=(self._process, head, arrays, self._limits, answer), daemon=True
            )
            work.start()
            try:
                self._wait(answer, work)
            except BaseException:
                self._end()
                raise
            try:
                found = answer.get_nowait()
            except queue.Empty:
                found = None
            if found is None:
                code = self._process.poll()
                raise self._ended_by("ends its process" if code is None else f"ends its process ({code})")
        about, read = found
        if "error" in about:
            raise NetworkProblem(str(about["error"]))
        return about, read

    def _wait(self, answer: queue.SimpleQueue[Any], work: threading.Thread) -> None:
        begun, held = time.monotonic(), psutil.Process(self._process.pid)
        while work.is_alive():
            work.join(LOOKS_S)
            if stop_asked():
                raise Interrupted
            if time.monotonic() - begun > self._limits.seconds:
                raise NetworkProblem(f"takes more than {self._limits.seconds:.0f} s")
            with suppress(psutil.Error):
                if held.memory_info().rss > self._limits.memory_bytes:
                    raise NetworkProblem(f"takes more than {self._limits.memory_bytes >> 20:,} MB of memory")

    def _ended_by(self, problem: str) -> NetworkProblem:
        self._end()
        return NetworkProblem(problem)


def _value(told: list[Any]) -> OnnxValue:
    name, kind, shape = told
    return OnnxValue(str(name), str(kind), tuple(d if type(d) is int else None for d in shape))


def _exchange(
    process: subprocess.Popen[bytes],
    head: dict[str, Any],
    arrays: list[NDArray[Any]],
    limits: Limits,
    answer: queue.SimpleQueue[Any],
) -> None:
    """Put what the process answers, None where it ends instead, or answers what no network does."""
    found = None
    with suppress(OSError, ValueError, TypeError, MemoryError):
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(json.dumps(head).encode() + b"\n")
        for array in arrays:
            process.stdin.write(array.reshape(-1).view(np.uint8).data)
        process.stdin.flush()
        line = process.stdout.readline(LONGEST_LINE)
        about = json.loads(line)
        if isinstance(about, dict):
            read = []
            for kind, shape in (told for told in about.get("answers", []) if told is not None):
                if not KINDS.fullmatch(kind) or not all(type(n) is int and n >= 0 for n in shape):
                    raise ValueError("no array")
                count = int(np.prod(shape, dtype=object)) if shape else 1
                size = count * np.dtype(kind).itemsize
                if size > limits.memory_bytes:
                    raise ValueError("more than the process may hold")
                content = process.stdout.read(size)
                read.append(np.frombuffer(content, dtype=kind).reshape(shape))
            found = about, read
    answer.put(found)


def _ended(process: subprocess.Popen[bytes]) -> None:
    """End a process, and wait until it is gone."""
    process.kill()
    process.wait()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with suppress(OSError):
                stream.close()
