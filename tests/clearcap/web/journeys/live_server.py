"""A `clearcap serve` in a process of its own, as a user starts it, with a store and a data folder of its own."""

import json
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx2 as httpx

from campaign.compiling import compile_engine
from campaign.store import Store, open_store
from tests.bounded import bounded
from tests.clearcap.web.running import PATIENCE

HOST = "127.0.0.1"
WORKERS = 1


@dataclass(frozen=True)
class LiveServer:
    """A server that answers.

    Attributes
    ----------
    url : str
        Its address, without a path.
    login : str
        The link by which its admin logs in once.
    store : Store
        What it serves.
    """

    url: str
    login: str
    store: Store


def _command(store: str, data: Path, port: str) -> list[str]:
    words = [sys.executable, "-P", "-m", "clearcap", "serve", "--store", store, "--port", port]
    return [*words, "--data", str(data), "--workers", str(WORKERS)]


def _free_port() -> str:
    with socket.socket() as listening:
        listening.bind((HOST, 0))
        return str(listening.getsockname()[1])


@contextmanager
def live_server(folder: Path, *options: str, store: str = "") -> Iterator[LiveServer]:
    """Serve a store in the block, and compute what is queued if no option says otherwise.

    What only the server keeps is in ``data`` of the folder, and so is the store, in ``runs``, unless another is given.
    """
    store = store or str(folder / "runs")
    compile_engine()
    port = _free_port()
    log = folder / "serve.log"
    with log.open("w") as written:
        process = subprocess.Popen(
            [*_command(store, folder / "data", port), "--json", *options],
            stdout=subprocess.PIPE,
            stderr=written,
            text=True,
        )
    assert process.stdout is not None
    try:
        lines = []
        with bounded("what the server says first", PATIENCE):
            while not lines or lines[-1] not in ("", "}\n"):
                lines.append(process.stdout.readline())
        assert lines[-1], log.read_text()
        told = json.loads("".join(lines))
        with httpx.Client(transport=httpx.HTTPTransport(retries=20), timeout=PATIENCE) as client:
            client.get(f"{told['address']}/healthz").raise_for_status()
        file = told["login_file"]
        yield LiveServer(told["address"], Path(file).read_text().strip() if file else "", open_store(store))
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(PATIENCE)
        finally:
            process.kill()
            process.stdout.close()
