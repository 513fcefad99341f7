"""Streams of events as they are open for long: how many a user may have, and that they end with his login."""

import asyncio

import httpx2 as httpx
import pytest

from campaign.coordinator.submit import submit
from campaign.store import open_store
from clearcap.web import watcher
from clearcap.web.settings import Limits, Settings
from tests.clearcap.web.running import PATIENCE, in_a_thread
from tests.until import until

pytestmark = pytest.mark.processes

MOST, AT_ONCE = 2, 12


@pytest.fixture
def followed(tmp_path, campaign, monkeypatch):
    """Return a service on a port, its address, and the path of the events of a campaign that waits."""
    monkeypatch.setattr(watcher, "KEEP_ALIVE", 0.1)
    plan = submit(open_store(str(tmp_path / "runs")), campaign, 10)
    settings = Settings(str(tmp_path / "runs"), tmp_path / "data", processes=0, limits=Limits(streams=MOST))
    with in_a_thread(settings) as (service, port):
        yield service, f"http://127.0.0.1:{port}", f"/api/v1/campaigns/{plan.campaign_id}"


def test_many_at_once_are_bounded(followed):
    """Those that come at the same moment count, too; and none counts that was closed."""
    service, url, home = followed
    _, secret = service.tokens.add("viewer", "test", service.users.get("viewer").role, 3600.0)

    async def statuses():
        async def first_line(port):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            head = f"GET {home}/events HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {secret}\r\n\r\n"
            writer.write(head.encode())
            return await reader.readline(), writer

        port = int(url.rpartition(":")[2])
        answers = await asyncio.gather(*(first_line(port) for _ in range(AT_ONCE)))
        for _, writer in answers:
            writer.close()
        return [int(line.split()[1]) for line, _ in answers]

    assert sorted(asyncio.run(statuses())) == [200] * MOST + [429] * (AT_ONCE - MOST)
    until(lambda: not service.streams["viewer"], lambda: service.streams)


def test_a_stream_ends_with_its_login(followed):
    """Whoever follows by a link that is revoked hears no more of the campaign."""
    service, url, home = followed
    share, secret = service.tokens.share(home.rpartition("/")[2], "engineer", "", 3600.0)
    headers = {"Authorization": f"Bearer {secret}"}
    with httpx.stream("GET", f"{url}{home}/events", headers=headers, timeout=PATIENCE) as stream:
        lines = stream.iter_lines()
        until(lambda: next(lines).startswith("data: "), "the first event")
        assert service.tokens.revoke_share(share.campaign, share.id)
        assert "event: end" not in list(lines)
    assert httpx.get(f"{url}{home}", headers=headers, timeout=PATIENCE).status_code == 401
