"""Which Python runs scripts for Blender: one that has the `bpy` package, or Blender itself."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from replicate.base.exceptions import InputError
from replicate.base.paths import ROOT

VARIABLE = "REPLICATE_BLENDER_PYTHON"
OWN = ROOT / ".bpy"  # an environment for bpy, beside .venv: bpy and the suite need other versions of numpy
ADVICE = (
    f"make one by `python3.11 -m venv {OWN.name} && {OWN.name}/bin/pip install bpy==4.5.15`, or name a Python that has "
    f"bpy, or Blender itself, in {VARIABLE}"
)


def blender_python() -> Path:
    """Return the Python with bpy, or the Blender, that scripts for Blender run in.

    The variable REPLICATE_BLENDER_PYTHON names it; else it is the environment `.bpy` of the project, this Python if it
    has bpy, or `blender` on the path. Raises InputError where there is none.
    """
    named = os.environ.get(VARIABLE, "")
    if named:
        found = shutil.which(named)
        if found is None:
            raise InputError(f"{VARIABLE} is '{named}', which is no program: allowed is a Python with bpy, or Blender")
        return Path(found)
    if (own := OWN / "bin" / "python").exists():
        return own
    if find_spec("bpy") is not None:
        return Path(sys.executable)
    blender = shutil.which("blender")
    if blender is None:
        raise InputError(f"no Python with bpy is there, nor Blender: {ADVICE}")
    return Path(blender)


def script_command(python: Path, script: Path, arguments: Sequence[str]) -> list[str]:
    """Return the command that runs a script for Blender, whatever `blender_python` has found."""
    if python.name.lower().startswith("blender"):
        return [str(python), "--background", "--factory-startup", "--python", str(script), "--", *arguments]
    return [str(python), str(script), *arguments]


def run_scripts(python: Path, script: Path, calls: Sequence[Sequence[str]], quiet: bool = False) -> None:
    """Run a script for Blender, once for each list of arguments, all at the same time, until all have ended.

    quiet: what it prints on standard output is thrown away. Raises InputError if a script ends with an error, which it
    has printed by then.
    """
    output = subprocess.DEVNULL if quiet else None
    running = [subprocess.Popen(script_command(python, script, call), stdout=output) for call in calls]
    try:
        codes = [process.wait() for process in running]
    finally:
        for process in running:
            if process.poll() is None:
                process.terminate()
                process.wait()
    if any(codes):
        raise InputError(f"{script.name} ended with code {next(filter(None, codes))}, for the reason above")
