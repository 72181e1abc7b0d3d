"""Machine code that is kept between processes, for whoever asks for it: compiling takes most of a short stage.

Numba keeps the kernels' code in `$NUMBA_CACHE_DIR` and JAX the rigs' in `$JAX_COMPILATION_CACHE_DIR`, where these are
set. Without them nothing is kept. Numba makes a kernel's code anew when its own file has changed, not when a module has
that it calls or takes numbers from; so here every state of the kernels' sources gets a folder of its own within
`$NUMBA_CACHE_DIR`. JAX needs none: it knows code by the program that it was compiled from, in full.
"""

import os
import re
import sys
from pathlib import Path

from replicate.base.code_hash import code_digest
from replicate.base.paths import ROOT

_VARIABLE = "NUMBA_CACHE_DIR"


def kernels() -> list[str]:
    """Return the modules of the project that compile functions with Numba."""
    files = sorted(file for folder in ("replicate", "data_recipes") for file in (ROOT / folder).rglob("*.py"))
    compiling = (file for file in files if re.search(rb"^(from|import) numba\b", file.read_bytes(), re.MULTILINE))
    return [".".join(file.relative_to(ROOT).with_suffix("").parts) for file in compiling]


def folder_of(root: str, sources: str) -> str:
    """Return the folder for kernels of some sources, a hash, within the user's folder.

    root: the user's folder, or already such a folder for kernels, which a process inherits from one of ours.
    """
    folder = Path(root).absolute()
    if re.fullmatch(r"kernels-[0-9a-f]{16}", folder.name):
        folder = folder.parent
    return str(folder / f"kernels-{sources[:16]}")


def _keep() -> bool:
    """Name the folder to Numba, loaded by now or not; return whether code is kept at all."""
    root = os.environ.get(_VARIABLE)
    if not root:
        return False
    own = folder_of(root, code_digest("\n".join(f"import {module}" for module in kernels())))
    os.environ[_VARIABLE] = own
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = own
    return True


KEEP_CODE = _keep()
