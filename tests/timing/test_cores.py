"""How many cores and threads a measurement may use."""

import os
import threading
from pathlib import Path

import pytest
import torch

from replicate.timing.machine import can_confine, one_core, threads


@pytest.mark.skipif(not can_confine(), reason="this system can't keep a process on one core")
def test_all_threads_of_the_process_stay_on_one_core_and_are_free_afterwards():
    go, seen = threading.Event(), []

    def other():
        go.wait()
        seen.append(os.sched_getaffinity(0))

    thread = threading.Thread(target=other)
    thread.start()
    before = os.sched_getaffinity(0)
    with one_core():
        here = os.sched_getaffinity(0)
        go.set()
        thread.join()
        assert torch.get_num_threads() == 1
    assert len(here) == 1 and seen == [here] and os.sched_getaffinity(0) == before
    assert all(os.sched_getaffinity(int(task.name)) == before for task in Path("/proc/self/task").iterdir())


def test_threads_are_as_many_as_asked_for_and_as_many_as_before_afterwards():
    before = torch.get_num_threads()
    with threads(3):
        assert torch.get_num_threads() == 3
    assert torch.get_num_threads() == before
