"""Other systems are told once, signed, and again until they take it; never into the server's own network unasked."""

import asyncio
import hashlib
import hmac
import json
import socket
import sqlite3
import threading
from contextlib import contextmanager
from datetime import UTC, datetime
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from campaign.errors import SpecError
from clearcap.web import webhooks as targets
from clearcap.web.access import Role
from clearcap.web.access.database import SCHEMA, Database
from clearcap.web.access.users import Users
from clearcap.web.index import BelowTarget, CampaignEntry
from clearcap.web.webhooks import (
    MOST_ATTEMPTS,
    WebhookRepository,
    WebhookSender,
    campaign_events,
    is_public,
    target_addresses,
    webhook_target,
)
from tests.each import each


def ended(state="completed", **more):
    """Return the entry of a campaign of eva's that has ended."""
    given = {"campaign": "c60-1", "state": state, "since": datetime(2026, 11, 23, tzinfo=UTC), "owner": "eva"}
    return CampaignEntry(**{**given, "has_report": True, **more})


NOW = 1.8e9  # s since 1970


def news_of(*entries, now=NOW):
    return [news for entry in entries for news in campaign_events(entry, "https://clearcap.example", now)]


@pytest.fixture
def database(tmp_path):
    opened = Database(tmp_path / "service.sqlite")
    for name in ("eva", "bob"):
        Users(opened).add(name, Role.ENGINEER)
    yield opened
    opened.close()


@pytest.fixture
def now():
    """Return the time of a book and of what sends its news, which a test moves [s since 1970]."""
    return [NOW]


@pytest.fixture
def book(database, now):
    return WebhookRepository(database, lambda: now[0])


@contextmanager
def receiver(*statuses):
    """Take what is posted, with these statuses one after the other; yield its port and what came."""
    left, came = list(statuses), []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self):
            body = self.rfile.read(int(self.headers["Content-Length"]))
            came.append((self.path, dict(self.headers), body))
            self.send_response(left.pop(0) if left else 200)
            self.send_header("Location", "http://127.0.0.1:1/")
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield server.server_port, came
        finally:
            server.shutdown()
            thread.join()


def send_all(book, news=(), allowed=("localhost",)):
    """Tell news, and make one attempt at whatever is due."""
    sender = WebhookSender(book, lambda: news, allowed, book._clock)
    sender.enqueue()
    for webhook, delivery in book.due(100):
        asyncio.run(sender._attempt(webhook, delivery))


@pytest.mark.processes
def test_the_end_is_told_signed_and_once(book):
    with receiver() as (port, came):
        webhook = book.add("eva", None, f"http://localhost:{port}/hook?x=1", [])
        send_all(book, news_of(ended(), ended("running", campaign="c60-2")))
        send_all(book, news_of(ended()))
        send_all(WebhookRepository(book._database, book._clock), news_of(ended()))  # another start of the server
    ((path, headers, body),) = came
    assert (path, headers["Host"]) == ("/hook?x=1", f"localhost:{port}")
    document = json.loads(body)
    assert (document["event"], document["campaign"], document["state"]) == ("campaign.ended", "c60-1", "completed")
    assert document["link"] == "https://clearcap.example/campaigns/c60-1"
    stamp, _, given = headers["X-Clearcap-Signature"].removeprefix("t=").partition(",v1=")
    assert int(stamp) == NOW
    assert given == hmac.new(webhook.secret.encode(), f"{stamp}.".encode() + body, hashlib.sha256).hexdigest()
    assert [delivery.status for delivery in book.deliveries(webhook.id)] == ["delivered"]


@pytest.mark.parametrize("state", ["failed", "cancelled", "interrupted"])
def test_other_ends(state):
    assert [news.content["state"] for news in news_of(ended(state, has_report=False))] == [state]


def test_a_completed_campaign_waits_for_its_report():
    new = ended(since=datetime.fromtimestamp(NOW, UTC), has_report=False)
    assert news_of(new, now=NOW + 599.0) == []
    assert news_of(new, now=NOW + 601.0) != []
    assert news_of(new.model_copy(update={"message": "no report: the disk is full"})) != []


def test_a_small_cpk_is_told_once_a_response(book):
    low = BelowTarget(response="FC-1", cpk=1.2, interval=(1.1, 1.3), target=1.33)
    again = ended(since=datetime(2026, 11, 24, tzinfo=UTC), below_target=[low])
    webhook = book.add("eva", None, "https://quality.example", [])
    book.enqueue(news_of(ended(below_target=[low])))
    book.enqueue(news_of(again))
    events = [delivery.event.split()[0] for delivery in book.deliveries(webhook.id)]
    assert sorted(events) == ["below", "ended", "ended"]


def test_who_is_told(book):
    mine = book.add("eva", None, "https://a.example", [])
    others = book.add("bob", None, "https://b.example", [])
    of_one = book.add("bob", "c60-1", "https://c.example", [])
    late = book.add("eva", None, "https://d.example", news_of(ended()))
    book.enqueue(news_of(ended(), ended(campaign="c60-2")))
    told = {w.id: [d.event.split()[1] for d in book.deliveries(w.id)] for w in (mine, others, of_one, late)}
    assert told == {mine.id: ["c60-2", "c60-1"], others.id: [], of_one.id: ["c60-1"], late.id: ["c60-2"]}


def test_no_number_is_given_twice(book):
    """A receiver knows news by it: those of a new webhook would be those of the deleted one, which it has had."""
    first = book.add("eva", None, "https://example.com/a", [])
    book.remove(first.id)
    assert book.add("eva", None, "https://example.com/a", []).id > first.id


def test_earlier_tables_keep_webhooks_and_deliveries(tmp_path):
    """The file of a server before numbers were kept; it knows the numbers that are in use."""
    path = tmp_path / "earlier.sqlite"
    earlier = sqlite3.connect(path, isolation_level=None)
    earlier.executescript(
        f"""{SCHEMA}
        INSERT INTO users (name, role, created) VALUES ('eva', 'engineer', 0.0);
        INSERT INTO webhooks VALUES (7, 'eva', NULL, 'https://example.com/a', 'secret', 0.0);
        INSERT INTO deliveries VALUES (3, 7, 'ended', '{{}}', 0, 1.0, 'waiting');
        PRAGMA user_version = 1;"""
    )
    earlier.close()
    for _ in range(2):
        database = Database(path)
        book = WebhookRepository(database)
        assert [(each.id, each.user) for each in book.all()] == [(7, "eva")]
        assert [(each.id, each.webhook) for each in book.deliveries(7)] == [(3, 7)]
        assert database.rows("PRAGMA foreign_key_check") == []
        database.close()
    database = Database(path)
    book = WebhookRepository(database)
    book.remove(7)
    assert database.rows("SELECT * FROM deliveries") == [], "they go with their webhook"
    assert book.add("eva", None, "https://example.com/b", []).id == 8
    database.close()


def test_nothing_is_sent_for_a_disabled_user(book, database):
    book.add("eva", None, "https://a.example", [])
    book.enqueue(news_of(ended()))
    assert len(book.due(10)) == 1
    with database.write() as connection:
        connection.execute("UPDATE users SET disabled = 1")
    assert book.due(10) == []


@pytest.mark.processes
def test_it_is_sent_again_until_it_is_taken(book, now):
    with receiver(500, 302) as (port, came):
        webhook = book.add("eva", None, f"http://localhost:{port}/", [])
        send_all(book, news_of(ended()))
        (waiting,) = book.deliveries(webhook.id)
        assert (waiting.status, waiting.attempts) == ("answered with status 500", 1)
        assert waiting.next == NOW + 10.0
        now[0] = NOW + 9.9
        send_all(book)  # too early
        assert len(came) == 1
        now[0] = NOW + 10.0
        send_all(book)  # a redirection is not followed
        now[0] = NOW + 30.0
        send_all(book)
    (delivered,) = book.deliveries(webhook.id)
    assert (delivered.status, delivered.attempts, delivered.next, len(came)) == ("delivered", 3, None, 3)


def test_it_is_given_up_after_a_day(book, now):
    webhook = book.add("eva", None, "https://a.example", [])
    book.enqueue(news_of(ended()))
    for _ in range(MOST_ATTEMPTS):
        (delivery,) = book.deliveries(webhook.id)
        assert delivery.next is not None
        now[0] = delivery.next
        book.record(delivery, "cannot be reached")
    (delivery,) = book.deliveries(webhook.id)
    assert (delivery.status, delivery.next) == ("given up: cannot be reached", None)
    assert 20 * 3600 < now[0] - NOW < 28 * 3600
    book.remove(webhook.id)
    assert book.deliveries(webhook.id) == []


# -- where it may be sent ----------------------------------------------------------------------------------------------


@each(
    "address",
    [
        *("127.0.0.1", "10.1.2.3", "172.16.0.1", "192.168.1.1", "169.254.169.254", "100.64.0.1", "0.0.0.0"),
        *(
            "224.0.0.1",
            "255.255.255.255",
            "::1",
            "::",
            "fe80::1",
            "fe80::1%eth0",
            "fc00::1",
            "fd00:ec2::254",
            "ff02::1",
        ),
        *("::ffff:10.0.0.1", "64:ff9b::a00:1", "2002:a00:1::", "2001:0:a00:1::", "nonsense"),
        *("192.88.99.1", "3fff::1"),
    ],
)
def test_networks_that_are_not_public(address):
    assert not is_public(address)


@pytest.mark.parametrize("address", ["93.184.216.34", "2606:2800:220:1::1", "::ffff:93.184.216.34"])
def test_public_addresses(address):
    assert is_public(address)


@each(
    "url",
    [
        *("http://quality.example/", "ftp://quality.example/", "https://", "https://eva:x@quality.example/", "quality"),
        *(
            "https://quality.example/#x",
            "https://quality.example/ä",
            "https://quality.example:99999/",
            "http://10.0.0.1/",
        ),
        "http://mes.plant/",  # allowed, but no loopback
        *("https://quality.example:22/", "https://quality.example:0/", "https://mes.plant:0/"),
    ],
)
def test_refused_urls(url):
    with pytest.raises(SpecError, match="url"):
        webhook_target(url, ["mes.plant"])


def test_ports():
    """443, and what an admin has named the host for."""
    for url, port in (
        ("https://quality.example:443/", 443),
        ("https://mes.plant:8443/", 8443),
        ("https://mes.plant", 443),
    ):
        assert webhook_target(url, ["mes.plant"]).port == port


@pytest.mark.parametrize("host", ["127.0.0.1", "[::1]", "2130706433", "0x7f.1", "localhost", "metadata.plant"])
def test_the_own_network_is_refused_unless_named(host, monkeypatch):
    real = socket.getaddrinfo
    fake = lambda name, *rest, **more: real("169.254.169.254" if name == "metadata.plant" else name, *rest, **more)  # noqa: E731
    monkeypatch.setattr(targets.socket, "getaddrinfo", fake)
    with pytest.raises(SpecError, match="own network"):
        target_addresses(webhook_target(f"https://{host}/", []))
    assert target_addresses(webhook_target(f"https://{host}/", [host.strip("[]")]))


def test_a_name_that_changes_its_address_is_refused_when_it_is_sent(book, monkeypatch):
    """A check when the webhook is made does not suffice: the address is looked up, checked and used once each time."""
    webhook = book.add("eva", None, "https://rebound.example/", [])
    monkeypatch.setattr(targets.socket, "getaddrinfo", lambda *_, **__: [(2, 1, 6, "", ("127.0.0.1", 443))])
    send_all(book, news_of(ended()))
    assert "own network" in book.deliveries(webhook.id)[0].status


# -- over the API ------------------------------------------------------------------------------------------------------


def test_calls(client, as_user, service):
    eva = as_user("engineer")
    refused = client.post("/api/v1/webhooks", json={"url": "https://127.0.0.1/"}, headers=eva)
    assert (refused.status_code, "own network" in refused.json()["detail"]) == (422, True)
    made = service.webhooks.add("engineer", None, "https://quality.example/", [])
    listed = client.get("/api/v1/webhooks", headers=eva).json()
    assert [(each["id"], each["url"]) for each in listed] == [(made.id, made.url)]
    assert made.secret not in json.dumps(listed)
    assert client.get("/api/v1/webhooks", headers=as_user("approver")).json() == []
    assert client.get(f"/api/v1/webhooks/{made.id}", headers=as_user("approver")).status_code == 404
    assert client.get(f"/api/v1/webhooks/{made.id}", headers=eva).json()["deliveries"] == []
    assert client.delete(f"/api/v1/webhooks/{made.id}", headers=eva).status_code == 204
    assert client.get(f"/api/v1/webhooks/{made.id}", headers=eva).status_code == 404


def test_a_webhook_is_made_with_its_secret_shown_once(client, as_user, monkeypatch):
    monkeypatch.setattr(targets.socket, "getaddrinfo", lambda *_, **__: [(2, 1, 6, "", ("93.184.216.34", 443))])
    answer = client.post("/api/v1/webhooks", json={"url": "https://quality.example/"}, headers=as_user("engineer"))
    assert answer.status_code == 201
    assert answer.json()["secret"].startswith("clearcap_webhook_")
    unknown = {"url": "https://quality.example/", "campaign": "c60-nothing"}
    assert client.post("/api/v1/webhooks", json=unknown, headers=as_user("engineer")).status_code == 422
