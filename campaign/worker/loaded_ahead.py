"""What a worker of this machine loads when it starts, rather than with its first batch.

Dask's setting ``distributed.worker.preload`` names this module, see `campaign.cluster.local`. A worker that another
program started is left alone: what it loads is not this project's to say.
"""

import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from types import ModuleType
from typing import Any

from distributed.versions import get_versions

BATCHES_NEED = ("campaign.worker.batch", "pyarrow.parquet")


class NoPandas:
    """A finder of modules that says of pandas that it is not installed."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> None:
        """Raise ModuleNotFoundError for pandas; find nothing else."""
        if name == "pandas":
            raise ModuleNotFoundError("pandas is left out of this process", name=name)


def dask_setup(worker: Any) -> None:
    """Have a worker that starts load ahead; dask calls this.

    The thread of its batches does it, so that the worker joins the scheduler meanwhile, and its first batch waits. The
    versions that the worker states when it joins are looked up before: while another thread imports modules one of
    them was not found, once in thousands of starts, and dask warned of different versions.
    """
    get_versions()  # and remembers them
    worker.executors["default"].submit(load_ahead)


def load_ahead() -> None:
    """Load what batches need, and the engine if it is compiled.

    What fails here fails again with the first batch, where the coordinator hears of it.
    """
    with suppress(Exception):
        keep_pandas_out()
        _load()


def keep_pandas_out() -> None:
    """Have pyarrow go without pandas in this process, where it would load it with the first array that it makes.

    Rows are no tables of pandas, and loading it takes longer than the first runs. Other code may still import it.
    """
    import pyarrow as pa

    if "pandas" in sys.modules:
        return
    sys.meta_path.insert(0, NoPandas)
    try:
        pa.array([0])  # pyarrow looks for pandas once
    finally:
        sys.meta_path.remove(NoPandas)


def _load() -> None:
    """Import what batches need, and load compiled kernels; compiling them is left to one worker, which says so."""
    for module in BATCHES_NEED:
        import_module(module)
    from engine import missing_kernels, warm_up

    if not missing_kernels():
        warm_up()
