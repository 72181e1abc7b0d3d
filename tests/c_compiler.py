"""A C compiler, where there is one: sources become libraries and programs, every warning an error."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

FLAGS = (
    "-std=c99",
    "-O3",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wno-overlength-strings",  # lists of numbers in place of strings take compilers far longer
    "-Wconversion",
    "-Wshadow",
    "-Wdouble-promotion",
    "-Werror",
)


def compiled(source, target, *more):
    """Compile a file with FLAGS and more of them; return the target. Skip the test where there is no cc."""
    if shutil.which("cc") is None:
        pytest.skip("needs cc")
    done = subprocess.run(["cc", *FLAGS, *more, "-o", target, source, "-lm"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return target


def library(source, folder):
    """Return a source as a library that ctypes has loaded."""
    return ctypes.CDLL(str(compiled(source, folder / f"{source.stem}.so", "-shared", "-fPIC")))


def posed_by(function, params, vertices):
    """Return the vertices (b, n, 3) that a C function of (parameters, vertices) gives for poses (b, m)."""
    pointer = ctypes.POINTER(ctypes.c_float)
    out = np.full((len(params), vertices, 3), np.nan, np.float32)
    for pose, place in zip(np.ascontiguousarray(params, np.float32), out, strict=True):
        function(pose.ctypes.data_as(pointer), place.ctypes.data_as(pointer))
    return out
