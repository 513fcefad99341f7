"""Keep the current folder off the path of modules: a file there may bear any name, and be anybody's.

Python puts it first for ``python -m`` and ``python -c``, and so for the processes that `multiprocessing` and dask
start. What this module imports, Python itself has loaded at its start.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


def leave_current_folder_out() -> None:
    """Take the current folder off the path of this process, and of every Python process that it starts.

    It stays if this package itself was imported from there.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
    if not _is_current(os.path.dirname(os.path.dirname(os.path.abspath(__file__)))):
        sys.path[:] = [entry for place, entry in enumerate(sys.path) if entry and (place or not _is_current(entry))]


def python_environment() -> dict[str, str]:
    """Return the environment of a Python process that can import what this one can, except from the current folder."""
    path = filter(os.path.isabs, sys.path)
    return {**os.environ, "PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(path)}


@contextmanager
def current_folder_left_out() -> Iterator[None]:
    """Keep the current folder off the path of the Python processes that are started in the block."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before


def _is_current(folder: str) -> bool:
    try:
        return os.path.samefile(folder or ".", ".")
    except OSError:  # one of them is gone
        return False
