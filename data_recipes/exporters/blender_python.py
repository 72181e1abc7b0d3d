"""The Python that runs scripts for Blender: one with the `bpy` package, or Blender itself; and Alembic through it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from replicate.base.exceptions import InputError
from replicate.base.paths import ROOT

VARIABLE = "REPLICATE_BLENDER_PYTHON"
ENVIRONMENT = ROOT / ".bpy"  # for bpy, beside .venv, since bpy and the suite need different versions of numpy
ADVICE = (
    f"make one by `python3.11 -m venv {ENVIRONMENT.name} && {ENVIRONMENT.name}/bin/pip install bpy==4.5.15`, or name a "
    f"Python that has bpy, or Blender itself, in {VARIABLE}"
)


def blender_python() -> Path:
    """Return the Python with bpy, or the Blender, that runs scripts for Blender.

    It is what REPLICATE_BLENDER_PYTHON names, else the project's environment `.bpy`, else this Python if it has bpy,
    else `blender` on the path. Raises InputError where there is none.
    """
    named = os.environ.get(VARIABLE, "")
    if named:
        found = shutil.which(named)
        if found is None:
            raise InputError(f"{VARIABLE}: expected a Python with bpy, or Blender, got '{named}', which is no program")
        return Path(found)
    if (python := ENVIRONMENT / "bin" / "python").exists():
        return python
    if find_spec("bpy") is not None:
        return Path(sys.executable)
    blender = shutil.which("blender")
    if blender is None:
        raise InputError(f"there is neither a Python with bpy nor Blender: {ADVICE}")
    return Path(blender)


def script_command(python: Path, script: Path, arguments: Sequence[str]) -> list[str]:
    """Return the command that runs a script in a Python with bpy or in Blender."""
    if python.name.lower().startswith("blender"):
        return [str(python), "--background", "--factory-startup", "--python", str(script), "--", *arguments]
    return [str(python), str(script), *arguments]


def run_scripts(python: Path, script: Path, calls: Sequence[Sequence[str]], quiet: bool = False) -> None:
    """Run a script for Blender once for each list of arguments, all at the same time, and wait for all of them.

    quiet: drop its standard output. Raises InputError if a script ends with an error, which it has printed by then.
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


# Alembic has no library that Python could install; Blender reads and writes it, and USD too. What it is told:
CONVERT = """
import sys
import bpy

source, target, rate = sys.argv[-3], sys.argv[-2], float(sys.argv[-1])
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps, scene.render.fps_base = round(rate), round(rate) / rate  # Alembic counts seconds
if source.endswith(".abc"):
    bpy.ops.wm.alembic_import(filepath=source, as_background_job=False, set_frame_range=True)
    bpy.ops.wm.usd_export(filepath=target, export_animation=True, export_materials=False, convert_orientation=True)
else:
    bpy.ops.wm.usd_import(filepath=source)
    span = {"start": scene.frame_start, "end": scene.frame_end}
    bpy.ops.wm.alembic_export(filepath=target, as_background_job=False, face_sets=True, normals=False, **span)
"""


def through_blender(data: bytes, source: str, target: str, frames_per_second: float) -> bytes:
    """Return a file's content in another format, Alembic (.abc) as USD (.usdc) or the other way; numbers stay.

    source, target: the endings. Raises InputError where Blender is missing, and for a file that it can't read.
    """
    python = blender_python()
    with tempfile.TemporaryDirectory() as folder:
        script, old, new = (Path(folder) / name for name in ("convert.py", f"old{source}", f"new{target}"))
        script.write_text(CONVERT, "utf-8")
        old.write_bytes(data)
        try:
            run_scripts(python, script, [[str(old), str(new), repr(float(frames_per_second))]], quiet=True)
        except InputError:
            raise InputError(f"Blender can't make {target} of {source}, for the reason above") from None
        if not new.is_file():
            raise InputError(f"Blender made no {target} of {source}: the file is damaged or has no mesh")
        return new.read_bytes()
