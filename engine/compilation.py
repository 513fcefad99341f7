"""Whether the engine is compiled for this build, this processor and these sources, as the cache of its kernels says."""

import sys
from typing import Any


def missing_kernels() -> tuple[str, ...]:
    """Return the index files of which compiling the engine will write some; none if it is compiled.

    There is one for each kernel that Python calls. That of the time loop is the greatest part of the work; responses
    and ranges of forces come after it, and a run that has none compiles none of them.
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
    """Return whether the cache has machine code of a kernel, compiled from the present source."""
    return bool(_index(kernel)._load_index())


def _index(kernel: Any) -> Any:
    """Return Numba's reader of the index of a kernel."""
    return kernel.compiled._cache._cache_file
