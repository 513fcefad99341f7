"""Whether the engine is compiled for this build, processor and source code, according to the cache of its kernels."""

import sys
from typing import Any


def missing_kernels() -> tuple[str, ...]:
    """Return the index files of the kernels that are not in the cache yet; empty if the engine is compiled.

    There is one index file for each kernel that Python calls. Most of the work is the time loop; responses and ranges
    of forces are compiled after it, and only in a run that needs them.
    """
    from engine.friction.barrier import least
    from engine.jit import Kernel
    from engine.kernels.responses import measure
    from engine.kernels.time_loop import run_to_end

    needed = [kernel for kernel in (run_to_end, measure, least) if isinstance(kernel, Kernel)]
    if all(kernel.compiled.signatures or _is_cached(kernel) for kernel in needed):
        return ()
    engine_modules = [module for name, module in list(sys.modules.items()) if name.partition(".")[0] == "engine"]
    values = {id(value): value for module in engine_modules for value in vars(module).values()}.values()
    kernels = [value for value in values if isinstance(value, Kernel)]
    return tuple(_index(kernel)._index_path for kernel in kernels if not _is_cached(kernel))


def _is_cached(kernel: Any) -> bool:
    """Return whether the cache holds machine code of a kernel, compiled from the current source."""
    return bool(_index(kernel)._load_index())


def _index(kernel: Any) -> Any:
    """Return Numba's reader of a kernel's index file."""
    return kernel.compiled._cache._cache_file
