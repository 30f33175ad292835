"""pycolmap beside this program: a request, its progress, its answer; ended with whatever ends this program."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from importlib.util import find_spec
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from unveil_core.base.errors import Interrupted, SettingsError, UnveilError
from unveil_core.base.parallel import in_context
from unveil_core.base.progress import Progress, no_progress, stop_asked
from unveil_core.base.surroundings.programs import environment

__all__ = ["SEED", "check_installed", "mapped"]

CHILD = Path(__file__).with_name("child.py")
SEED = 1
"""Of what pycolmap draws: the same frames give the same cameras."""
LOOKS_S = 0.1
"""Between looks whether the program is to end."""


def check_installed(*modules: str) -> None:
    """Check that optional modules of the extra ``solve`` are there.

    Raises:
        SettingsError: one is missing.
    """
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        packages = " and ".join(missing)
        raise SettingsError(
            f"Not installed: {packages}", mend='install the extra solve: pip install ".[solve]" in the folder of Unveil'
        )


def mapped(request: dict[str, Any], progress: Progress = no_progress) -> dict[str, Any]:
    """What pycolmap answers to a request, see ``child.py``.

    Args:
        request: with the key ``do``; all else is of that work. ``seed`` and ``threads`` are added.
    Raises:
        UnveilError: it failed. Cancelled, Interrupted: it was not wanted any more, and its process is ended.
    """
    check_installed("pycolmap")
    process = subprocess.Popen(
        [sys.executable, "-P", str(CHILD)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=environment(),
        text=True,
        encoding="utf-8",
    )
    lines: SimpleQueue[str] = SimpleQueue()
    assert process.stdin is not None and process.stdout is not None
    output = process.stdout

    def listen() -> None:
        for line in output:
            lines.put(line)
        lines.put("")

    try:
        process.stdin.write(json.dumps({"seed": SEED, "threads": -1, **request}) + "\n")
        process.stdin.close()
        threading.Thread(target=in_context(listen), daemon=True).start()
        while True:
            try:
                line = lines.get(timeout=LOOKS_S)
            except Empty:
                if stop_asked():
                    raise Interrupted from None
                continue
            told: dict[str, Any] = json.loads(line) if line else {"error": "it ended without an answer"}
            if "error" in told:
                raise UnveilError(f"COLMAP failed at {request['do']}: {told['error']}", mend="run it again: it goes on")
            if "answer" in told:
                answer: dict[str, Any] = told["answer"]
                return answer
            progress(told["done"], told["total"], told["message"])
    finally:
        process.kill()
        process.wait()
        output.close()
