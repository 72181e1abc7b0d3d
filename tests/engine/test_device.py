"""The device is chosen without torch, and a wish that can't be granted is one sentence."""

import pytest

from replicate.base.exceptions import InputError
from replicate.engine import device
from replicate.engine.device import choose_device


def test_auto_takes_the_gpu_that_there_is(monkeypatch):
    monkeypatch.setattr(device, "_obstacle", lambda: "")
    assert [choose_device(setting) for setting in ("auto", "cuda", "cpu")] == ["cuda", "cuda", "cpu"]


def test_without_a_gpu_auto_is_the_cpu_and_cuda_is_refused_with_the_reason(monkeypatch):
    monkeypatch.setattr(device, "_obstacle", lambda: "this build of torch has no CUDA")
    assert choose_device("auto") == "cpu"
    with pytest.raises(InputError, match=r"cuda can't be used: this build of torch has no CUDA; choose auto or cpu"):
        choose_device("cuda")


def test_the_finding_agrees_with_torch():
    torch = pytest.importorskip("torch")
    assert (choose_device("auto") == "cuda") == torch.cuda.is_available()


def test_an_unknown_device_lists_those_there_are():
    with pytest.raises(InputError, match="'tpu' is unknown: expected auto, cpu or cuda"):
        choose_device("tpu")
