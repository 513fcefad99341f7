"""The decorators of all compiled kernels, and the folder where compiled code is kept.

Options: without the GIL (a worker's heartbeat must continue), cached on disk, NumPy's error model (a division by zero
gives an inf, which the caller judges, and no exception), no fast-math (a row must be the same bits everywhere).
"""

import os
import tempfile
from pathlib import Path
from typing import Any

import numba

from engine.build import build_id


def _cache_folder() -> str:
    """Return a private folder for this build's compiled code; fall back to a temporary one."""
    base = os.environ.get("NUMBA_CACHE_DIR") or os.path.join(
        os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "clearcap", "numba"
    )
    folder = Path(base) / build_id()
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:
        return tempfile.mkdtemp(prefix="clearcap-numba-")
    return str(folder)


numba.config.CACHE_DIR = _cache_folder()  # type: ignore[attr-defined]

if "NUMBA_OPT" not in os.environ:  # a run is no slower than with level 3, and compiling takes a tenth less
    numba.config.OPT = type(numba.config.OPT)(1)  # type: ignore[attr-defined]

_OPTIONS = {"nogil": True, "cache": True, "error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}

kernel: Any = numba.njit(**_OPTIONS)  # type: ignore[call-overload]

# For kernels that only kernels call: a wrapper for Python would be a third of their compile time.
inner: Any = numba.njit(**_OPTIONS, no_cpython_wrapper=True)  # type: ignore[call-overload]

# For the copies of kernels that are measured: their clocks have addresses, which cannot be kept on disk.
uncached: Any = numba.njit(**{**_OPTIONS, "cache": False})  # type: ignore[call-overload]
