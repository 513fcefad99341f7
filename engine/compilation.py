"""Whether the engine is compiled for this build, processor and source code, according to the cache of its kernels."""

import sys
from typing import Any


def missing_kernels() -> tuple[str, ...]:
    """Return the index files of the kernels that are not in the cache yet; empty if the engine is compiled.

    There is one index file for each kernel that Python calls; its name stands for it if Numba does not say where it is.
    Most of the work is the time loop; responses and ranges of forces are compiled after it, and only in a run that
    needs them.
    """
    from engine.friction.barrier import least
    from engine.jit import Kernel
    from engine.kernels.responses import measure
    from engine.kernels.time_loop import run_to_end

    needed = [kernel for kernel in (run_to_end, measure, least) if isinstance(kernel, Kernel)]
    if all(kernel.compiled.signatures or not _missing_file(kernel) for kernel in needed):
        return ()
    engine_modules = [module for name, module in list(sys.modules.items()) if name.partition(".")[0] == "engine"]
    values = {id(value): value for module in engine_modules for value in vars(module).values()}.values()
    files = [_missing_file(value) for value in values if isinstance(value, Kernel)]
    return tuple(file for file in files if file)


def _missing_file(kernel: Any) -> str:
    """Return the index file of a kernel; empty if it lists machine code, compiled from the current source."""
    from engine.compiler.numba_internals import index_file

    index = index_file(kernel.compiled)
    if index is None:
        return f"{kernel.__module__}.{kernel.__qualname__}"
    path, is_filled = index
    return "" if is_filled else path
