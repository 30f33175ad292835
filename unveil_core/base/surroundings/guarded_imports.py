"""Libraries that look into the working folder when they are imported, or make others look there, are kept from it.

numba takes the settings in ``.numba_config.yaml`` of the working folder, at import and at each compilation: they can write to any
file, and make it load any pickle. OpenCV puts an empty entry into ``LD_LIBRARY_PATH``, which stands for the working folder: each
program that is started later loads ``libc.so.6`` from there. Both are met where they are imported, whoever imports them first.

That changes how the whole process imports, so it is for the command and for programs that it starts: a library leaves its host as
it is.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the command line starts at once
    from importlib.machinery import ModuleSpec

__all__ = ["own_this_process"]

NUMBA_SETTINGS = "numba.core.config"
_Guard = Callable[[ModuleType], AbstractContextManager[None]]


@contextmanager
def _without_settings_of_folder(numba_config: ModuleType) -> Iterator[None]:
    """numba reads its settings from the environment alone."""
    missing = object()
    yaml = sys.modules.get("yaml", missing)
    # Without YAML the file is not opened; it is only missed, in a warning.
    sys.modules["yaml"] = None  # type: ignore[assignment]
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="A Numba config file is found")
            yield
    finally:
        if yaml is missing:
            del sys.modules["yaml"]
        else:
            sys.modules["yaml"] = yaml  # type: ignore[assignment]
    _name_no_file(numba_config)


def _name_no_file(numba_config: ModuleType) -> None:
    numba_config._config_fname = ""  # type: ignore[attr-defined]


@contextmanager
def _library_path_kept(_: ModuleType) -> Iterator[None]:
    """What the module does to the path of libraries is for itself, not for programs that are started."""
    before = os.environ.get("LD_LIBRARY_PATH")
    try:
        yield
    finally:
        if before is not None:
            os.environ["LD_LIBRARY_PATH"] = before
        else:
            os.environ.pop("LD_LIBRARY_PATH", None)


GUARDS: dict[str, _Guard] = {NUMBA_SETTINGS: _without_settings_of_folder, "cv2": _library_path_kept}


class _Guarding:
    """Finds what the others find, and guards the making of the modules that need it."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        guard = GUARDS.get(fullname)
        if guard is None:
            return None
        for finder in sys.meta_path:
            if not isinstance(finder, _Guarding):
                spec = finder.find_spec(fullname, path, target)
                if spec is not None:
                    _guard(spec.loader, guard)
                    return spec
        return None


def _guard(loader: object, guard: _Guard) -> None:
    make: Callable[[ModuleType], None] | None = getattr(loader, "exec_module", None)
    if make is None:
        return

    def make_guarded(module: ModuleType) -> None:
        with guard(module):
            make(module)

    loader.exec_module = make_guarded  # type: ignore[attr-defined]


def _guard_imports() -> None:
    """Guard what is imported from now on. What numba has read before is taken back."""
    if not any(isinstance(finder, _Guarding) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Guarding())
    numba_config = sys.modules.get(NUMBA_SETTINGS)
    if numba_config is not None and getattr(numba_config, "_config_fname", None):
        _name_no_file(numba_config)
        numba_config.reload_config()  # does nothing unless a file had said something


def own_this_process() -> None:
    """For the command, before it imports a library: what only the owner of a process may set, for it and what it starts.

    Neither imports from the working folder: ``python -m unveil_core`` has left it before (see ``unveil_core/__main__``), and
    workers of a batch are started with ``python -c``.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
    # On a busy machine spinning OpenMP threads double the time of a training step. It has to be set before torch is imported.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    # The most pixels of a picture, beside base/pictures/decoding.py's own check. It has to be set before cv2 is imported.
    os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(1 << 28))
    _guard_imports()
