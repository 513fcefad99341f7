"""A fair queue: limits on running and waiting jobs, in total and for each user, with the users in rotation."""

import asyncio
import math
from collections import deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from time import monotonic

from campaign.errors import CampaignError

_USUAL_JOB = 1.0  # s; assumed duration of a job before one has ended
_MEMORY = 0.2  # weight of the last job in the mean duration of a job


class Busy(CampaignError):
    """A user, or all users together, have as many jobs waiting as is allowed; `retry_after_s` is at least 1."""

    def __init__(self, message: str, retry_after_s: int) -> None:
        super().__init__(message)
        self.retry_after_s = retry_after_s

    def __reduce__(self) -> tuple[type["Busy"], tuple[str, int]]:
        return Busy, (str(self), self.retry_after_s)


@dataclass(frozen=True)
class Quota:
    """Limits on the number of jobs at a time."""

    at_once: int = 2  # running jobs of a user
    waiting: int = 16  # waiting jobs of a user
    waiting_in_all: int = 200  # waiting jobs of all users


@dataclass
class _UserJobs:
    """The jobs of one user: the number of running ones, and the waiting ones."""

    running: int = 0
    waiting: "deque[asyncio.Future[None]]" = field(default_factory=deque)


class FairQueue:
    """Give turns to the jobs of users, in one event loop; `places` jobs run at the same time."""

    def __init__(self, places: int, quota: Quota) -> None:
        self._free, self._places, self._quota = places, places, quota
        self._users: dict[str, _UserJobs] = {}  # in the order in which their turn comes
        self._job_s = _USUAL_JOB

    @property
    def waiting(self) -> int:
        """Number of waiting jobs."""
        return sum(len(jobs.waiting) for jobs in self._users.values())

    @property
    def running(self) -> int:
        """Number of running jobs."""
        return self._places - self._free

    @property
    def by_user(self) -> dict[str, tuple[int, int]]:
        """Numbers of running and of waiting jobs, for each user with jobs."""
        return {user: (jobs.running, len(jobs.waiting)) for user, jobs in self._users.items()}

    @asynccontextmanager
    async def turn(self, user: str) -> AsyncIterator[None]:
        """Wait for a user's turn and hold it while the block runs; raise Busy if too many jobs are waiting already."""
        jobs = self._users.setdefault(user, _UserJobs())
        ready = asyncio.get_running_loop().create_future()
        if self._free == 0 or jobs.running >= self._quota.at_once:
            self._check_room(user, jobs)
        jobs.waiting.append(ready)
        self._give()
        try:
            await ready
        except asyncio.CancelledError:
            if not ready.cancelled():  # the turn was given at the same moment
                self._leave(user, jobs)
            elif ready in jobs.waiting:
                jobs.waiting.remove(ready)
                self._forget_idle(user, jobs)
            raise
        begun = monotonic()
        try:
            yield
        finally:
            self._job_s += _MEMORY * (monotonic() - begun - self._job_s)
            self._leave(user, jobs)

    def _check_room(self, user: str, jobs: _UserJobs) -> None:
        """Raise Busy if no further job may wait."""
        mine, all_jobs = len(jobs.waiting), self.waiting
        if mine < self._quota.waiting and all_jobs < self._quota.waiting_in_all:
            return
        at_a_time = self._places if mine < self._quota.waiting else min(self._places, self._quota.at_once)
        queue = all_jobs if mine < self._quota.waiting else mine
        seconds = max(1, math.ceil(queue * self._job_s / at_a_time))
        self._forget_idle(user, jobs)
        whose = f"{mine} jobs of {user} wait" if mine >= self._quota.waiting else f"{all_jobs} jobs wait"
        limit = self._quota.waiting if mine >= self._quota.waiting else self._quota.waiting_in_all
        raise Busy(f"{whose}, as many as may (limit {limit}); try again in {seconds} s", seconds)

    def _give(self) -> None:
        """Give the free places to users in rotation; a user who gets one becomes the last."""
        while self._free:
            user = next(
                (u for u, jobs in self._users.items() if jobs.waiting and jobs.running < self._quota.at_once), None
            )
            if user is None:
                return
            jobs = self._users[user]
            ready = jobs.waiting.popleft()
            if ready.cancelled():  # the job was cancelled a moment ago
                self._forget_idle(user, jobs)
                continue
            self._users[user] = self._users.pop(user)
            jobs.running += 1
            self._free -= 1
            ready.set_result(None)

    def _leave(self, user: str, jobs: _UserJobs) -> None:
        """Take back a place; its user becomes the last in the rotation."""
        jobs.running -= 1
        self._free += 1
        self._users[user] = self._users.pop(user)
        self._forget_idle(user, jobs)
        self._give()

    def _forget_idle(self, user: str, jobs: _UserJobs) -> None:
        """Drop a user without jobs."""
        if not jobs.running and not jobs.waiting:
            self._users.pop(user, None)
