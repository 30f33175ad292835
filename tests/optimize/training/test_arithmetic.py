"""Torch's own threads while steps are taken: none, in any run of the process, and as before when all have ended."""

from __future__ import annotations

import threading

import torch

from unveil_core.optimize.training.arithmetic import torch_in_one_thread


def torch_threads_of_a_new_thread() -> int:
    found: list[int] = []
    thread = threading.Thread(target=lambda: found.append(torch.get_num_threads()))
    thread.start()
    thread.join()
    return found[0]


def test_two_that_train_in_turn_leave_torch_as_it_was() -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    first_in, second_in, first_out = threading.Event(), threading.Event(), threading.Event()
    seen: dict[str, int] = {}

    def first() -> None:
        with torch_in_one_thread():
            first_in.set()
            second_in.wait(0.5)  # in vain where one waits for the other
            seen["first"] = torch.get_num_threads()
        first_out.set()
        seen["after the first"] = torch.get_num_threads()

    def second() -> None:
        first_in.wait()
        with torch_in_one_thread(), torch_in_one_thread():
            second_in.set()
            first_out.wait()
            seen["second"] = torch.get_num_threads()
        seen["after the second"] = torch.get_num_threads()

    try:
        threads = [threading.Thread(target=work) for work in (first, second)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert seen == {"first": 1, "second": 1, "after the first": 3, "after the second": 3}
        assert torch.get_num_threads() == torch_threads_of_a_new_thread() == 3
    finally:
        torch.set_num_threads(before)
