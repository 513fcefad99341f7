"""What one engineer with a token sends to stop the server: it goes on answering, and its memory is bounded."""

import asyncio
import json
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest

from clearcap.web import web_service
from clearcap.web.access import Role
from clearcap.web.http.request_limits import LARGEST_DOCUMENT, MOST_VALUES
from clearcap.web.settings import Limits, Settings
from tests.clearcap.web.running import PATIENCE, Served, in_a_thread
from tests.until import until

pytestmark = [pytest.mark.slow, pytest.mark.processes]

MIB = 1 << 20
BOMB = b"[" + b"{}," * 20_000_000 + b"{}]"  # 60 MB, which took 2.4 GB once it was parsed
DENSE = b"[" + b"1," * (MOST_VALUES - 2) + b"1]"
TEXT = json.dumps({"text": "a" * (LARGEST_DOCUMENT - 100)}).encode()
PATHS = ("/api/v1/checks/campaign", "/api/v1/campaigns", "/api/v1/checks/mechanism", "/api/v1/simulations")


def pieces(content):
    """Yield a content in pieces, so that nobody knows its length beforehand."""
    for begin in range(0, len(content), MIB):
        yield content[begin : begin + MIB]


def attack(address, headers, number):
    """Send one request of the attack; return the status of its answer, None if the connection was cut."""
    as_json = {**headers, "Content-Type": "application/json"}
    path = PATHS[number % len(PATHS)]
    with httpx.Client(base_url=address, timeout=PATIENCE) as client:
        try:
            if number % 5 == 4:
                files = {"campaign": b"format = 1", "files": ("big.csv", b"1,2\n" * (12 * MIB))}
                return client.post(PATHS[number % 2], files=files, headers=headers).status_code
            content = (BOMB, pieces(BOMB), BOMB[: LARGEST_DOCUMENT - 2] + b"1]", (DENSE, TEXT)[number // 5 % 2])[
                number % 5
            ]
            return client.post(path, content=content, headers=as_json).status_code
        except httpx.TransportError:  # the server closed it while it was being sent
            return None


@pytest.fixture
def engineer(tmp_path):
    """Return a server in a process of its own, and headers of an engineer."""
    config = tmp_path / "serve.toml"
    config.write_text("[limits]\njob_seconds = 20\n")
    with Served(tmp_path, "--no-drive", "--config", config).wait() as server:
        yield server, server.token("engineer")


def test_memory_and_health(engineer):
    """Every health question is answered, memory stays within the sum that is configured, and most of it comes back."""
    server, headers = engineer
    for number in range(10):  # with what each request takes once
        attack(server.url, headers, number)
    before, most, answered, over = server.memory(), 0, 0, threading.Event()
    with ThreadPoolExecutor(8) as pool:

        def keep_asking():
            nonlocal most, answered
            with httpx.Client(base_url=server.url, timeout=PATIENCE) as client:
                while not over.is_set():
                    assert client.get("/healthz").status_code == 200
                    most, answered = max(most, server.memory()), answered + 1

        asking = pool.submit(keep_asking)
        statuses = set(pool.map(lambda number: attack(server.url, headers, number), range(60)))
        over.set()
        asking.result()
    assert answered
    assert 500 not in statuses
    assert statuses <= {413, 422, 429, 503, None}
    assert most - before < Limits().bodies // 4
    until(lambda: server.memory() < 1.2 * before, lambda: f"{server.memory() / before:.2f} of before", 60.0)


class TimedTurns:
    """An event loop of Python's own that notes the processor time of each of its turns, in `seconds`."""

    def __init__(self, patch):
        self.seconds, run = [], asyncio.Handle._run

        def timed(handle):
            begin = time.thread_time()
            run(handle)
            self.seconds.append(time.thread_time() - begin)

        patch.setattr(asyncio.Handle, "_run", timed)

    loop = staticmethod(asyncio.new_event_loop)

    def release(self):
        """Do nothing: its clock is the usual one."""


def test_no_turn_of_the_loop_is_long(tmp_path, monkeypatch):
    """None takes more processor time than it takes to parse a document of 2 MiB some times."""
    monkeypatch.setattr(web_service, "warm_up_try_out", None)
    settings = Settings(str(tmp_path / "runs"), tmp_path / "data", processes=1)
    begin = time.thread_time()
    json.loads(b"[" + b"{}," * (LARGEST_DOCUMENT // 3 - 2) + b"{}]")
    parse = time.thread_time() - begin
    turns = TimedTurns(monkeypatch)
    with in_a_thread(settings, turns) as (service, port):
        _, secret = service.tokens.add("engineer", "test", Role.ENGINEER, 3600.0)
        headers = {"Authorization": f"Bearer {secret}"}
        for number in range(10):
            attack(f"http://127.0.0.1:{port}", headers, number)
    assert len(turns.seconds) > 100
    assert max(turns.seconds) < 5.0 * parse + 0.2
