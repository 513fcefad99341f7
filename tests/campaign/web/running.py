"""A server as its users have it: on a port, in a thread of the tests or in a process of its own."""

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

from campaign.web.access import Role
from campaign.web.access.database import Database
from campaign.web.access.tokens import Tokens
from campaign.web.access.users import Users
from campaign.web.server import http_server
from campaign.web.web_service import open_service
from tests.until import until

PATIENCE = 600.0  # s, which only a hang reaches
ROOT = Path(__file__).parents[3]


async def until_true(condition, what=""):
    """Wait in an event loop, which goes on meanwhile, until a condition holds; see `until`."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, f"not within {PATIENCE:g} s: {what}"
        await asyncio.sleep(0.01)


@contextmanager
def in_a_thread(settings):
    """Serve in a thread of this process; yield the service and the port."""
    service = open_service(settings)
    for role in Role:
        service.users.add(role.word, role)
    listening = socket.socket()
    listening.bind(("127.0.0.1", 0))
    server = http_server(service)
    thread = threading.Thread(target=server.run, args=([listening],))
    thread.start()
    try:
        until(lambda: server.started, "the server starts")
        yield service, listening.getsockname()[1]
    finally:
        server.should_exit = True
        thread.join(PATIENCE)
        listening.close()
        assert not thread.is_alive()


def exchange(port, *pieces, pause=0.0, seconds=PATIENCE):
    """Send bytes in pieces over a connection of its own; return all that comes until the server closes it."""
    with socket.create_connection(("127.0.0.1", port), timeout=seconds) as connection:
        answer = b""
        try:
            for piece in pieces:
                connection.sendall(piece)
                time.sleep(pause)
        except (BrokenPipeError, ConnectionResetError):
            pass  # it has answered already
        try:
            while more := connection.recv(1 << 16):
                answer += more
        except ConnectionResetError:
            pass
        return answer


class Served:
    """``clearcap serve`` in a process of its own.

    Parameters
    ----------
    folder : Path
        It gets the folders `runs` and `data`, and what the server writes.
    options : str
        More options of the command.
    """

    def __init__(self, folder, *options, port=0):
        self.folder, self.port = folder, port or _free_port()
        self.data, self.url = folder / "data", f"http://127.0.0.1:{self.port}"
        self.log = folder / "server.log"
        words = ["serve", "--store", folder / "runs", "--data", self.data, "--port", self.port, "--json", *options]
        path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "campaign", *map(str, words)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env={**os.environ, "PYTHONPATH": path},
                start_new_session=True,
            )

    def wait(self):
        """Wait until it answers."""
        until(lambda: self.process.poll() is not None or _answers(self.port), self.said)
        assert self.process.poll() is None, self.said()
        return self

    def said(self):
        """Return what it wrote."""
        return self.log.read_text(errors="replace")[-4000:]

    def token(self, role="admin"):
        """Return headers with a new token of a role."""
        database = Database(self.data / "service.sqlite")
        try:
            users = Users(database)
            if users.get(role) is None:
                users.add(role, Role.of(role))
            return {"Authorization": f"Bearer {Tokens(database).add(role, 'test', Role.of(role), 3600.0)[1]}"}
        finally:
            database.close()

    def memory(self):
        """Return the memory of the process that serves [bytes]."""
        return psutil.Process(self.process.pid).memory_info().rss

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is not None:
            return
        left = psutil.Process(self.process.pid).children(recursive=True)
        self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(PATIENCE)
        finally:
            for each in (self.process, *left):
                with suppress(psutil.NoSuchProcess):
                    each.kill()


def served_address(log):
    """Return what a server wrote first, as data."""
    return json.loads(log.read_text().splitlines()[0])


def _answers(port):
    try:
        return exchange(port, b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").startswith(
            b"HTTP/1.1 200"
        )
    except OSError:
        return False


def _free_port():
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]
