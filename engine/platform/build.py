"""The identity of this build of the engine: results and compiled kernels depend on it."""

import hashlib
import platform
from collections.abc import Iterable
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

LIBRARIES = ("numpy", "numba", "llvmlite")  # the kernels are built on these


def hash_sources(root: Path, parts: Iterable[str] = (".",)) -> str:
    """Return the hash of the Python sources in a folder, or in some files and folders in it: 16 hexadecimal digits."""
    digest = hashlib.sha256()
    files = {
        path for part in parts for path in ([root / part] if part.endswith(".py") else (root / part).rglob("*.py"))
    }
    for path in sorted(files):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


@lru_cache(maxsize=1)
def engine_sources() -> str:
    """Return the hash of all engine sources, 16 hexadecimal digits."""
    return hash_sources(Path(__file__).parents[1])


@lru_cache(maxsize=1)
def build_id() -> str:
    """Return the hash of all engine sources and of the libraries that the kernels are built on.

    It is the key of the cache of compiled kernels: Numba itself checks only the file of the decorated function, and
    would reuse a stale callee.

    Returns
    -------
    str
        16 hexadecimal digits.
    """
    libraries = "".join(f"{name} {version(name)}\n" for name in LIBRARIES)
    content = f"{engine_sources()}\n{libraries}python {platform.python_version()}\n"
    return hashlib.sha256(content.encode()).hexdigest()[:16]
