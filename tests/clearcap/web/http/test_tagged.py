"""ETags and ranges of answers."""

import pytest
from starlette.applications import Starlette
from starlette.routing import Route
from starlette.testclient import TestClient

from clearcap.web.http.responses import ETAG_STATUSES, etag_response
from tests.clearcap.web.routes import all_ways

BODY = bytes(range(100))


@pytest.fixture(scope="module")
def client():
    async def answer(request):
        return etag_response(request, BODY, "application/octet-stream")

    return TestClient(Starlette(routes=[Route("/", answer)]))


def test_who_has_it_gets_nothing(client):
    tag = client.get("/").headers["etag"]
    for known in (tag, f'"x", {tag}', f"W/{tag}", "*"):
        answer = client.get("/", headers={"If-None-Match": known})
        assert (answer.status_code, answer.content) == (304, b"")
    assert client.get("/", headers={"If-None-Match": '"other"'}).content == BODY


@pytest.mark.parametrize(
    ("wanted", "part"),
    [("bytes=0-9", BODY[:10]), ("bytes=90-", BODY[90:]), ("bytes=-5", BODY[-5:]), ("bytes=95-200", BODY[95:])],
)
def test_part(client, wanted, part):
    answer = client.get("/", headers={"Range": wanted})
    assert (answer.status_code, answer.content) == (206, part)
    begin = BODY.index(part)
    assert answer.headers["content-range"] == f"bytes {begin}-{begin + len(part) - 1}/100"


@pytest.mark.parametrize("wanted", ["bytes=-", "bytes=a-b", "lines=0-9", "bytes=0-1,4-5"])
def test_odd_range_is_no_range(client, wanted):
    assert client.get("/", headers={"Range": wanted}).content == BODY


@pytest.mark.parametrize("wanted", ["bytes=100-", "bytes=9-3", "bytes=-0"])
def test_part_that_is_not_there(client, wanted):
    answer = client.get("/", headers={"Range": wanted})
    assert (answer.status_code, answer.headers["content-range"]) == (416, "bytes */100")


def test_part_of_another_version(client):
    assert client.get("/", headers={"Range": "bytes=0-9", "If-Range": '"other"'}).content == BODY


def test_drawing_by_itself_has_its_styles():
    """As a page of its own it would lose them by the policy of the pages; it runs and loads nothing."""

    async def drawing(request):
        return etag_response(request, b"<svg/>", "image/svg+xml")

    policy = TestClient(Starlette(routes=[Route("/", drawing)])).get("/").headers["content-security-policy"]
    assert {"sandbox", "default-src 'none'", "style-src 'unsafe-inline'"} <= set(policy.split("; "))


def test_parts_are_documented():
    """Of each call that promises an ETag, but of rows, which are written while they are sent."""
    ways = [way for way in all_ways() if 304 in way.route.responses]
    assert len(ways) > 10
    without = {way.path for way in ways if not set(ETAG_STATUSES) <= way.route.responses.keys()}
    assert without == {"/api/v1/campaigns/{campaign}/rows"}
