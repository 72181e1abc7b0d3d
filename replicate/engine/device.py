"""Which device the networks run on, decided without loading torch."""

import ctypes
import importlib.util
import os
import re
from pathlib import Path

from replicate.base.exceptions import InputError


def choose_device(choice: str = "auto", elsewhere: bool = False) -> str:
    """Return "cuda" or "cpu": the choice itself, or for "auto" CUDA if this machine has it.

    elsewhere: whether other machines do the work; then "cuda" is not checked and "auto" means the CPU.

    Raises InputError for another name, and for "cuda" on a machine without it.
    """
    if choice not in ("auto", "cpu", "cuda"):
        raise InputError(f"device {choice!r} is unknown: expected auto, cpu or cuda")
    if elsewhere:
        return "cuda" if choice == "cuda" else "cpu"
    if choice == "cpu":
        return "cpu"
    obstacle = _obstacle()
    if obstacle and choice == "cuda":
        raise InputError(f"device cuda can't be used: {obstacle}; choose auto or cpu")
    return "cpu" if obstacle else "cuda"


def _obstacle() -> str:
    """Return why torch can't use a GPU here, "" if it can."""
    package = importlib.util.find_spec("torch")
    if package is None or package.origin is None:
        return "torch isn't installed"
    version = Path(package.origin).with_name("version.py").read_text(encoding="utf-8")
    if not re.search(r"^cuda\b.*=\s*['\"]", version, re.MULTILINE):
        return "this build of torch has no CUDA"
    count = _gpu_count()
    if count is None:
        return "no NVIDIA driver is installed"
    return "" if count else "the NVIDIA driver finds no GPU"


def visible_gpus() -> list[str]:
    """Return the GPUs that this process may use, each as CUDA_VISIBLE_DEVICES names it."""
    names = [name.strip() for name in os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",") if name.strip()]
    count = _gpu_count() or 0
    return names[:count] if names else [str(place) for place in range(count)]


def _gpu_count() -> int | None:
    """Return how many GPUs the NVIDIA driver finds; None where there is no driver."""
    try:
        driver = ctypes.CDLL("libcuda.so.1")
    except OSError:
        return None
    count = ctypes.c_int(0)
    if driver.cuInit(0) != 0 or driver.cuDeviceGetCount(ctypes.byref(count)) != 0:
        return 0
    return count.value
