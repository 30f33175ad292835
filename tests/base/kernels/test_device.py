"""Which device a run takes, and what is said where there is none."""

from __future__ import annotations

import threading
from dataclasses import replace

import pytest
import torch

from unveil_core.base.errors import SettingsError
from unveil_core.base.kernels import device
from unveil_core.base.kernels.device import (
    CPU,
    GPU,
    Device,
    check_device,
    chosen_device,
    current_device,
    gpu_problem,
    working_on,
)
from unveil_core.base.parallel import each, threads


def test_the_processor_unless_it_is_said_otherwise_and_then_in_all_threads_of_the_block() -> None:
    assert current_device() == CPU
    found: list[Device] = []
    with working_on(Device("meta")) as used, threads(2):
        host = threading.Thread(target=lambda: found.append(current_device()))
        host.start()
        host.join()
        assert found == [CPU], "a thread of somebody else"
        assert set(each(lambda _: current_device(), range(4))) == {Device("meta")} == {used.device}
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


def test_a_card_on_which_a_kernel_runs_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """The trial runs in Triton's interpreter, where no card is."""
    card(monkeypatch)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: object())
    monkeypatch.setattr(device, "GPU", GPU if torch.cuda.device_count() else Device("cpu", "triton"))
    device._problem_of_trial.cache_clear()
    assert gpu_problem() is None
    assert chosen_device("auto") == device.GPU == replace(chosen_device("cuda"), asked_for=False)
    assert chosen_device("cuda").asked_for
    assert chosen_device("cpu") == CPU
    device._problem_of_trial.cache_clear()


def test_one_on_which_none_runs_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where Triton finds no compiler; or the card is another program's alone."""
    card(monkeypatch)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: object())
    monkeypatch.setattr(device, "GPU", Device("cuda:99"))
    device._problem_of_trial.cache_clear()
    problem = gpu_problem()
    assert problem is not None and problem[0].startswith("a trial on the GPU failed: ") and "\n" not in problem[0]
    assert chosen_device("auto") == CPU
    device._problem_of_trial.cache_clear()

    def busy(number: int) -> tuple[int, int]:
        raise RuntimeError("CUDA error: all CUDA-capable devices are busy or unavailable\nmore")

    monkeypatch.setattr(torch.cuda, "get_device_capability", busy)
    with pytest.raises(SettingsError, match=r"the GPU cannot be used: CUDA error: .* unavailable \(end other programs"):
        chosen_device("cuda")
    assert chosen_device("auto") == CPU
