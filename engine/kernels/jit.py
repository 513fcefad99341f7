"""The one decorator of every compiled kernel, and the place where compiled code is kept.

Options: no GIL (a worker's heartbeat must go on), cached on disk, NumPy's error model (a division by zero is an
inf to be found by the caller, not an exception), no fast-math (a row must be the same bits everywhere), no counting of
references (`_nrt`: kernels allocate nothing, and without it passing a tuple of arrays costs nothing).
"""

import os
import tempfile
from pathlib import Path

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

kernel = numba.njit(nogil=True, cache=True, error_model="numpy", _nrt=False)  # type: ignore[call-overload]
