"""Which device a run takes, and what is said where there is none."""

from __future__ import annotations

import threading

import pytest
import torch

from unveil_core.base.errors import SettingsError
from unveil_core.base.kernels.device import (
    CPU,
    Device,
    check_device,
    chosen_device,
    current_device,
    gpu_problem,
    working_on,
)


def test_the_processor_unless_it_is_said_otherwise_and_then_in_all_threads() -> None:
    assert current_device() == CPU
    found = []
    with working_on(Device("meta")) as used:
        thread = threading.Thread(target=lambda: found.append(current_device()))
        thread.start()
        thread.join()
        assert found == [Device("meta")] == [used.device]
        with working_on("cpu"):
            assert current_device() == CPU
        assert current_device() == Device("meta")
    assert current_device() == CPU


def test_a_setting_is_looked_into_when_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr("unveil_core.base.kernels.device.chosen_device", lambda setting: asked.append(setting) or CPU)
    with working_on("auto") as used:
        assert not asked and used.device is None
        assert current_device() == current_device() == CPU == used.device
    assert asked == ["auto"]


def card(monkeypatch: pytest.MonkeyPatch, *, cuda: str | None = "13.0", sees: bool = True, capability: int = 9) -> None:
    """A torch that knows such a card."""
    monkeypatch.setattr(torch.version, "cuda", cuda)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: sees)
    monkeypatch.setattr(torch.cuda, "get_device_capability", lambda device: (capability, 0))
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda device: "A Card")


@pytest.mark.parametrize(
    ("facts", "triton", "line"),
    [
        (
            {"cuda": None},
            True,
            "this torch is a build without CUDA (install PyTorch's build with CUDA, or use --device cpu)",
        ),
        (
            {"sees": False},
            True,
            "torch sees no NVIDIA GPU (see whether nvidia-smi lists one, and update its driver, or",
        ),
        ({"capability": 6}, True, "A Card has compute capability 6.0 (use a GPU of 8.0 or later, or use --device cpu)"),
        (
            {},
            False,
            "the package triton is missing (pip install triton, on Windows triton-windows, or use --device cpu)",
        ),
    ],
)
def test_what_is_missing_is_one_line(
    facts: dict[str, object], triton: bool, line: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    card(monkeypatch, **facts)  # type: ignore[arg-type]
    monkeypatch.setattr("importlib.util.find_spec", lambda name: object() if triton else None)
    with pytest.raises(SettingsError) as refused:
        check_device("cuda")
    assert f"no GPU can be used: {line}" in str(refused.value) and "\n" not in str(refused.value)
    check_device("auto")
    assert chosen_device("auto") == CPU == chosen_device("cpu")


def test_a_card_that_can_be_used_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    card(monkeypatch)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: object())
    assert gpu_problem() is None
    assert chosen_device("auto").name == chosen_device("cuda").name == "cuda:0"
    assert chosen_device("cuda").asked_for and not chosen_device("auto").asked_for
    assert chosen_device("cpu") == CPU
