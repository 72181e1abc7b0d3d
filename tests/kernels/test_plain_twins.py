"""What is written for LLVM can be left out: everything that uses it passes its tests with the plain twins, too."""

import os
import re
import subprocess
import sys
from pathlib import Path

from replicate.base.jit_cache import PLAIN_KERNELS

TESTS = Path(__file__).parent.parent
USERS = ("inference", "kernels/test_gradient_kernel.py", "kernels/test_pixel_kernel.py", "approximation/test_cnn.py")
WRITTEN = re.compile(r"^@twin_of\((\w+)\)\ndef (\w+)\(", re.MULTILINE)


def test_each_kernel_that_is_written_for_llvm_has_its_twin_named_alike():
    pairs = [pair for file in (TESTS.parent / "replicate").rglob("*.py") for pair in WRITTEN.findall(file.read_text())]
    assert len(pairs) >= 8
    assert all(plain == f"{kernel.lstrip('_')}_plain" for plain, kernel in pairs)


def test_networks_and_fast_evaluations_pass_their_tests_without_what_is_written_for_llvm():
    trains = "neutral_pose or without_influence or saved_model"  # for a minute
    command = [sys.executable, "-m", "pytest", "-q", "-n0", "-p", "no:cacheprovider", "-k", f"not ({trains})"]
    command += [str(TESTS / name) for name in USERS]
    process = subprocess.run(command, env=os.environ | {PLAIN_KERNELS: "1"}, capture_output=True, text=True)
    assert process.returncode == 0, process.stdout
    assert int(re.search(r"(\d+) passed", process.stdout)[1]) > 90
