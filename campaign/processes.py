"""The processes of this machine or container: their cores, which is which, and a thread beside a block of code."""

import os
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

PROC = Path("/proc")  # of Linux


def cores() -> int:
    """Return the number of cores that this process may use."""
    # macOS has no affinity
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def meanwhile(act: Callable[[threading.Event], None], name: str) -> Iterator[None]:
    """Run a function in a daemon thread during the block; the event that it gets is set when the block ends."""
    over = threading.Event()
    thread = threading.Thread(target=act, args=(over,), name=name, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@cache
def process_space() -> str:
    """Return an identifier that processes share exactly if they are in one PID namespace of one boot."""
    try:
        boot = (PROC / "sys/kernel/random/boot_id").read_text().strip()
        return f"{boot} {(PROC / 'self/ns/pid').stat().st_ino}"
    except OSError:  # not Linux
        return socket.gethostname()


def started(pid: Any) -> str | None:
    """Return when a process of this space started, in clock ticks since boot; None if it has ended or is a zombie."""
    try:
        fields = (PROC / f"{int(pid)}/stat").read_text().rpartition(")")[2].split()
        return None if fields[0] in "ZX" else fields[19]  # fields 3 and 22 of proc(5): state, starttime
    except FileNotFoundError:
        return _alive_without_proc(pid) if not (PROC / "self/stat").exists() else None
    except (OSError, ValueError, TypeError, IndexError, OverflowError):
        return None


def _alive_without_proc(pid: Any) -> str | None:
    """Return a fixed word for a living process, on systems without /proc."""
    try:
        os.kill(int(pid), 0)
    except ProcessLookupError:
        return None
    except PermissionError:
        return "alive"
    return "alive"
