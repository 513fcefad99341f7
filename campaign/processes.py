"""Processes and addresses of this machine or container: environment, cores, which is which, a thread for a block."""

import ipaddress
import os
import re
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

STORE = "CLEARCAP_STORE"  # the store, if no option names one; unlike options, other users cannot read it
SERVER = "CLEARCAP_SERVER"  # the address of a server to use in place of a store
TOKEN = "CLEARCAP_TOKEN"  # the access token for the server; unlike options, other users cannot read it

# They choose the processor for which OpenBLAS, MKL, BLIS, NumPy, Numba and the C library compute. Numbers of threads
# are left out: they belong to a machine, and change no digit of a row.
_NUMERICAL = re.compile(r"(?!.*_NUM_THREADS$)((OPENBLAS|OMP|MKL|BLIS|NPY)_.*|NUMBA_(CPU_.*|OPT)|GLIBC_TUNABLES)")
PROC = Path("/proc")  # of Linux
ProcessName = tuple[str, int]  # machine, and number of a process there


def numerical(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return the variables on which the last digits of a number depend; who starts a process passes them on."""
    return {name: value for name, value in environment.items() if _NUMERICAL.fullmatch(name)}


def cores() -> int:
    """Return the number of cores that this process may use."""
    # macOS has no affinity
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def is_loopback(host: str) -> bool:
    """Return whether a host name or address is that of this machine (loopback)."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


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
