"""Make a worker of this machine load modules and kernels when it starts rather than with its first batch.

Dask's setting ``distributed.worker.preload`` names this module; see `campaign.cluster.local`. Workers started by other
programs are left alone, because this project does not control what they load.
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
    """A module finder that reports pandas as not installed."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> None:
        """Raise ModuleNotFoundError for pandas; return None for all other modules."""
        if name == "pandas":
            raise ModuleNotFoundError("pandas is left out of this process", name=name)


def dask_setup(worker: Any) -> None:
    """Make a starting worker load ahead, in its thread for batches, so that it joins the scheduler in the meantime."""
    # The versions that the worker states when it joins are looked up before: once in thousands of starts, one of them
    # was not found while another thread imported modules, and dask warned of different versions.
    get_versions()  # caches them
    # Not in the thread: one that imports the whole package and another that imports a part of it, as to unpickle a
    # batch, can wait for one another, and Python then lets one of them fail.
    with suppress(Exception):
        import_module("engine")
    worker.executors["default"].submit(load_ahead)


def load_ahead() -> None:
    """Load the modules that batches need, and the engine if it is compiled; an error recurs with the first batch."""
    with suppress(Exception):
        keep_pandas_out()
        _load()


def keep_pandas_out() -> None:
    """Keep pyarrow here from importing pandas with its first array, which takes longer than the first runs."""
    import pyarrow as pa

    if "pandas" in sys.modules:
        return
    sys.meta_path.insert(0, NoPandas)
    try:
        pa.array([0])  # pyarrow looks for pandas once
    finally:
        sys.meta_path.remove(NoPandas)


def _load() -> None:
    """Import the modules that batches need, and load kernels unless one is missing: one worker will compile for all."""
    for module in BATCHES_NEED:
        import_module(module)
    from engine import missing_kernels, warm_up

    if not missing_kernels():
        warm_up()
