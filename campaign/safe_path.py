"""Keep the current folder off the module search path: anybody may have put a file there, under any name.

Python puts the current folder first for ``python -m`` and ``python -c``, and so for the processes that
`multiprocessing` and dask start. This module imports only modules that Python has already loaded at startup.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


def leave_current_folder_out() -> None:
    """Remove the current folder from the path of this process and of every Python process that it starts."""
    # It stays on the path of this process if this package itself was imported from there.
    os.environ["PYTHONSAFEPATH"] = "1"
    if not _is_current(os.path.dirname(os.path.dirname(os.path.abspath(__file__)))):
        sys.path[:] = [entry for place, entry in enumerate(sys.path) if entry and (place or not _is_current(entry))]


@contextmanager
def current_folder_left_out() -> Iterator[None]:
    """Keep the current folder off the path of Python processes started in the block."""
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
    except OSError:  # one of the folders no longer exists
        return False
