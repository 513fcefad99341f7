"""Whether the engine is compiled for this build, this processor and these sources, as the cache of its kernels says."""

import sys
from typing import Any


def missing_kernels() -> tuple[str, ...]:
    """Return the index files that compiling the engine will write; none if it is compiled.

    Numba keeps an index for each kernel. That of the time loop comes last: with it, all kernels below it are compiled.
    """
    from numba.core.dispatcher import Dispatcher

    from engine.kernels.time_loop import run_to_end

    if not isinstance(run_to_end, Dispatcher) or run_to_end.signatures or _is_cached(run_to_end):
        return ()
    engine_modules = [module for name, module in list(sys.modules.items()) if name.partition(".")[0] == "engine"]
    values = {id(value): value for module in engine_modules for value in vars(module).values()}.values()
    kernels = [value for value in values if isinstance(value, Dispatcher) and _index(value)]
    return tuple(_index(kernel)._index_path for kernel in kernels if not _is_cached(kernel))


def _is_cached(kernel: Any) -> bool:
    """Return whether the cache has machine code of a kernel, compiled from the present source."""
    index = _index(kernel)
    return index is not None and bool(index._load_index())


def _index(kernel: Any) -> Any:
    """Return Numba's reader of the index of a kernel; None if the kernel is not kept on disk."""
    return getattr(kernel._cache, "_cache_file", None)
