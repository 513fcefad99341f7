"""Dask schedulers and workers as processes of their own, for tests."""

import os
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager


def free_port():
    """Return a port of loopback that nobody listens on."""
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def tls_arguments(folder, role):
    """Return the options of dask's commands for certificates that ``clearcap certificates`` made."""
    return [f"--tls-ca-file={folder}/ca.pem", f"--tls-cert={folder}/{role}.pem", f"--tls-key={folder}/{role}.key"]


@contextmanager
def process(*command, prefix=(), environment=None):
    """Run ``python -m ...`` quietly; end it and all it started."""
    running = subprocess.Popen(
        [*prefix, sys.executable, "-m", *map(str, command)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        env={**os.environ, **(environment or {})},
    )
    try:
        yield running
    finally:
        running.send_signal(signal.SIGTERM)
        try:
            running.wait(10)
        except subprocess.TimeoutExpired:
            os.killpg(running.pid, signal.SIGKILL)
            running.wait()


def scheduler(port, *options, host="127.0.0.1", **where):
    """Start a scheduler whose dashboard is closed to others."""
    command = ["distributed.cli.dask_scheduler", f"--host={host}", f"--port={port}", "--no-dashboard"]
    return process(*command, "--dashboard-address=127.0.0.1:0", *options, **where)


def worker(address, folder, *options, **where):
    """Start a worker process with one thread."""
    command = ["distributed.cli.dask_worker", address, "--nthreads=1", "--no-dashboard"]
    local = ["--dashboard-address=127.0.0.1:0", f"--local-directory={folder}"]
    return process(*command, *local, *options, **where)
