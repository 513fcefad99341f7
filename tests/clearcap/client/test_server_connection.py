"""A connection sends again what does no harm, and gives no token away: not to another place, not without TLS."""

import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from campaign.errors import CampaignError, SpecError, StoreError
from clearcap.client.remote_server import RemoteServer, events_in
from clearcap.client.server_connection import ServerConnection, checked_address, checked_token
from tests.each import each

CUT_OFF = 206  # less comes than is announced


@contextmanager
def answering(answers):
    """Answer requests one after the other, each with (status, headers, body); yield address and what was asked."""
    left, asked = list(answers), []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append((self.path, dict(self.headers)))
            status, headers, body = left.pop(0)
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(body) + (status == CUT_OFF)))
            self.end_headers()
            self.wfile.write(body)
            self.close_connection = True

        do_POST = do_GET

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}", asked
        finally:
            server.shutdown()
            thread.join()


@pytest.fixture
def pauses(monkeypatch):
    """Return the list of pauses, none of which is waited for."""
    waited = []
    monkeypatch.setattr("clearcap.client.server_connection.time.sleep", waited.append)
    return waited


@pytest.mark.processes
def test_questions_are_asked_again(pauses):
    answers = [(503, {"Retry-After": "7"}, b""), (429, {}, b""), (200, {}, b"{}")]
    with answering(answers) as (address, asked), ServerConnection(address, "t") as connection:
        assert connection.get("/x").json() == {}
    assert len(asked) == 3
    assert pauses[0] == 7.0
    assert 0.5 < pauses[1] < 2.0


@pytest.mark.processes
def test_other_requests_are_sent_once(pauses):
    with answering([(503, {}, b"")]) as (address, asked), ServerConnection(address, "t") as connection:
        with pytest.raises(StoreError):
            connection.ask("POST", "/x")
        assert len(asked) == 1
    assert pauses == []


@pytest.mark.processes
def test_what_is_wrong_is_not_asked_again(pauses):
    answers = [(422, {}, b'{"detail": "no such key", "faults": [{"keys": ["a"], "text": "wrong", "line": 3}]}')]
    with answering(answers) as (address, asked), ServerConnection(address, "t") as connection:
        with pytest.raises(SpecError, match="no such key") as refused:
            connection.get("/x")
        assert len(asked) == 1
    (fault,) = refused.value.faults
    assert (fault.keys, fault.text, fault.line) == (("a",), "wrong", 3)


@pytest.mark.processes
def test_another_address_gets_no_token(pauses):
    with answering([]) as (other, elsewhere), answering([(307, {"Location": f"{other}/x"}, b"")]) as (address, _):
        with ServerConnection(address, "t") as connection, pytest.raises(SpecError, match="another address"):
            connection.get("/x")
        assert elsewhere == []


@pytest.mark.processes
@pytest.mark.parametrize(("status", "kind"), [(409, CampaignError), (401, SpecError), (500, StoreError)])
def test_kinds_of_errors(pauses, status, kind):
    with answering([(status, {}, b"not json")]) as (address, _), ServerConnection(address, "t") as connection:
        with pytest.raises(CampaignError) as refused:
            connection.ask("POST", "/x")
        assert type(refused.value) is kind


@pytest.mark.processes
def test_no_proxy_of_the_environment_reads_what_goes_to_this_machine(pauses, monkeypatch):
    with answering([]) as (proxy, seen), answering([(200, {}, b"{}")]) as (address, asked):
        monkeypatch.setenv("HTTP_PROXY", proxy)
        monkeypatch.setenv("http_proxy", proxy)
        with ServerConnection(address, "t") as connection:
            connection.get("/x")
        assert (len(seen), len(asked)) == (0, 1)


@pytest.mark.processes
def test_events_continue_after_the_last_one_seen(pauses):
    first = b'retry: 2000\n\nid: a\nevent: progress\ndata: {"n": 1}\n\nid: b\nevent: progress\ndata: {"n"'
    rest = b': still here\n\nid: b\nevent: progress\ndata: {"n":\ndata: 2}\n\nevent: end\ndata: {}\n\n'
    answers = [(CUT_OFF, {}, first), (502, {}, b""), (200, {}, rest)]
    with answering(answers) as (address, asked), ServerConnection(address, "t") as connection:
        assert list(RemoteServer(connection).events("c-1")) == [{"n": 1}, {"n": 2}]
    assert [headers.get("Last-Event-ID") for _, headers in asked] == [None, "a", "a"]


def test_an_event_of_several_lines():
    (event,) = events_in(["id:1", "event: x", "data: a", "data: b", "", "data: cut off"])
    assert (event.id, event.kind, event.data) == ("1", "x", "a\nb")


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("https://clearcap.example/", "https://clearcap.example"),
        ("https://clearcap.example:8443", "https://clearcap.example:8443"),
        ("http://127.0.0.1:8700", "http://127.0.0.1:8700"),
        ("http://localhost:8700", "http://localhost:8700"),
        ("http://[::1]:8700/", "http://[::1]:8700"),
    ],
)
def test_addresses(url, address):
    assert checked_address(url) == address


@each(
    ("url", "fault"),
    [
        ("http://clearcap.example", "over http others read the token"),
        ("http://127.0.0.1.example", "over http others read the token"),
        ("http://10.0.0.1:8700", "over http others read the token"),
        ("https://eva:pass@clearcap.example", "holds more than a host"),
        ("https://clearcap.example/?token=secret", "holds more than a host"),
        ("ftp://clearcap.example", "not the address of a server"),
        ("clearcap.example", "not the address of a server"),
        ("https://clearcap.example/api", "not the address of a server"),
        ("https://clearcap.example:port", "not an address"),
    ],
)
def test_refused_addresses(url, fault):
    with pytest.raises(SpecError, match=fault) as refused:
        checked_address(url)
    assert "pass" not in str(refused.value)
    assert "secret" not in str(refused.value)


def test_tokens(monkeypatch):
    monkeypatch.delenv("CLEARCAP_TOKEN", raising=False)
    with pytest.raises(SpecError, match="CLEARCAP_TOKEN"):
        checked_token(None)
    monkeypatch.setenv("CLEARCAP_TOKEN", "clearcap_token_1\n")
    assert checked_token(None) == "clearcap_token_1"
    with pytest.raises(SpecError, match="copy it once more") as refused:
        checked_token("clearcap_token_ä")
    assert "ä" not in str(refused.value)
