"""The ``unveil`` command. Exit 0 done, 1 failed, 2 bad input or usage, 130 cancelled."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from unveil_core.app.console import say
from unveil_core.app.parser import command_parser
from unveil_core.app.stdin_watch import end_with_stdin
from unveil_core.app.verbs import VERBS
from unveil_core.base.errors import Cancelled, DiskFullError, Interrupted, OutOfMemoryError, UnveilError
from unveil_core.base.kernels.device import check_device, working_on
from unveil_core.base.progress import heeding
from unveil_core.base.surroundings.guarded_imports import own_this_process

__all__ = ["CANCELLED", "main"]

CANCELLED = "unveil: cancelled; run the same command again to go on"
CANCELLED_CODE = 130
NO_MEMORY = "unveil: failed: no memory left (end other programs, or use a machine with more)"


def main(argv: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    if argv is None:  # the process is this program's own
        own_this_process()
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError, ValueError):  # names of files need not be text that a terminal can show
            stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    try:
        arguments = command_parser().parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0) if isinstance(stop.code, int | None) else 2
    asked = threading.Event()
    try:
        device = getattr(arguments, "works_on", "auto")  # what a run is told to work on, it sees to itself
        with _interrupts(asked), heeding(asked), working_on(device):
            check_device(device)
            if arguments.end_with_stdin:
                end_with_stdin()
            return VERBS[arguments.verb](arguments)
    except UnveilError as error:
        more = {"problem": error.problem, "path": None if error.path is None else str(error.path), "mend": error.mend}
        return _say(f"error: {error}", 2, arguments.json, more)
    except (DiskFullError, OutOfMemoryError) as error:
        return _say(f"failed: {error}", 1, arguments.json)
    except (Cancelled, KeyboardInterrupt):
        return _say(CANCELLED.removeprefix("unveil: "), CANCELLED_CODE, arguments.json)
    except BrokenPipeError:  # who read the output has left, as ``head`` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is left to be written goes nowhere
        return 1
    except Exception as error:
        if arguments.debug:
            raise
        return _say(*_of_any(error, asked.is_set()), arguments.json)


def _of_any(error: Exception, interrupted: bool) -> tuple[str, int]:
    """Line and exit code of an error that none of the program's own says better."""
    # Loads NumPy, which is loaded by then where anything went wrong that is worth to be told apart.
    from unveil_core.base.disk.open_safely import RefusedFileError
    from unveil_core.base.files import full_disk, is_out_of_gpu_memory, is_out_of_memory

    if interrupted:  # libraries that are being loaded make an error of their own of it
        return CANCELLED.removeprefix("unveil: "), CANCELLED_CODE
    if is_out_of_gpu_memory(error):
        return "no memory left on the GPU (end other programs that use it, or use --device cpu)", 1
    if is_out_of_memory(error):
        return NO_MEMORY.removeprefix("unveil: "), 1
    text = " ".join(f"{type(error).__name__}: {error}".split())
    if isinstance(error, RefusedFileError):
        return f"error: {error.filename}: {error.strerror} (put a file in its place)", 2
    if isinstance(error, OSError):
        if full := full_disk(error, Path.cwd()):
            return f"failed: {DiskFullError(full)}", 1
        if error.filename is not None and error.strerror:
            return f"failed: {error.filename}: {error.strerror} (--debug shows where)", 1
    return f"failed: {text} (the traceback is in the workspace's events.jsonl; --debug shows it)", 1


def _say(line: str, code: int, as_json: bool = False, more: Mapping[str, str | None] | None = None) -> int:
    """Say how the command ends: on standard error for people, and as the last event on standard output for programs."""
    line = " ".join(line.split())
    with suppress(OSError):  # whoever listened may be gone
        if as_json:
            event = {"t": round(time.time(), 3), "stage": "", "done": 0, "total": 0}
            message = line.removeprefix("error: ").removeprefix("failed: ")
            level = "error" if code != CANCELLED_CODE else "notice"
            print(
                json.dumps({**event, "message": message, "level": level, **(more or {}), "exit_code": code}), flush=True
            )
        say(f"unveil: {line}", sys.stderr)
    return code


@contextmanager
def _interrupts(asked: threading.Event) -> Iterator[None]:
    """SIGTERM ends the command as Ctrl-C does, also before and after the stages, which heed both themselves."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: object) -> None:
        asked.set()
        raise Interrupted

    previous = {s: signal.signal(s, stop) for s in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
