"""Machine code that is kept between processes, for whoever asks for it: compiling takes most of a short stage.

Numba keeps the kernels' code in `$NUMBA_CACHE_DIR` and JAX the rigs' in `$JAX_COMPILATION_CACHE_DIR`, where these are
set. Without them nothing is kept: a kernel's kept code is not made anew when a module that it calls has changed.
"""

import os

KEPT = bool(os.environ.get("NUMBA_CACHE_DIR"))
