"""Machine code of Numba's kernels, kept in the cache for the next process: compiling takes most of a short one.

    <cache>/kernels-<hash>/<kernel>-<hash>.code

The folder is named by what all kernels are made of: their sources, with those of every module that these import, and
the versions of Python, Numba and LLVM. A file is named by the types that its code is for, the processor and Numba's
settings. There is one for each signature, sealed with a checksum and renamed into place when it is whole, so that
processes may read and write at once: Numba's own cache has an index beside the code, and of two that write to it one
can be told the other's code. What is missing, damaged or can't be written is compiled, and all goes on.

`$NUMBA_CACHE_DIR` names another folder than the cache for `kernels-…` to stand in. JAX keeps the rigs' code in
`$JAX_COMPILATION_CACHE_DIR` where that is set; it knows code by the program that it was compiled from, in full.
"""

import functools
import hashlib
import os
import re
import sys
from collections.abc import Mapping
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from replicate.base import LOADED
from replicate.base.exceptions import InputError
from replicate.base.files import read_sealed, write_sealed
from replicate.base.paths import ROOT, cache_folder, named_folder

FOLDER_NAME = r"kernels-[0-9a-f]{16}"
FILE_NAME = r"[\w.]+-[0-9a-f]{16}\.code"
_ROOT_VARIABLE = "NUMBA_CACHE_DIR"
PLAIN_KERNELS = "REPLICATE_PLAIN_KERNELS"  # set: the plain twins run in place of what is written for LLVM
_HARMLESS = (_ROOT_VARIABLE, "NUMBA_NUM_THREADS")  # of Numba's settings: those that don't change any code
_KEEPING = b"\nfrom replicate.base.jit_cache import kept\n"  # in every module with such a kernel
_IMPORT = re.compile(r"^(?:from|import) ((?:replicate|data_recipes)[\w.]*)(?: import (\([^)]*\)|.*))?", re.MULTILINE)

Kernel = TypeVar("Kernel")


def kept(kernel: Kernel) -> Kernel:
    """Have what a kernel is compiled to kept for the next process; stands above `numba.njit`.

    kernel: at the top of a module of the project; of one from elsewhere, nothing is kept.
    """
    if hasattr(kernel, "targetctx"):  # not with NUMBA_DISABLE_JIT, which leaves a plain function
        kernel._cache = _KeptCode(kernel.py_func)
    return kernel


def kernel_sources() -> dict[Path, bytes]:
    """Return what the kernels are made of: their modules' files and all that importing these loads, with their texts.

    Only imports at the top of a module count: what a kernel takes from another module stands there.
    """
    files = [
        Path(root, name)
        for top in ("replicate", "data_recipes")
        for root, _, names in os.walk(ROOT / top)
        for name in names
        if name.endswith(".py")
    ]
    modules = {_module(file): file for file in files}
    texts = {module: file.read_bytes() for module, file in modules.items()}
    pending, reached = [module for module, text in texts.items() if _KEEPING in text], set()
    while pending:
        module = pending.pop()
        if module in reached or module not in modules:
            continue
        reached.add(module)
        pending.append(module.rpartition(".")[0])  # the package around it
        for source, names in _IMPORT.findall(texts[module].decode()):
            pending += [source, *(f"{source}.{name}" for name in re.findall(r"\w+", names))]
    return {modules[module]: texts[module] for module in sorted(reached)}


def _module(file: Path) -> str:
    return ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def folder_name(sources: Mapping[Path, bytes]) -> str:
    """Return the name of the folder for kernels of these sources (`kernel_sources`) and the libraries installed."""
    texts = [(file.relative_to(ROOT).as_posix(), text) for file, text in sources.items()]
    return f"kernels-{_hash((sys.implementation.cache_tag, version('numba'), version('llvmlite'), texts))}"


@functools.cache
def _state() -> tuple[Path, tuple[Path, ...]] | None:
    """Return this process's folder and the kernels' files; None where a variable names what can't be a folder."""
    with suppress(InputError, OSError):
        sources = kernel_sources()
        return (named_folder(_ROOT_VARIABLE) or cache_folder()) / folder_name(sources), tuple(sources)
    return None


def _folder(source: Path) -> Path | None:
    """Return the folder for the kernels that this process has loaded from a file; None for none.

    There is none once a source has changed since: what was loaded is no longer what the folder's name says.
    """
    with suppress(OSError):
        folder, files = _state() or (None, ())
        if source in files and all(os.stat(file).st_ctime < LOADED for file in files):
            return folder
    return None


def _hash(what: object) -> str:
    return hashlib.sha256(repr(what).encode()).hexdigest()[:16]


class _KeptCode:
    """What Numba asks for a function's code before it compiles, and gives the code to afterwards."""

    def __init__(self, function: Any):
        self._name = f"{function.__module__}.{function.__qualname__}"
        self._source = Path(os.path.realpath(function.__code__.co_filename))

    @property
    def cache_path(self) -> str | None:
        """The folder, for Numba's statistics."""
        return str(_folder(self._source) or "") or None

    def load_overload(self, signature: tuple, target: Any) -> Any:
        """Return the compiled code for a signature in Numba's types; None for none."""
        from numba.core.compiler import CompileResult
        from numba.core.runtime import rtsys
        from numba.core.serialize import loads

        file = self._file(signature, target.codegen())
        parts = read_sealed(file, lambda stream: loads(stream.read())) if file else None
        if parts is None:
            return None
        rtsys.initialize(target)  # arrays' memory: all that code asks of Numba; its registries are for compiling
        return CompileResult._rebuild(target, *parts)

    def save_overload(self, signature: tuple, code: Any) -> None:
        """Keep the compiled code for a signature, unless it holds addresses of this process."""
        from numba.core.serialize import dumps

        file = self._file(signature, code.codegen)
        if file is None or code.library.has_dynamic_globals:
            return
        data = dumps(code._reduce())
        with suppress(OSError):
            write_sealed(file, lambda stream: stream.write(data))

    def _file(self, signature: tuple, codegen: Any) -> Path | None:
        folder = _folder(self._source)
        if folder is None:
            return None
        settings = sorted(
            (name, value)
            for name, value in os.environ.items()
            if name.startswith(("NUMBA_", PLAIN_KERNELS)) and name not in _HARMLESS
        )
        return folder / f"{self._name}-{_hash((signature, codegen.magic_tuple(), settings))}.code"
