"""A server as its users have it: on a port, in a thread of the tests or in a process of its own."""

import asyncio
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

from clearcap.web.access import Role
from clearcap.web.access.database import Database
from clearcap.web.access.users import Tokens, Users
from clearcap.web.server import http_server
from clearcap.web.web_service import open_service
from tests.until import until

PATIENCE = 600.0  # s, which only a hang reaches
ROOT = Path(__file__).parents[3]


async def until_true(condition, what=""):
    """Wait in an event loop, which goes on meanwhile, until a condition holds; see `until`."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, f"not within {PATIENCE:g} s: {what}"
        await asyncio.sleep(0.01)


class HeldClock:
    """The clock of the event loop of a server in a thread: it stands, but where a test moves it."""

    def __init__(self):
        self.now, self._released = 0.0, None

    def loop(self):
        """Return a new event loop with this clock."""
        self._loop = asyncio.new_event_loop()
        self._loop.time = lambda: self.now if self._released is None else self.now + time.monotonic() - self._released
        return self._loop

    def move(self, seconds):
        """Have the server do all that it can do at once, let time pass, and have it do what is due then."""
        self._turn()
        self.now += seconds
        self._turn()

    def release(self):
        """Go on by itself."""
        self._released = time.monotonic()

    def _turn(self):
        for _ in range(10):  # of the loop, in each of which it reads what has come
            asyncio.run_coroutine_threadsafe(asyncio.sleep(0), self._loop).result(PATIENCE)


@contextmanager
def in_a_thread(settings, clock=None):
    """Serve in a thread of this process, by a clock of its own if one is given; yield the service and the port."""
    service = open_service(settings)
    for role in Role:
        service.users.add(role.word, role)
    listening = socket.socket()
    listening.bind(("127.0.0.1", 0))
    server = http_server(service)
    if clock is not None:
        server.config.get_loop_factory = lambda: clock.loop
    thread = threading.Thread(target=server.run, args=([listening],))
    thread.start()
    try:
        until(lambda: server.started, "the server starts")
        yield service, listening.getsockname()[1]
    finally:
        server.should_exit = True
        if clock is not None:
            clock.release()
        thread.join(PATIENCE)
        listening.close()
        assert not thread.is_alive()


def exchange(port, *pieces, clock=None, step=0.0):
    """Send bytes in pieces over a connection of its own; return all that comes until the server closes it.

    By the server's clock, `step` [s] pass after each piece; see `taken`.
    """
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as connection:
        with suppress(BrokenPipeError, ConnectionResetError):  # it has answered already
            for piece in pieces:
                connection.sendall(piece)
                if clock is not None:
                    clock.move(step)
        return taken(connection, clock, step)


def taken(connection, clock=None, step=0.0):
    """Return all that comes until the server closes a connection; while nothing comes, its clock moves on by steps."""
    answer = b""
    with suppress(ConnectionResetError):
        while True:
            while clock is not None and not select.select([connection], [], [], 0.02)[0]:
                clock.move(step)
            if not (more := connection.recv(1 << 16)):
                break
            answer += more
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
                [sys.executable, "-m", "clearcap", *map(str, words)],
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
