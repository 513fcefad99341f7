"""A lock that allows one server per data folder: a second one would use another index and sign with the same key."""

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

from campaign.errors import SpecError, unwritable
from campaign.web.settings import Settings

LOCK = "server.lock"


@contextmanager
def only_server(settings: Settings) -> Iterator[None]:
    """Hold the lock of a data folder in the block; the end of the process releases it too, however it ends.

    Raises SpecError if another server uses the folder. Raises StoreError if the folder's disk is read-only or broken.
    """
    path = settings.data / LOCK
    with ExitStack() as stack:
        try:
            file = stack.enter_context(path.open("a+b", buffering=0))
        except OSError as error:
            raise unwritable(f"--data {settings.data}: cannot be used now ({error.strerror})", error) from error
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            file.seek(0)
            which = _named(file.read(500))
            raise SpecError(
                f"--data {settings.data}: another server uses this folder{which}; end it first, or give this one a"
                " folder of its own with --data"
            ) from error
        with suppress(OSError):  # a full disk: only the message to a second server needs it
            file.truncate(0)
            file.write(json.dumps({"process": os.getpid(), "address": settings.address}).encode())
        yield


def _named(text: bytes) -> str:
    """Describe the server that wrote the lock; return an empty string if nothing is written yet."""
    try:
        known = json.loads(text)
        return f" (process {known['process']}, {known['address']})"
    except (ValueError, KeyError, TypeError):
        return ""
