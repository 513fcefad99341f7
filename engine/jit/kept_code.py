"""Machine code of kernels on disk: the folder of a kernel, and how its code is loaded.

The user's own code comes first, then what came with the package (`engine.jit.shipped`). Names of Numba beyond its
manual are those of `engine.jit.numba_internals`, which says what each is for.
"""

import hashlib
import logging
import pickle
import sys
from collections.abc import Iterator
from functools import cache, reduce
from pathlib import Path
from typing import Any

from llvmlite import binding

from engine.jit import shipped
from engine.jit.numba_internals import ALONE, INDEX, KEPT, OF_A_KERNEL, SHIPPED, has, lost

from numba.core import config  # isort: skip  # after `numba_internals`, which imports it in the required way

# What `pickle` raises for a file that is not whole, as after a power failure.
DAMAGED = (pickle.UnpicklingError, EOFError, AttributeError, ImportError, LookupError, TypeError, ValueError)

_log = logging.getLogger(__name__)

KEEPS_CODE = has(KEPT)

if KEEPS_CODE:
    from numba.core.caching import UserProvidedCacheLocator

    # use no other folder than `config.CACHE_DIR`, such as ~/.cache/numba, which nobody has checked
    config.CACHE_LOCATOR_CLASSES = f"{__name__}.BuildLocator"  # type: ignore[attr-defined]

    class BuildLocator(UserProvidedCacheLocator):  # type: ignore[misc]
        """Where Numba keeps a kernel: in the folder by module name, so that all installations of a build share it."""

        def __init__(self, py_func: Any, py_file: str) -> None:
            super().__init__(py_func, py_file)  # type: ignore[no-untyped-call]
            self._source, self.subfolder = py_file, self.get_suitable_cache_subpath(py_file)

        @classmethod
        def get_suitable_cache_subpath(cls, py_file: str) -> str:
            """Return the folder for a source file's kernels; outside the engine as Numba does, by its full path."""
            folder, engine = Path(py_file).absolute().parent, Path(__file__).absolute().parents[1]
            if folder.is_relative_to(engine):
                return str(folder.relative_to(engine.parent))
            return str(super().get_suitable_cache_subpath(py_file))  # type: ignore[no-untyped-call]

        def get_source_stamp(self) -> bytes:
            """Return the digest of a kernel's source file: Numba 0.66 goes by times, which an installation changes."""
            return _digest_of(self._source)


@cache
def _digest_of(file: str) -> bytes:
    return hashlib.sha256(Path(file).read_bytes()).digest()


def processor() -> tuple[str, str]:
    """Return name and features of the processor for which Numba compiles: this one, or that of NUMBA_CPU_NAME."""
    name, features = config.CPU_NAME, config.CPU_FEATURES  # type: ignore[attr-defined]
    return (
        name or binding.get_host_cpu_name(),
        binding.get_host_cpu_features().flatten() if features is None else features,
    )


_loads_alone = KEEPS_CODE and has(ALONE)

if _loads_alone:
    from numba.core.caching import CompileResultCacheImpl, FunctionCache
    from numba.core.runtime.nrt import rtsys
    from numba.np import linalg

    _ensure_blas = linalg.ensure_blas

    def ensure_blas() -> None:
        """Import SciPy's linear algebra where a kernel uses it, but not to see whether it is there."""
        if hasattr(sys.modules.get("numba.np.arraymath"), "_HAVE_BLAS"):  # which looks when it is imported
            _ensure_blas()  # type: ignore[no-untyped-call]

    linalg.ensure_blas = ensure_blas

    class Names(CompileResultCacheImpl):  # type: ignore[misc]
        """What is kept of a kernel: machine code, and of the code for callers, which has none, only a name.

        Numba would keep that, too, and read it with the machine code: it was half of what loading a kernel took.
        """

        def reduce(self, cres: Any) -> Any:
            """Return what is written to disk."""
            (name, kind, code), described, *rest = super().reduce(cres)  # type: ignore[no-untyped-call]
            if kind == "object":
                code = code[0], _defines(described.llvm_cpython_wrapper_name)
            return (name, kind, code), described, *rest

    class KernelCache(FunctionCache):  # type: ignore[misc]
        """The code of a kernel in the user's folder, which needs nothing of what Numba loads in order to compile."""

        _impl_class = Names

        def load_overload(self, sig: Any, target_context: Any) -> Any:
            """Return the code for a signature; None if there is none, and then Numba loads the rest and compiles."""
            rtsys.initialize(target_context)
            with self._guard_against_spurious_io_errors():  # type: ignore[no-untyped-call]
                return self._load_overload(sig, target_context)

        def _load_overload(self, sig: Any, target_context: Any) -> Any:
            try:
                return super()._load_overload(sig, target_context)  # type: ignore[no-untyped-call]
            except DAMAGED as error:
                _log.warning(
                    "compiled code in %s is damaged, and a kernel is compiled anew: %r", self.cache_path, error
                )
                self.flush()  # type: ignore[no-untyped-call]
                return None


def _defines(name: str) -> bytes:
    """Return code in which a function of that name is defined, and nothing else."""
    module: Any = binding.parse_assembly(f'define void @"{name}"() {{ ret void }}')  # type: ignore[no-untyped-call]
    return bytes(module.as_bitcode())


@cache
def _layers() -> list[shipped.Layer]:
    """Return the machine code of the package that may run here: none with NUMBA_CPU_NAME, but of that very level."""
    name, features = config.CPU_NAME, config.CPU_FEATURES  # type: ignore[attr-defined]
    if features or (name is None) != (features is None):
        return []
    return shipped.layers(binding.get_host_cpu_features(), name)


_finds_shipped = _loads_alone and has(SHIPPED)

if _finds_shipped:
    from numba.core.caching import IndexDataCacheFile

    class LayeredCache(KernelCache):
        """The same, found in the user's folder, or else among what came with the package."""

        def _load_overload(self, sig: Any, target_context: Any) -> Any:
            data = super()._load_overload(sig, target_context)
            if data is not None:
                return data
            signature, (system, *_), sources = self._index_key(sig, target_context.codegen())  # type: ignore[no-untyped-call]
            name, stamp = self._impl.filename_base, self._impl.locator.get_source_stamp()
            for level, folder in self.shipped():
                file = IndexDataCacheFile(str(folder), name, stamp)  # type: ignore[no-untyped-call]
                kept = file.load((signature, (system, level, ""), sources))  # type: ignore[no-untyped-call]
                if kept is not None:
                    return self._impl.rebuild(target_context, kept)
            return None

        def shipped(self) -> Iterator[tuple[str, Path]]:
            """Yield the levels for which this kernel's code came with the package, the best first, and its folder."""
            for layer in _layers():
                if folder := layer.folder_of(f"{self._impl.locator.subfolder}/{self._impl.filename_base}"):
                    yield layer.level, folder


def keep_on_disk(compiled: Any) -> None:
    """Keep the code of a kernel on disk, and load it from there."""
    if not KEEPS_CODE:
        return
    if _loads_alone and hasattr(compiled, "_cache"):
        kind = LayeredCache if _finds_shipped and _layers() else KernelCache
        compiled._cache = kind(compiled.py_func)  # type: ignore[no-untyped-call]
    else:
        compiled.enable_caching()


def index_file(compiled: Any) -> tuple[str, bool] | None:
    """Return the index file of a kernel's code on disk, and whether code of this source is there; None: unknown."""
    if not KEEPS_CODE:
        return None
    try:
        path, load = (reduce(getattr, name.split("."), compiled) for name in OF_A_KERNEL)
    except AttributeError as error:
        lost(INDEX, f":{error.name}")
        return None
    try:
        if load():
            return path, True
    except DAMAGED:  # as if there were none, as in `KernelCache`
        pass
    came = compiled._cache.shipped() if _finds_shipped and isinstance(compiled._cache, LayeredCache) else ()
    return path, any(True for _ in came)
