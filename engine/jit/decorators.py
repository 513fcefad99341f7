"""The decorators of all compiled kernels, and the folder where compiled code is kept.

Options: the GIL is released (a worker's heartbeat must continue), NumPy's error model (a division by zero gives an inf,
which the caller checks, instead of an exception), no fast-math (a row must have the same bits everywhere).

Only kernels that Python calls become machine code, each as one module with all kernels it calls, optimised once and
kept on disk. By default Numba does this for every kernel and again for all of its callees, so that a kernel ten calls
deep is optimised ten times. The cost of compiling a kernel grows with the length of its code, so tuples of arrays are
passed by address, see `engine.jit.numba_internals`.
"""

import atexit
import hashlib
import logging
import os
import shutil
import tempfile
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cached_property, update_wrapper
from pathlib import Path
from typing import Any

from engine.errors import FolderError
from engine.jit.kept_code import keep_on_disk, processor
from engine.jit.numba_internals import INNER_OPTIONS, KERNEL_OPTIONS, NOT_INLINED_OPTIONS
from engine.platform.build import build_id
from engine.platform.private_folder import private_folder, user_cache

import numba  # isort: skip  # after `numba_internals`, which imports it in the required way
from numba.extending import typeof_impl  # isort: skip

# Names the temporary folder of a process to its child processes, which then need not compile again.
_INHERITED = "CLEARCAP_TEMPORARY_CACHE"

_log = logging.getLogger(__name__)
_making = threading.RLock()


def _cache_folder() -> Path:
    """Return a folder for this build's compiled code that no other user can have filled: Numba runs what it holds.

    Raise FolderError if the folder named by ``NUMBA_CACHE_DIR`` is not safe, or if no safe folder exists.
    """
    inherited, named = os.environ.get(_INHERITED), os.environ.get("NUMBA_CACHE_DIR")
    if inherited and not named:
        with suppress(FolderError, OSError):
            return private_folder(Path(inherited), _folder_name())
    try:
        if named:
            return _writable(private_folder(Path(named), _folder_name()))
        return _writable(user_cache("numba", _folder_name()))
    except (FolderError, OSError, RuntimeError) as error:  # RuntimeError: this user has no home folder
        if named:
            raise FolderError(
                f"NUMBA_CACHE_DIR={named}: clearcap does not run compiled code from this folder: {error}."
                " Name a folder in which only you can write, or none"
            ) from None
        return _temporary_folder(error)


def _folder_name() -> str:
    """Return the name of the folder for this build on this type of processor.

    Otherwise machines of two types that share a folder and compile at the same time could run each other's code.
    """
    return f"{build_id()}-{hashlib.sha256(' '.join(processor()).encode()).hexdigest()[:8]}"


def _writable(folder: Path) -> Path:
    """Return a folder after checking that files can be written in it."""
    with tempfile.TemporaryFile(dir=folder):
        return folder


def _temporary_folder(reason: Exception) -> Path:
    """Return a temporary folder that is removed when this process ends, and log the reason for it."""
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
    """Remove a temporary folder, but not from a forked copy of the process that made it."""
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)


# Numba reads its settings again whenever an environment variable NUMBA_... changes; this value stays as it is
CACHE_FOLDER = _cache_folder()
numba.config.CACHE_DIR = str(CACHE_FOLDER)  # type: ignore[attr-defined]
# Level 2: runs are as fast as with level 3, and compiling takes a tenth less time than with 1 or 3.
if "NUMBA_OPT" not in os.environ:
    numba.config.OPT = type(numba.config.OPT)(2)  # type: ignore[attr-defined]

_RUN_TIME = {"nogil": True, "error_model": "numpy"}

# For the instrumented copy of the time loop: it contains addresses of clocks, which cannot be kept on disk.
uncached: Any = numba.njit(**_RUN_TIME, **KERNEL_OPTIONS)  # type: ignore[call-overload]


class Callee:
    """A kernel that only other kernels call.

    Numba gets to know it where one of these is compiled: what it makes of the engine's 400 callees takes a tenth of a
    short command, which reads machine code from the disk.
    """

    def __init__(self, function: Callable[..., Any], options: Mapping[str, Any]) -> None:
        self.py_func, self._options = function, options
        update_wrapper(self, function)  # type: ignore[arg-type]  # Python does not call it

    @cached_property
    def compiled(self) -> Any:
        """The same as Numba knows it."""
        return _made_once(self, self._options)


class Kernel:
    """A kernel that Python calls, and that other kernels can call as an `inner` one.

    Python calls ``compiled``, whose machine code is kept on disk, and other kernels call ``callee``.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.py_func = function
        self.callee = Callee(function, INNER_OPTIONS)
        self._ready = False
        self._variants: set[object] = set()
        update_wrapper(self, function)

    @cached_property
    def compiled(self) -> Any:
        """The same as Numba knows it."""
        return _made_once(self, KERNEL_OPTIONS, keep_on_disk)

    @property
    def ready(self) -> bool:
        """Whether its machine code is in memory."""
        self._ready = self._ready or bool(self.compiled.signatures)
        return self._ready

    def prepare(self, variant: object, arguments: Callable[[], tuple[Any, ...]]) -> None:
        """Call it once for a variant of its arguments' types, whose code is compiled or loaded by that.

        Other threads call it, too, until the first call has ended: so they wait here, and not in their runs.
        """
        if variant not in self._variants:
            self(*arguments())
            self._variants.add(variant)

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled kernel."""
        return self.compiled(*arguments)


def _made_once(
    kernel: Callee | Kernel, options: Mapping[str, Any], then: Callable[[Any], None] = lambda _: None
) -> Any:
    """Return what Numba makes of a kernel, the same for all threads: of `cached_property` alone two may make two."""
    with _making:
        if "compiled" not in vars(kernel):
            made = numba.njit(**_RUN_TIME, **options)(kernel.py_func)  # type: ignore[call-overload]
            then(made)
            vars(kernel)["compiled"] = made
        return vars(kernel)["compiled"]


@typeof_impl.register(Callee)
def _what_kernels_see(callee: Callee, context: Any) -> Any:
    return typeof_impl(callee.compiled, context)


@typeof_impl.register(Kernel)
def _what_kernels_see_of_a_kernel(kernel: Kernel, context: Any) -> Any:
    return typeof_impl(kernel.callee, context)


def inner(function: Callable[..., Any]) -> Any:
    """Compile a kernel that only other kernels call; see `Callee`. NUMBA_DISABLE_JIT=1 is heeded as by `kernel`."""
    return function if numba.config.DISABLE_JIT else Callee(function, INNER_OPTIONS)  # type: ignore[attr-defined]


def not_inlined(function: Callable[..., Any]) -> Any:
    """Do the same for a large kernel that few mechanisms need: it compiles faster if it remains one function."""
    return function if numba.config.DISABLE_JIT else Callee(function, NOT_INLINED_OPTIONS)  # type: ignore[attr-defined]


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a kernel that Python calls; see `Kernel`. With NUMBA_DISABLE_JIT=1 the function is returned unchanged."""
    return function if numba.config.DISABLE_JIT else Kernel(function)  # type: ignore[attr-defined]
