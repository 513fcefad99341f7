"""``clearcap serve`` as a process: it ends in order, is alone with its data, and survives guesses and kill -9."""

import signal
import socket
from contextlib import ExitStack
from http.client import HTTPConnection

import httpx
import psutil
import pytest

from campaign.coordinator.submit import submit
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.store.labels import read_labels
from tests.clearcap.web.running import PATIENCE, Served
from tests.until import until

pytestmark = [pytest.mark.slow, pytest.mark.processes]

GUESSES, FIRST = 10_000, 2_000
GROWTH = 8 << 20  # bytes, in which a server may differ after thousands of guesses


@pytest.fixture
def queued(tmp_path, campaign_file):
    """Return the id of a campaign that waits for a coordinator."""
    return submit(open_store(str(tmp_path / "runs")), load_campaign(str(campaign_file)), 10).campaign_id


def test_sigterm_drains(tmp_path, queued):
    """A request at work is answered, streams end, the status says what ended it."""
    with Served(tmp_path, "--no-drive").wait() as server, ExitStack() as stack:
        headers = server.token()
        head = (
            f"PATCH /api/v1/campaigns/{queued}/labels HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        )
        body = b'{"note": "kept"}'
        token = headers["Authorization"]
        upload = stack.enter_context(socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE))
        upload.sendall(f"{head}Authorization: {token}\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body[:5])
        address = f"{server.url}/api/v1/campaigns/{queued}/events"
        stream = stack.enter_context(httpx.stream("GET", address, headers=headers, timeout=PATIENCE))
        events = stream.iter_text()
        while "data: " not in next(events):  # what comes before says only when to ask again
            pass
        server.process.send_signal(signal.SIGTERM)
        list(events)  # to its end, with which the server begins its own: one that is cut off raises
        upload.sendall(body[5:])
        assert upload.recv(1000).startswith(b"HTTP/1.1 200"), server.said()
        assert server.process.wait(PATIENCE) == 143, server.said()
        assert "Traceback" not in server.said()
    assert read_labels(open_store(str(tmp_path / "runs")), queued).note == "kept"


def test_sigterm_ends_the_coordinator(tmp_path):
    with Served(tmp_path, "--workers", "1").wait() as server:
        coordinator = until(lambda: _coordinators(server), server.said)
        server.process.send_signal(signal.SIGTERM)
        assert server.process.wait(PATIENCE) == 143, server.said()
        assert not any(process.is_running() for process in coordinator)


def test_kill_ends_its_processes(tmp_path):
    """Nothing goes on that nobody could stop: the coordinator with its workers, and the processes for jobs."""
    with Served(tmp_path, "--workers", "1").wait() as server:
        until(lambda: _coordinators(server), server.said)
        started = psutil.Process(server.process.pid).children(recursive=True)
        assert len(started) > 2
        server.process.kill()
        server.process.wait()
        until(lambda: not any(map(_lives, started)), lambda: f"{list(filter(_lives, started))}: {server.said()}")


def _lives(process):
    """Return whether a process has not ended; one whose parent has ended may stay as a zombie."""
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def _coordinators(server):
    return [p for p in psutil.Process(server.process.pid).children() if "coordinate" in p.cmdline()]


def test_one_server_for_one_data_folder(tmp_path):
    """The second is told which one is there; after kill -9 the next one begins, and who was logged in still is."""
    with Served(tmp_path, "--no-drive").wait() as first:
        headers = first.token()
        (tmp_path / "second").mkdir()
        with Served(tmp_path / "second", "--no-drive", "--data", str(first.data)) as second:
            assert second.process.wait(PATIENCE) == 2
            assert f"another server uses this folder (process {first.process.pid}, {first.url})" in second.said()
        assert httpx.get(f"{first.url}/api/v1/users", headers=headers, timeout=PATIENCE).status_code == 200
        first.process.kill()
        first.process.wait()
    with Served(tmp_path, "--no-drive").wait() as third:
        assert httpx.get(f"{third.url}/api/v1/users", headers=headers, timeout=PATIENCE).status_code == 200
        assert httpx.get(f"{third.url}/api/v1/audit/check", headers=headers, timeout=PATIENCE).json()["whole"]


def test_ten_thousand_wrong_tokens(tmp_path):
    """They are refused, soon without a look; others are served meanwhile, and nothing is kept of them."""
    with Served(tmp_path, "--no-drive").wait() as server, httpx.Client(base_url=server.url, timeout=PATIENCE) as client:
        connection = HTTPConnection("127.0.0.1", server.port, timeout=PATIENCE)
        headers, statuses, sizes = server.token(), [], []
        for number in range(GUESSES):
            guess = {"Authorization": f"Bearer clearcap_token_{number:043d}"}
            connection.request("GET", "/api/v1/campaigns", headers=guess)
            answer = connection.getresponse()
            answer.read()
            statuses.append(answer.status)
            if number % 500 == 0:
                assert client.get("/api/v1/campaigns", headers=headers).status_code == 200
            if number in (FIRST, GUESSES - 1):
                sizes.append(server.memory())
        connection.close()
        assert set(statuses) == {401, 429}
        assert statuses.count(401) < 100
        assert sizes[1] - sizes[0] < GROWTH, sizes
        assert len(client.get("/api/v1/audit", headers=headers).json()["entries"]) < 100
