"""What importing the library does to the program that imports it: nothing. The command's own process is another matter."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

SEEN = """
import json, locale, logging, os, signal, sys, threading, warnings

def seen():
    return {
        "path": list(sys.path),
        "argv": list(sys.argv),
        "finders": [repr(f) for f in sys.meta_path],
        "hooks": [repr(h) for h in (sys.excepthook, threading.excepthook, sys.displayhook)],
        **{f"environ {name}": value for name, value in os.environ.items()},
        "barred": sorted(name for name, module in sys.modules.items() if module is None),
        "filters": [repr(f) for f in warnings.filters],
        "signals": {s.name: repr(signal.getsignal(s)) for s in signal.valid_signals() if isinstance(s, signal.Signals)},
        "locale": locale.setlocale(locale.LC_ALL),
        "handlers": [repr(h) for h in logging.getLogger().handlers],
        "umask": (lambda was: (os.umask(was), was)[1])(os.umask(0o22)),
        "threads": threading.active_count(),
    }
"""
OTHERS = "import cv2, jinja2, numba, numpy, PIL, psutil, scipy.ndimage, scipy.spatial, torch\n"
"""Libraries whose own doings when they are imported are not this one's."""


def python(program: str, folder: Path, **environment: str) -> Any:
    """What a fresh interpreter prints, from JSON."""
    env = {k: v for k, v in os.environ.items() if k not in ("OMP_WAIT_POLICY", "OPENCV_IO_MAX_IMAGE_PIXELS")}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, env=env | environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize(
    ("before", "imported"),
    [
        ("", "unveil_core"),
        (OTHERS, "unveil_core.raster"),
        (OTHERS, "unveil_core.api.workspace, unveil_core.pipeline.graph"),
    ],
)
def test_importing_it_leaves_the_host_as_it_was(before: str, imported: str, tmp_path: Path) -> None:
    program = f"{SEEN}\n{before}was = seen()\nimport {imported}\nprint(json.dumps([was, seen()]))"
    was, now = python(program, tmp_path)
    assert {key: (was.get(key), now.get(key)) for key in was | now if was.get(key) != now.get(key)} == {}


def test_a_module_beside_the_host_s_script_is_found_by_it(tmp_path: Path) -> None:
    """``python -m its_module``: the host is at home in its folder."""
    (tmp_path / "its_part.py").write_text("WORD = 'here'")
    (tmp_path / "its_package").mkdir()
    (tmp_path / "its_package/__init__.py").write_text("import unveil_core, sys; sys.its_argv = list(sys.argv)")
    (tmp_path / "its_package/__main__.py").write_text("import its_part; print(its_part.WORD)")
    env = {k: v for k, v in os.environ.items() if k != "PYTHONSAFEPATH"}
    done = subprocess.run([sys.executable, "-m", "its_package"], cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.stdout.strip() == "here", done.stderr


IN_A_LOOP = """
import importlib, json, sys, threading
failed, done = [], threading.Event()
def again():
    while not done.is_set():
        try:
            importlib.import_module("yaml")
        except ImportError as error:
            failed.append(str(error))
            return
thread = threading.Thread(target=again)
thread.start()
import unveil_core.raster
done.set()
thread.join()
print(json.dumps(failed))
"""


def test_another_thread_imports_yaml_meanwhile(tmp_path: Path) -> None:
    pytest.importorskip("yaml")
    assert python(IN_A_LOOP, tmp_path) == []
