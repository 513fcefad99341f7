"""Answers within a size, and computations that are shared."""

import asyncio

import pytest

from clearcap.web.jobs.pool import Busy
from clearcap.web.jobs.queries import ResponseCache, SingleFlight


def test_answers_stay_within_their_size():
    """The one that was not asked for longest goes; one that is too large alone is not kept."""
    kept = ResponseCache(3 * 1500)
    for name in "abc":
        kept.put(name, name.encode() * 1000)
    assert kept.get("a") == b"a" * 1000
    kept.put("d", b"d" * 1000)
    assert kept.get("b") is None
    kept.put("a", b"A" * 1000)
    assert [kept.get(name) is not None for name in "acd"] == [True] * 3
    kept.put("e", b"e" * 9000)
    assert [kept.get(name) for name in "acde"] == [None] * 4
    kept.put("f", b"f" * 1000)
    assert kept.get("f") == b"f" * 1000


def test_an_error_is_everybodys_and_is_not_kept():
    """Who asks later computes anew."""
    outcomes = iter([ValueError("no"), b"yes"])

    async def compute():
        await asyncio.sleep(0)
        outcome = next(outcomes)
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    async def ask():
        flights = SingleFlight()
        both = await asyncio.gather(*(flights.once("k", compute) for _ in range(2)), return_exceptions=True)
        assert [str(each) for each in both] == ["no", "no"]
        assert await flights.once("k", compute) == b"yes"

    asyncio.run(ask())


def test_that_another_is_busy_is_no_reason():
    """Who shares a computation that may not wait tries his own."""
    shared = asyncio.Event()

    async def busy():
        await shared.wait()
        raise Busy("2 jobs of a wait", 3)

    async def compute():
        return b"yes"

    async def ask():
        flights = SingleFlight()
        first = asyncio.create_task(flights.once("k", busy))
        await asyncio.sleep(0)
        second = asyncio.create_task(flights.once("k", compute))
        await asyncio.sleep(0)
        assert not second.done()
        shared.set()
        with pytest.raises(Busy):
            await first
        assert await second == b"yes"

    asyncio.run(ask())
