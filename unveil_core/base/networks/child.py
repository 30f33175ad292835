"""The program that runs one network: started by ``session.py``, and by nobody else.

It reads requests from standard input and writes answers to standard output: a line of JSON each, behind it the bytes of the arrays
that the line tells of. Nothing is pickled. It loads nothing of the project, so that it starts quickly and holds little.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import threading
import time
from typing import Any, BinaryIO

__all__: list[str] = []

LOOKS_S = 1.0
"""Between looks for the program that started this one."""


def _end_with_parent(parent: int) -> None:
    """End with the program that started this one, however that ends: a network may be in a loop without end."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    while os.getppid() == parent:
        time.sleep(LOOKS_S)
    os._exit(1)


def _reply(stream: BinaryIO, head: dict[str, Any], arrays: list[Any] = []) -> None:  # noqa: B006
    stream.write(json.dumps(head).encode() + b"\n")
    for array in arrays:
        stream.write(array.reshape(-1).view("u1").data)
    stream.flush()


def _open(request: dict[str, Any]) -> Any:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4  # what goes wrong is raised as well
    threads = request["threads"]
    if threads is not None:
        options.intra_op_num_threads = options.inter_op_num_threads = threads
        options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
        options.use_deterministic_compute = True
    return onnxruntime.InferenceSession(request["path"], options, providers=["CPUExecutionProvider"])


def _about(session: Any) -> dict[str, Any]:
    def told(values: Any) -> list[list[Any]]:
        return [[v.name, str(v.type), [d if isinstance(d, int) else None for d in v.shape or ()]] for v in values]

    metadata = session.get_modelmeta().custom_metadata_map
    return {"inputs": told(session.get_inputs()), "outputs": told(session.get_outputs()), "metadata": metadata}


def _run(session: Any, request: dict[str, Any], source: BinaryIO) -> tuple[dict[str, Any], list[Any]]:
    import numpy as np

    feeds = {}
    for name, kind, shape in request["feeds"]:
        content = bytearray(np.dtype(kind).itemsize * int(np.prod(shape, dtype=np.int64)))
        source.readinto(content)  # type: ignore[attr-defined]
        feeds[name] = np.frombuffer(content, dtype=kind).reshape(shape)
    answers = session.run(None, feeds)
    arrays = [
        np.ascontiguousarray(a) if isinstance(a, np.ndarray) and a.dtype.kind in "fiub" else None for a in answers
    ]
    told = [None if a is None else [a.dtype.str, list(np.shape(a))] for a in arrays]
    kinds = [type(a).__name__ for a in answers]
    return {"answers": told, "kinds": kinds}, [a for a in arrays if a is not None]


def main() -> None:
    """Serve until standard input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches both; the other decides
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    source, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):  # what libraries print is no answer
        os.dup2(nothing, stream)
    session: Any = None
    while line := source.readline():
        request = json.loads(line)
        try:
            if "path" in request:
                session = _open(request)
                _reply(answers, _about(session))
            else:
                _reply(answers, *_run(session, request, source))
        except Exception as error:  # whatever the library says about a damaged file
            _reply(answers, {"error": str(error) or type(error).__name__})


if __name__ == "__main__":
    main()
