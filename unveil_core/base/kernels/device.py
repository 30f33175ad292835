"""The device that rasterizes and trains: the processor, or an NVIDIA GPU.

Stages keep scenes and pictures in the processor's memory, where files, numpy and numba work on them. What is rendered or
trained goes to the device of the run and comes back; which one that is, :func:`current_device` tells, as
``parallel.thread_count`` tells of threads.
"""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

from unveil_core.base.errors import SettingsError

__all__ = [
    "CPU",
    "DEVICES",
    "GPU",
    "Device",
    "DeviceInUse",
    "check_device",
    "chosen_device",
    "current_device",
    "gpu_problem",
    "name_of_device",
    "note_of_device",
    "working_on",
]

DEVICES = ("auto", "cpu", "cuda")
LEAST_CAPABILITY = (8, 0)
"""Compute capability of the oldest NVIDIA GPUs that Triton supports: those of 2020, as the RTX 3000 series."""


@dataclass(frozen=True)
class Device:
    """Where to render and to train.

    Attributes:
        name: as torch has it.
        backend: of the rasterizer there, see ``raster.render``; "auto" = that of the device.
        asked_for: whether the user wants this one and no other; if not, the processor takes what does not fit.
    """

    name: str
    backend: str = "auto"
    asked_for: bool = False


CPU, GPU = Device("cpu"), Device("cuda:0")
"""The processor; the first GPU that torch sees (of several, CUDA_VISIBLE_DEVICES chooses)."""


@dataclass
class DeviceInUse:
    """What a block of :func:`working_on` works on.

    Attributes:
        setting: as for :func:`chosen_device`; device: what it came to, None = nobody has asked yet.
        notes: why a part of the work went to the processor all the same, a line each.
    """

    setting: str = "cpu"
    device: Device | None = None
    notes: list[str] = field(default_factory=list)


_in_use: ContextVar[DeviceInUse | None] = ContextVar("in_use", default=None)


def current_device() -> Device:
    """The device of this run: the processor, unless :func:`working_on` says otherwise."""
    used = _in_use.get()
    if used is None:
        return CPU
    if used.device is None:
        used.device = chosen_device(used.setting)
    return used.device


def note_of_device(line: str) -> None:
    """Keep a line for :attr:`DeviceInUse.notes`, once; outside of its block nobody reads it."""
    used = _in_use.get()
    if used is not None and line not in used.notes:
        used.notes.append(line)


@contextmanager
def working_on(device: Device | str) -> Iterator[DeviceInUse]:
    """Render and train on a device within the block, in all threads that it starts (``parallel.in_context``), and in no others.

    Args:
        device: or a setting, see :func:`chosen_device`, which is looked into when something is rendered first: that takes torch,
            which takes a second to import, and not every stage needs it.
    """
    used = DeviceInUse(device) if isinstance(device, str) else DeviceInUse(device.name, device)
    before = _in_use.set(used)
    try:
        yield used
    finally:
        _in_use.reset(before)


def gpu_problem() -> tuple[str, str] | None:
    """What is missing to work on an NVIDIA GPU, and the mend; None = nothing."""
    import torch

    if torch.version.cuda is None:
        return "this torch is a build without CUDA", "install PyTorch's build with CUDA"
    if not torch.cuda.is_available():
        return "torch sees no NVIDIA GPU", "see whether nvidia-smi lists one, and update its driver"
    try:
        capability = torch.cuda.get_device_capability(0)
    except RuntimeError as error:  # another program has it for itself, or all of its memory
        return f"the GPU cannot be used: {_first_line(error)}", "end other programs that use it"
    if capability < LEAST_CAPABILITY:
        known = f"{torch.cuda.get_device_name(0)} has compute capability {capability[0]}.{capability[1]}"
        return known, f"use a GPU of {LEAST_CAPABILITY[0]}.{LEAST_CAPABILITY[1]} or later"
    if importlib.util.find_spec("triton") is None:
        return "the package triton is missing", "pip install triton, on Windows triton-windows"
    return _problem_of_trial()


@cache
def _problem_of_trial() -> tuple[str, str] | None:
    """What keeps a kernel from being built and run on the GPU, and the mend; asked once, for it takes a second."""
    try:
        from unveil_core.base.kernels.gpu_trial import run_trial

        run_trial(GPU.name)
    except Exception as error:  # compilers, drivers and Triton raise all kinds
        mend = "it takes a C compiler, Python's headers, triton 3.3 or later, and a PyTorch as new as the GPU"
        return f"a trial on the GPU failed: {_first_line(error)}", mend
    return None


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]


def name_of_device(setting: str) -> str:
    """The name of the device that a setting means; torch is not loaded, which takes a second, where the system has no GPU."""
    has_driver = shutil.which("nvidia-smi") is not None or Path("/dev/nvidiactl").exists()
    return chosen_device(setting).name if setting != "cpu" and has_driver else CPU.name


def chosen_device(setting: str) -> Device:
    """The device that ``RunSettings.device`` means on this machine.

    Args:
        setting: "cpu"; "cuda"; or "auto", the GPU where there is one that can be used, else the processor.
    Raises:
        SettingsError: "cuda" where no GPU can be used.
    """
    if setting == "cpu":
        return CPU
    problem = gpu_problem()
    if problem is None:
        return replace(GPU, asked_for=setting == "cuda")
    if setting == "cuda":
        raise SettingsError(f"no GPU can be used: {problem[0]}", mend=f"{problem[1]}, or use --device cpu")
    return CPU


def check_device(setting: str) -> None:
    """Raise the SettingsError of :func:`chosen_device` before anything begins; of other settings than "cuda" nothing is asked."""
    if setting == "cuda":
        chosen_device(setting)
