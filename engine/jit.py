"""The decorators of all compiled kernels, and the folder where compiled code is kept.

Options: the GIL is released (a worker's heartbeat must continue), NumPy's error model (a division by zero gives an inf,
which the caller checks, instead of an exception), no fast-math (a row must have the same bits everywhere).

Only kernels that Python calls become machine code, each as one module with all kernels it calls, optimised once and
kept on disk. By default Numba does this for every kernel and again for all of its callees, so that a kernel ten calls
deep is optimised ten times. The cost of compiling a kernel grows with the length of its code, so tuples of arrays are
passed by address, see `engine.compiler`.
"""

import atexit
import hashlib
import logging
import os
import shutil
import tempfile
from collections.abc import Callable
from contextlib import chdir, nullcontext, suppress
from functools import update_wrapper
from pathlib import Path
from typing import Any

from llvmlite import binding

from engine.build import build_id
from engine.errors import FolderError
from engine.private_folder import private_folder

# Names the temporary folder of a process to its child processes, which then need not compile again.
_INHERITED = "CLEARCAP_TEMPORARY_CACHE"

_log = logging.getLogger(__name__)

# Numba reads settings from this file in the current folder, where anybody may have put it; they even include the
# processor's instruction set. So Numba is imported from another folder, and never looks for the file again.
SETTINGS = ".numba_config.yaml"

with chdir("/") if os.path.lexists(SETTINGS) else nullcontext():
    import numba
    from numba.core import config
    from numba.core.caching import UserProvidedCacheLocator
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler import Compiler
    from numba.core.types import Dispatcher

    from engine.compiler.known_registrations import registrations_known
    from engine.compiler.paused_collection import collection_paused
    from engine.compiler.remembered_sizes import sizes_remembered
    from engine.compiler.remembered_types import choices_remembered

config._config_fname = os.devnull
if os.path.lexists(SETTINGS):  # the program may have imported Numba, and so read the file, before this module
    config._env_reloader.reset()


def _cache_folder() -> Path:
    """Return a folder for this build's compiled code that no other user can have filled: Numba runs what it holds.

    Raises
    ------
    FolderError
        If the folder named by ``NUMBA_CACHE_DIR`` is not safe, or if no safe folder exists.
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
    name = numba.config.CPU_NAME or binding.get_host_cpu_name()  # type: ignore[attr-defined]
    features = numba.config.CPU_FEATURES  # type: ignore[attr-defined]
    features = binding.get_host_cpu_features().flatten() if features is None else features
    return f"{build_id()}-{hashlib.sha256(f'{name} {features}'.encode()).hexdigest()[:8]}"


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
# use no other folder, such as ~/.cache/numba, which nobody has checked
numba.config.CACHE_LOCATOR_CLASSES = "engine.jit.BuildLocator"  # type: ignore[attr-defined]


class BuildLocator(UserProvidedCacheLocator):  # type: ignore[misc]
    """Where Numba keeps a kernel in the cache folder: by module name, so that all installations of a build share it."""

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Return the folder for the kernels of a source file; outside the engine by its full path, as Numba does."""
        folder, engine = Path(py_file).absolute().parent, Path(__file__).absolute().parent
        if folder.is_relative_to(engine):
            return str(folder.relative_to(engine.parent))
        return str(super().get_suitable_cache_subpath(py_file))


# Level 2: runs are as fast as with level 3, and compiling takes a tenth less time than with 1 or 3.
if "NUMBA_OPT" not in os.environ:
    numba.config.OPT = type(numba.config.OPT)(2)  # type: ignore[attr-defined]

_OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}


class _CalleeLibrary(JITCodeLibrary):  # type: ignore[misc]
    """The code of a kernel and its callees, for callers to link: neither optimised as a whole nor machine code."""

    def finalize(self) -> None:
        """Link the callees."""
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()
        self._finalized = True


class _KernelCompiler(Compiler):  # type: ignore[misc]
    """Numba's compiler with cached lookups and without garbage collection."""

    def _compile_core(self) -> Any:
        with choices_remembered(), sizes_remembered(), registrations_known(), collection_paused():
            return super()._compile_core()


class _CalleeCompiler(_KernelCompiler):
    """The same, but only up to the code that callers link."""

    def _compile_core(self) -> Any:
        state, name = self.state, self.state.func_id.func_qualname
        state.flags.no_compile = True
        state.library = _CalleeLibrary(state.targetctx.codegen(), name)
        # Numba identifies functions by their entry points for Python. There is none here, so a built-in method stands
        # in
        result = super()._compile_core()._replace(entry_point=[name].append)
        result.target_context.insert_user_function(result.entry_point, result.fndesc, [result.library])
        return result


class _NotInlinedCompiler(_CalleeCompiler):
    """The same, for a function that is not inlined into its callers."""

    def _compile_core(self) -> Any:
        result = super()._compile_core()
        code = result.library._final_module.get_function(result.fndesc.mangled_name)
        code.add_function_attribute("noinline")
        return result


# For kernels that only other kernels call.
inner: Any = numba.njit(**_OPTIONS, no_cpython_wrapper=True, pipeline_class=_CalleeCompiler)  # type: ignore[call-overload]

# The same, for large kernels that few mechanisms need: they compile faster if each remains one function.
not_inlined: Any = numba.njit(**_OPTIONS, no_cpython_wrapper=True, pipeline_class=_NotInlinedCompiler)  # type: ignore[call-overload]

# For the instrumented copy of the time loop: it contains addresses of clocks, which cannot be kept on disk.
uncached: Any = numba.njit(**_OPTIONS, pipeline_class=_KernelCompiler)  # type: ignore[call-overload]


class Kernel:
    """A kernel that Python calls, and that other kernels can call as an `inner` one.

    Attributes
    ----------
    py_func : callable
        The Python function.
    compiled : Dispatcher
        The function that Python calls, with machine code that is kept on disk.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.py_func = function
        options = {**_OPTIONS, "cache": True, "pipeline_class": _KernelCompiler}
        self.compiled: Any = numba.njit(**options)(function)  # type: ignore[call-overload]
        self._callee = inner(function)
        self._numba_type_ = Dispatcher(self._callee)  # what this object means to Numba inside a kernel
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled kernel."""
        return self.compiled(*arguments)


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a kernel that Python calls; see `Kernel`. With NUMBA_DISABLE_JIT=1 the function is returned unchanged."""
    return function if config.DISABLE_JIT else Kernel(function)  # type: ignore[attr-defined]
