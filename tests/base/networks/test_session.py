"""Networks in processes of their own: the same answers, and an end to those that have none."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnxruntime
import psutil
import pytest

from tests.base.networks.hostile import endless, endless_for_bright, endless_scan, greedy
from tests.inpaint import networks
from unveil_core.base.errors import Interrupted, SettingsError
from unveil_core.base.networks import session
from unveil_core.base.networks.onnx_files import open_onnx
from unveil_core.base.networks.session import Limits, NetworkProblem, OnnxSession, limits_of
from unveil_core.base.parallel import in_context
from unveil_core.base.progress import heeding
from unveil_core.labelling.segmenter import load_segmenter

NOISE = {"image": np.random.default_rng(0).random((1, 3, 64, 64), np.float32)}
WHITE = {"image": np.full((1, 3, 64, 64), 9, np.float32)}
LITTLE = Limits(3.0, 1 << 30)


def children() -> set[int]:
    return {p.pid for p in psutil.Process().children()}


def test_it_gives_what_the_library_gives(tmp_path: Path) -> None:
    networks.mean_fill(tmp_path / "n.onnx")
    theirs = onnxruntime.InferenceSession(str(tmp_path / "n.onnx"), providers=["CPUExecutionProvider"])
    ours = open_onnx(tmp_path / "n.onnx", threads=1)
    assert [(v.name, v.type) for v in ours.inputs] == [(v.name, v.type) for v in theirs.get_inputs()]
    assert [v.name for v in ours.outputs] == [v.name for v in theirs.get_outputs()]
    rng = np.random.default_rng(0)
    feeds = {v.name: rng.random((1, 3 if k == 0 else 1, 72, 80)).astype(np.float32) for k, v in enumerate(ours.inputs)}
    for _ in range(3):
        for a, b in zip(ours.run(feeds), theirs.run(None, feeds), strict=True):
            assert a.dtype == b.dtype
            np.testing.assert_array_equal(a, b)
    with pytest.raises(NetworkProblem, match="Got invalid dimensions|Unexpected|INVALID"):
        ours.run({name: value[:, :, :, :, None] for name, value in feeds.items()})
    assert len(ours.run(feeds)) == len(theirs.get_outputs())  # after an error it goes on


def test_its_process_goes_with_it(tmp_path: Path) -> None:
    networks.mean_fill(tmp_path / "n.onnx")
    before = children()
    opened = open_onnx(tmp_path / "n.onnx")
    assert len(children() - before) == 1
    del opened
    assert children() == before


@pytest.mark.parametrize("make", [endless, endless_scan], ids=lambda f: f.__name__)
def test_a_loop_without_end_ends(make: Callable[[Path], Path], tmp_path: Path) -> None:
    before = children()
    opened = OnnxSession(make(tmp_path / "n.onnx"), Limits(300.0, 1 << 30))
    opened._limits = LITTLE
    with pytest.raises(NetworkProblem, match="takes more than 3 s"):
        opened.run(NOISE)
    with pytest.raises(NetworkProblem, match="has ended already"):
        opened.run(NOISE)
    assert children() == before


def test_what_asks_for_all_memory_ends(tmp_path: Path) -> None:
    opened = OnnxSession(greedy(tmp_path / "n.onnx"), Limits(300.0, 1 << 30))
    with pytest.raises(NetworkProblem, match="takes more than 1,024 MB of memory"):
        opened.run(NOISE)


def test_a_segmenter_without_end_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "TRIED_S", 3.0)
    with pytest.raises(SettingsError, match=r"n\.onnx: does not take .*takes more than 3 s"):
        load_segmenter(endless(tmp_path / "n.onnx"))
    with pytest.raises(SettingsError, match=r"m\.onnx: .*takes more than [0-9,]+ (MB of memory|s)"):
        load_segmenter(greedy(tmp_path / "m.onnx"))


def test_trial_and_work_have_limits_of_their_own(tmp_path: Path) -> None:
    assert limits_of(10 << 30).memory_bytes == (2 << 30) + (40 << 30)
    networks.mean_fill(tmp_path / "n.onnx")
    opened = open_onnx(tmp_path / "n.onnx")
    assert opened._limits.seconds == session.TRIED_S
    opened.tried()
    assert opened._limits.seconds == session.RUN_S
    assert opened._limits.memory_bytes > psutil.virtual_memory().total // 2


def test_a_stop_ends_a_network_at_work_in_any_thread(tmp_path: Path) -> None:
    """It was tried with noise, and loops for ever on a white picture."""
    opened = open_onnx(endless_for_bright(tmp_path / "n.onnx"))
    opened.run(NOISE)
    opened.tried()
    raised: list[BaseException] = []
    stop = threading.Event()

    def work() -> None:
        try:
            opened.run(WHITE)
        except BaseException as error:
            raised.append(error)

    with heeding(stop):
        thread = threading.Thread(target=in_context(work))
    thread.start()
    thread.join(2)
    assert thread.is_alive()
    stop.set()
    thread.join(60)
    assert not thread.is_alive() and isinstance(raised[0], Interrupted)


WAITS = """
import signal
import sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it
from pathlib import Path
from unveil_core.base.networks.onnx_files import open_onnx
import numpy as np
opened = open_onnx(Path(sys.argv[1]))
print(opened._process.pid, flush=True)
opened.run({"image": np.zeros((1, 3, 64, 64), np.float32)})
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows ends processes in another way")
@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM", "SIGKILL"])
def test_however_the_program_ends_the_network_does_too(number: str, tmp_path: Path) -> None:
    path = endless(tmp_path / "n.onnx")
    program = subprocess.Popen(
        [sys.executable, "-c", WAITS, str(path)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    assert program.stdout is not None
    child = int(program.stdout.readline())
    time.sleep(1)
    os.kill(program.pid, getattr(signal, number))
    program.wait(60)
    until = time.monotonic() + 60
    while psutil.pid_exists(child) and psutil.Process(child).status() != "zombie" and time.monotonic() < until:
        time.sleep(0.1)
    assert not psutil.pid_exists(child) or psutil.Process(child).status() == "zombie"
