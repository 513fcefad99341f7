"""The identity of this build of the engine, on which results and compiled kernels depend."""

import hashlib
import platform
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path


@lru_cache(maxsize=1)
def build_id() -> str:
    """Return the hash of all engine sources and of the numerical libraries below them.

    Two machines with the same id compute the same row; the compiled-kernel cache is keyed by it, because
    Numba looks only at the file of the decorated function and would reuse a stale callee.

    Returns
    -------
    str
        16 hexadecimal digits.
    """
    root = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    for name in ("numpy", "numba", "llvmlite"):
        digest.update(f"{name} {version(name)}\n".encode())
    digest.update(platform.python_version().encode())
    return digest.hexdigest()[:16]
