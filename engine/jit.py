"""The decorators of all compiled kernels, and the folder where compiled code is kept.

Options: without the GIL (a worker's heartbeat must continue), cached on disk, NumPy's error model (a division by zero
gives an inf, which the caller judges, and no exception), no fast-math (a row must be the same bits everywhere).
"""

import atexit
import hashlib
import logging
import os
import shutil
import tempfile
from contextlib import chdir, nullcontext, suppress
from pathlib import Path
from typing import Any

from llvmlite import binding

from engine.build import build_id
from engine.errors import FolderError
from engine.private_folder import private_folder

# The temporary folder of a process, for the processes it starts: they need not compile again.
_INHERITED = "CLEARCAP_TEMPORARY_CACHE"

_log = logging.getLogger(__name__)

# Numba takes settings from this file of the current folder, which anybody may have put there, even that which
# instructions the processor has. It is imported elsewhere, and never looks for the file again.
SETTINGS = ".numba_config.yaml"

with chdir("/") if os.path.lexists(SETTINGS) else nullcontext():
    import numba
    from numba.core import config

config._config_fname = os.devnull
if os.path.lexists(SETTINGS):  # a program that imported Numba before has read it
    config._env_reloader.reset()


def _cache_folder() -> Path:
    """Return a folder for this build's compiled code that nobody else can have filled: Numba runs what is in it.

    Raises
    ------
    FolderError
        If the folder that ``NUMBA_CACHE_DIR`` names is not so, or if no folder is.
    """
    inherited, named = os.environ.get(_INHERITED), os.environ.get("NUMBA_CACHE_DIR")
    if inherited and not named:
        with suppress(FolderError, OSError):
            return private_folder(Path(inherited), _folder_name())
    try:
        if named:
            return _writable(private_folder(Path(named), _folder_name()))
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
        return _writable(private_folder(cache, "clearcap", "numba", _folder_name()))
    except (FolderError, OSError, RuntimeError) as error:  # RuntimeError: this user has no home
        if named:
            raise FolderError(
                f"NUMBA_CACHE_DIR={named}: clearcap does not run compiled code from this folder: {error}."
                " Name a folder in which only you can write, or none"
            ) from None
        return _temporary_folder(error)


def _folder_name() -> str:
    """Return the name of the folder for this build on this kind of processor.

    Machines of two kinds that share a folder and compile at the same time could otherwise run each other's code.
    """
    name = numba.config.CPU_NAME or binding.get_host_cpu_name()  # type: ignore[attr-defined]
    features = numba.config.CPU_FEATURES  # type: ignore[attr-defined]
    features = binding.get_host_cpu_features().flatten() if features is None else features
    return f"{build_id()}-{hashlib.sha256(f'{name} {features}'.encode()).hexdigest()[:8]}"


def _writable(folder: Path) -> Path:
    """Return a folder, if files can be written there."""
    with tempfile.TemporaryFile(dir=folder):
        return folder


def _temporary_folder(reason: Exception) -> Path:
    """Return a folder that is removed when this process ends, and say why."""
    parent = tempfile.mkdtemp(prefix="clearcap-")
    atexit.register(_remove, parent, os.getpid())
    folder = private_folder(Path(parent), _folder_name())
    os.environ[_INHERITED] = parent
    _log.warning(
        "compiled code is not kept, because %s; compiling takes about a minute at each start. Mend owner or mode, or"
        " name another folder with NUMBA_CACHE_DIR",
        reason,
    )
    return folder


def _remove(folder: str, process: int) -> None:
    """Remove a temporary folder; a forked copy of its process leaves it."""
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)


numba.config.CACHE_DIR = str(_cache_folder())  # type: ignore[attr-defined]
# and no other folder, such as ~/.cache/numba, which nobody has checked
numba.config.CACHE_LOCATOR_CLASSES = "UserProvidedCacheLocator"  # type: ignore[attr-defined]

if "NUMBA_OPT" not in os.environ:  # a run is no slower than with level 3, and compiling takes a tenth less
    numba.config.OPT = type(numba.config.OPT)(1)  # type: ignore[attr-defined]

_OPTIONS = {"nogil": True, "cache": True, "error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}

kernel: Any = numba.njit(**_OPTIONS)  # type: ignore[call-overload]

# For kernels that only kernels call: a wrapper for Python would be a third of their compile time.
inner: Any = numba.njit(**_OPTIONS, no_cpython_wrapper=True)  # type: ignore[call-overload]

# For the copies of kernels that are measured: their clocks have addresses, which cannot be kept on disk.
uncached: Any = numba.njit(**{**_OPTIONS, "cache": False})  # type: ignore[call-overload]
