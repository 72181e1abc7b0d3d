"""Which device the networks run on, found out without loading torch."""

import ctypes
import importlib.util
import re
from pathlib import Path

from replicate.engine.exceptions import InputError


def choose_device(wanted: str = "auto") -> str:
    """Return "cuda" or "cpu": as wanted, or for "auto" CUDA where there is one.

    Raises InputError for another name, and for "cuda" where there is none.
    """
    if wanted not in ("auto", "cpu", "cuda"):
        raise InputError(f"device {wanted!r} is unknown: allowed are auto, cpu, cuda")
    if wanted == "cpu":
        return "cpu"
    obstacle = _obstacle()
    if obstacle and wanted == "cuda":
        raise InputError(f"device cuda can't be used: {obstacle}; allowed are auto and cpu")
    return "cpu" if obstacle else "cuda"


def _obstacle() -> str:
    """Return "" if torch can use a GPU here, else why not."""
    package = importlib.util.find_spec("torch")
    if package is None or package.origin is None:
        return "torch isn't installed"
    version = Path(package.origin).with_name("version.py").read_text(encoding="utf-8")
    if not re.search(r"^cuda\b.*=\s*['\"]", version, re.MULTILINE):
        return "this build of torch has no CUDA"
    try:
        driver = ctypes.CDLL("libcuda.so.1")
    except OSError:
        return "no NVIDIA driver is installed"
    count = ctypes.c_int(0)
    if driver.cuInit(0) != 0 or driver.cuDeviceGetCount(ctypes.byref(count)) != 0 or count.value == 0:
        return "the NVIDIA driver finds no GPU"
    return ""
