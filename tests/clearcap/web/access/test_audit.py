"""The audit trail: in order, and with every change of it visible."""

import pytest

from clearcap.web.access.audit import AuditTrail
from clearcap.web.access.database import Database
from clearcap.web.access.throttle import MOST_KEYS, Throttle, place_of


@pytest.fixture
def database(tmp_path):
    made = Database(tmp_path / "service.sqlite")
    yield made
    made.close()


@pytest.fixture
def trail(database):
    made = AuditTrail(database)
    for i in range(5):
        made.add("ada", "session", "127.0.0.1", "POST /api/v1/campaigns", f"demo-{i % 2}", 201)
    return made


def test_newest_first(trail):
    assert [entry.number for entry in trail.newest(count=2)] == [5, 4]
    assert [entry.number for entry in trail.newest(before=4, subject="demo-0")] == [3, 1]
    assert trail.first_fault() is None


@pytest.mark.parametrize(
    ("tampering", "first"),
    [
        ("UPDATE audit SET who = 'eva' WHERE number = 3", 3),
        ("UPDATE audit SET status = 200 WHERE number = 1", 1),
        ("DELETE FROM audit WHERE number = 2", 2),
    ],
)
def test_change_is_found(trail, database, tampering, first):
    with database.write() as connection:
        connection.execute(tampering)
    assert trail.first_fault() == first


def test_throttle():
    now = [0.0]
    throttle = Throttle(3, 60.0, lambda: now[0])
    for _ in range(3):
        assert throttle.wait("eva") == 0.0
        throttle.attempt("eva")
        now[0] += 1.0
    assert throttle.wait("eva", "ada") == 57.0
    assert throttle.wait("ada") == 0.0
    now[0] += 57.0
    assert throttle.wait("eva") == 0.0
    throttle.attempt("eva")
    throttle.succeeded("eva")
    assert throttle.wait("eva") == 0.0


def test_throttle_forgets_the_oldest():
    throttle = Throttle(1, 60.0, lambda: 0.0)
    for i in range(MOST_KEYS + 1):
        throttle.attempt(str(i))
    assert throttle.wait("0") == 0.0
    assert throttle.wait("1") == 60.0


def test_attempts_at_once_count_one_by_one():
    """None passes because the others have not failed yet."""
    throttle = Throttle(3, 60.0, lambda: 0.0)
    assert [throttle.attempt("eva", "place") for _ in range(4)] == [0.0, 0.0, 0.0, 60.0]
    throttle.take_back("place")
    assert throttle.attempt("ada", "place") == 0.0
    assert throttle.attempt("eva") == 60.0


def test_places():
    """An IPv6 host has a whole network of addresses."""
    assert place_of("192.168.1.7") == "192.168.1.7"
    assert place_of("2001:db8::1") == place_of("2001:db8::ffff:1") != place_of("2001:db8:0:1::1")
    assert place_of("testclient") == "testclient"
