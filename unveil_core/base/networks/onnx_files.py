"""Opening networks in ONNX files that the user brings. They run on the CPU, each in a process of its own; nothing in them is ever
unpickled."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.disk.open_safely import check_file
from unveil_core.base.errors import SettingsError
from unveil_core.base.networks.session import OnnxSession, limits_of

__all__ = ["ONNX_TYPES", "check_readable", "describe", "files_of", "open_onnx", "short"]

ONNX_TYPES: dict[str, type[np.generic]] = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(uint8)": np.uint8,
    "tensor(bool)": np.bool_,
}
"""What arrays the inputs of networks of pictures take, by the name of their type."""


def check_readable(path: Path, mend: str) -> None:
    """Raise a SettingsError that names ``path`` and the remedy ``mend`` unless it is a file that can be read."""
    try:
        check_file(path)
    except OSError as error:
        raise SettingsError(f"cannot be read: {error.strerror}", path=path, mend=mend) from error


def files_of(path: Path) -> list[Path]:
    """The file and, beside it, those of the same name with something appended: where exporters put large weights
    (``NAME.onnx.data``, ``NAME.onnx_data``)."""
    return sorted(p for p in path.parent.iterdir() if p.name.startswith(path.name) and p.is_file())


def open_onnx(path: Path, *, threads: int | None = None) -> OnnxSession:
    """A network on the CPU, in a process of its own; see :class:`~unveil_core.base.networks.session.OnnxSession`.

    Args:
        threads: how many compute one run; None = one per core. With one the same input gives the same bytes on every run,
            whatever number of cores the machine has.
    Raises:
        NetworkProblem: whatever the library says about a damaged file; or it takes more time or memory than any network.
    """
    return OnnxSession(path, limits_of(sum(p.stat().st_size for p in files_of(path))), threads=threads)


def short(error: Exception) -> str:
    """One line: of TorchScript's tracebacks the last, which says what is wrong."""
    lines = [line for line in str(error).splitlines() if line.strip()] or [type(error).__name__]
    return textwrap.shorten(lines[-1] if "Traceback" in str(error) else " ".join(lines), 200, placeholder=" …")


def describe(values: Sequence[Any]) -> str:
    """Inputs or outputs of a session in words."""
    words = []
    for v in values:
        shape = ", ".join("?" if not isinstance(d, int) else str(d) for d in v.shape or ())
        words.append(f"{v.name!r} ({shape}) {str(v.type).removeprefix('tensor(').removesuffix(')')}")
    return " and ".join(words) or "none"
