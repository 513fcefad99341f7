"""FairQueue: users in rotation, limits of each and of all, and what is given up."""

import asyncio

import pytest

from clearcap.web.jobs.pool import Busy, FairQueue, Quota


class Jobs:
    """Jobs that run until they are told to end, and the order in which they began."""

    def __init__(self, places, quota):
        self.turns, self.begun, self.ends, self.tasks = FairQueue(places, quota), [], {}, {}

    async def ask(self, user, name):
        """Ask for a job of a user."""
        self.ends[name] = asyncio.Event()
        self.tasks[name] = asyncio.create_task(self._hold(user, name))
        await asyncio.sleep(0)

    async def _hold(self, user, name):
        async with self.turns.turn(user):
            self.begun.append(name)
            await self.ends[name].wait()

    async def end(self, name):
        """End a job that runs."""
        self.ends[name].set()
        await self.tasks[name]
        await asyncio.sleep(0)


def test_users_take_turns_whatever_one_of_them_asks():
    """Who asks for much waits for himself: another's first job comes before his next."""

    async def ask():
        jobs = Jobs(1, Quota(at_once=1, waiting=5))
        for name in ("a1", "a2", "a3"):
            await jobs.ask("a", name)
        await jobs.ask("b", "b1")
        assert (jobs.turns.running, jobs.turns.waiting) == (1, 3)
        assert jobs.turns.by_user == {"b": (0, 1), "a": (1, 2)}
        for name in ("a1", "b1", "a2", "a3"):
            await asyncio.sleep(0)
            assert jobs.begun[-1] == name
            await jobs.end(name)
        assert (jobs.turns.running, jobs.turns.waiting, jobs.turns.by_user) == (0, 0, {})

    asyncio.run(ask())


def test_a_user_has_only_so_many_places():
    """A free place is not given to a user who has as many as he may."""

    async def ask():
        jobs = Jobs(3, Quota(at_once=2))
        for name in ("a1", "a2", "a3"):
            await jobs.ask("a", name)
        assert jobs.begun == ["a1", "a2"]
        await jobs.ask("b", "b1")
        assert jobs.begun == ["a1", "a2", "b1"]
        await jobs.end("a2")
        assert jobs.begun[-1] == "a3"
        for name in ("a1", "a3", "b1"):
            await jobs.end(name)

    asyncio.run(ask())


@pytest.mark.parametrize(
    ("quota", "user", "words"),
    [
        (Quota(at_once=1, waiting=2), "a", "2 jobs of a wait"),
        (Quota(at_once=1, waiting=9, waiting_in_all=2), "b", "2 jobs wait"),
    ],
)
def test_beyond_the_limits_one_is_told_when_to_come_back(quota, user, words):
    """Neither a user nor all users together can make the queue longer than it may be."""

    async def ask():
        jobs = Jobs(1, quota)
        for name in ("a1", "a2", "a3"):
            await jobs.ask("a", name)
        with pytest.raises(Busy, match=words) as refused:
            async with jobs.turns.turn(user):
                pass
        assert refused.value.retry_after_s >= 1
        for name in ("a1", "a2", "a3"):
            await jobs.end(name)
        async with jobs.turns.turn(user):
            assert jobs.turns.running == 1

    asyncio.run(ask())


def test_who_gives_up_leaves_no_gap():
    """A job cancelled while it waits, or at the moment of its turn, blocks nobody."""

    async def ask():
        jobs = Jobs(1, Quota(at_once=1))
        for name in ("a1", "b1", "c1"):
            await jobs.ask(name[0], name)
        jobs.tasks["b1"].cancel()
        await jobs.end("a1")
        assert jobs.begun == ["a1", "c1"]
        await jobs.ask("d", "d1")
        jobs.ends["c1"].set()
        await jobs.tasks["c1"]  # its place was given to d, who has not taken it yet
        jobs.tasks["d1"].cancel()
        with pytest.raises(asyncio.CancelledError):
            await jobs.tasks["d1"]
        assert (jobs.turns.running, jobs.turns.waiting) == (0, 0)
        await jobs.ask("e", "e1")
        assert jobs.begun[-1] == "e1"
        await jobs.end("e1")

    asyncio.run(ask())
