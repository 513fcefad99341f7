"""What every request passes: host names, sizes, headers, problem details."""

from asyncio import sleep, to_thread
from inspect import getsource

import pytest
from starlette.testclient import TestClient

from clearcap.web.http.request_limits import (
    LARGEST_DOCUMENT,
    LARGEST_OPEN_FORM,
    MOST_VALUES,
    UPLOADS,
    RequestLimits,
    check_values,
    takes_files,
)
from clearcap.web.http.responses import MEDIA_TYPE, Refusal
from clearcap.web.settings import Limits
from tests.clearcap.web.routes import all_ways

FILES = "PostedCampaign", "_sent(request)", "upload_step", "limits: UploadFile"  # what reads files that may be large


async def _echo(scope, receive, send):
    """Answer with the length of the body."""
    size, more = 0, True
    while more:
        message = await receive()
        size, more = size + len(message.get("body", b"")), message.get("more_body", False)
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": str(size).encode()})


def _client(**limits):
    return TestClient(
        RequestLimits(_echo, ["clearcap.example"], Limits(**limits), secure=True), base_url="https://localhost"
    )


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1:8700", "[::1]:8700", "CLEARCAP.example:443"])
def test_own_host(host):
    assert _client().get("/", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example", "", "localhost:x", "localhost@evil", "a b", "localhost, evil"]
)
def test_other_host_is_refused(host):
    answer = _client().get("/", headers={"Host": host})
    assert answer.status_code == 421
    assert answer.headers["content-type"] == MEDIA_TYPE
    assert answer.json()["title"] == "Misdirected Request"


def test_headers_of_every_answer(client):
    for path in ("/healthz", "/login", "/nowhere", "/static/pages.css", "/api/v1/openapi.json"):
        headers = client.get(path).headers
        assert headers["content-security-policy"].startswith("default-src 'none'; script-src 'self';"), path
        assert headers["x-content-type-options"] == "nosniff"
        assert "server" not in headers
    assert "strict-transport-security" in _client().get("/").headers


def test_body_may_be_as_long_as_allowed():
    client = _client(body=1000)
    assert client.post("/", content=b"x" * 1000).text == "1000"
    answer = client.post("/", content=b"x" * 1001)
    assert (answer.status_code, answer.headers["connection"]) == (413, "close")


def test_body_without_length_is_counted():
    answer = _client(body=1000).post("/", content=(b"x" * 100 for _ in range(11)))
    assert answer.status_code == 413


def test_only_files_may_be_large():
    """What strangers send, and what is parsed at once, has limits of its own; with a length in its head or without."""
    client = _client()
    for path, most in (("/login", LARGEST_OPEN_FORM), ("/api/v1/simulations", LARGEST_DOCUMENT)):
        assert client.post(path, content=b"x" * most).text == str(most)
        for content in (b"x" * (most + 1), (b"x" * 1024 for _ in range(most // 1024 + 1))):
            answer = client.post(path, content=content)
            assert (answer.status_code, answer.headers["connection"]) == (413, "close")
            assert str(most) in answer.json()["detail"]
    for kind, status in (("multipart/form-data; boundary=x", 200), ("application/json", 413)):
        large = client.post(UPLOADS[0], content=b"x" * (LARGEST_DOCUMENT + 1), headers={"Content-Type": kind})
        assert large.status_code == status


def test_bodies_at_work_are_bounded_together():
    """Those of one address to a quarter, or to the largest that one may send; room is there again after the answer."""

    async def nested(scope, receive, send):
        """Ask another request with the same limits while this one is at work."""
        if scope["path"] != "/inner":
            content = b"x" * int(dict(scope["headers"])[b"inner"])
            client = TestClient(limits, base_url="https://localhost", client=(f"10.0.0.{scope['path'][1:]}", 1))
            await _echo(scope, receive, lambda message: sleep(0))
            inner = await to_thread(client.post, "/inner", content=content)
            assert inner.status_code != 503 or int(inner.headers["retry-after"]) > 0
            await send({"type": "http.response.start", "status": inner.status_code, "headers": []})
            await send({"type": "http.response.body", "body": b""})
        else:
            await _echo(scope, receive, send)

    limits = RequestLimits(nested, [], Limits(body=100, bodies=190), secure=False)
    client = TestClient(limits, base_url="https://localhost", client=("10.0.0.1", 1))

    def asked(inner, place):
        return client.post(f"/{place}", content=b"x" * 90, headers={"inner": str(inner)}).status_code

    for _ in range(3):
        assert [asked(10, 1), asked(11, 1), asked(100, 2), asked(101, 2)] == [200, 503, 200, 413]
    limits._limits = Limits(body=100, bodies=189)
    assert asked(100, 2) == 503


def test_values_of_a_document_are_counted_before_they_are_made():
    """What is in a text, as escaped quotes are, is none."""
    many, quote, backslashes = b"{}," * MOST_VALUES, rb"\"", rb"\\\\"
    for document in (
        b"[%s{}]" % many,
        b'["%s",%s{}]' % (backslashes, many),
        b"[" * (MOST_VALUES + 1),
        b'{"a":%s' % (b"[1," * MOST_VALUES),
    ):
        with pytest.raises(Refusal) as refused:
            check_values(document)
        assert refused.value.status == 413
    for text in (many, quote + many, backslashes + quote + many):
        check_values(b'["%s"]' % text)
    check_values(b"[1" + b",1" * (MOST_VALUES - 2) + b"]")


def test_every_call_counts_the_values(client, as_user):
    """Also one that reads the document itself."""
    engineer = {**as_user("engineer"), "Content-Type": "application/json"}
    content = b'{"text": [%s{}]}' % (b"{}," * MOST_VALUES)
    for path in ("/checks/campaign", "/campaigns", "/checks/mechanism", "/simulations", "/campaigns/c60-1/rerun"):
        assert client.post(f"/api/v1{path}", content=content, headers=engineer).status_code == 413, path


def test_each_call_with_files_may_be_large():
    """A route that reads files beside a text is listed, and none that is gone."""
    ways = [way for way in all_ways() if way.is_write]
    with_files = {way.path for way in ways if any(word in getsource(way.route.endpoint) for word in FILES)}
    assert with_files == {way.path for way in ways if takes_files(way.path)}
    assert set(UPLOADS) < with_files


@pytest.mark.parametrize("length", ["-1", "abc", "9" * 500])
def test_odd_length_is_refused(length):
    assert _client().post("/", content=b"x", headers={"Content-Length": length}).status_code == 413
