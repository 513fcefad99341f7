"""A server in a process of its own that is asked, what its process takes meanwhile, and what it answers."""

import asyncio
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import psutil

PATIENCE = 300.0  # s, for whatever must happen
ROOT = Path(__file__).parents[1]


@dataclass
class ServerLoad:
    """A server under load.

    Attributes
    ----------
    client : httpx.AsyncClient
        Asks it.
    process : psutil.Process
        The process that answers; those that it starts are not measured.
    idle : float
        Share of a core that the process takes when nobody asks; 0 until it is measured.
    statuses : Counter of int
        Answers by status.
    waits : list of float
        Time until each answer was there [s].
    events : int
        Events of all streams.
    """

    client: httpx.AsyncClient
    process: psutil.Process
    idle: float = 0.0
    statuses: Counter[int] = field(default_factory=Counter)
    waits: list[float] = field(default_factory=list)
    events: int = 0

    async def ask(self, path: str, method: str = "GET", **options: Any) -> httpx.Response:
        """Return an answer; it is counted."""
        start = time.perf_counter()
        answer = await self.client.request(method, path, **options)
        self.waits.append(time.perf_counter() - start)
        self.statuses[answer.status_code] += 1
        return answer

    @property
    def errors(self) -> int:
        """Number of answers that were refusals or failures."""
        return sum(count for status, count in self.statuses.items() if status >= 400)

    @property
    def taken(self) -> float:
        """Processor time that the process has taken [s]."""
        times = self.process.cpu_times()
        return float(times.user + times.system)

    @property
    def memory_mib(self) -> float:
        """Memory that the process has [MiB]."""
        return float(self.process.memory_info().rss / 2**20)

    async def share(self, seconds: float) -> float:
        """Return the share of a core that the process takes during so many seconds."""
        before, start = self.taken, time.monotonic()
        await asyncio.sleep(seconds)
        return (self.taken - before) / (time.monotonic() - start)

    async def mean(self, count: int, act: Callable[[int], Awaitable[object]]) -> float:
        """Return the processor time of an act, the mean of several [s], without what the idle process takes."""
        await act(-1)  # the first one may load what the others find
        before, start = self.taken, time.monotonic()
        for number in range(count):
            await act(number)
        return (self.taken - before - self.idle * (time.monotonic() - start)) / count

    @asynccontextmanager
    async def followers(self, path: str, count: int) -> AsyncIterator[None]:
        """Keep event streams open in the block, each with its first event; count the events of all."""
        first = asyncio.Semaphore(0)

        async def follow() -> None:
            async with self.client.stream("GET", path, timeout=None) as answer:
                self.statuses[answer.status_code] += 1
                is_first = True
                async for line in answer.aiter_lines():
                    if line.startswith("data:"):
                        self.events += 1
                        if is_first:
                            first.release()
                        is_first = False
                    elif line.startswith("{"):
                        raise RuntimeError(f"no stream: {line:.200}")
            raise RuntimeError("an event stream ended while it was followed")

        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(follow()) for _ in range(count)]
            async with asyncio.timeout(PATIENCE):
                for _ in tasks:
                    await first.acquire()
            yield
            for task in tasks:
                task.cancel()


@asynccontextmanager
async def bare_server() -> AsyncIterator[ServerLoad]:
    """Serve `bare_answer` in the block."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    process = subprocess.Popen([sys.executable, "-m", "benchmarks.bare_answer", str(port)], cwd=ROOT)
    try:
        async with asking(f"http://127.0.0.1:{port}", process.pid) as load:
            async with asyncio.timeout(PATIENCE):
                while not await _answers(load):
                    await asyncio.sleep(0.1)
            yield load
    finally:
        process.terminate()
        process.wait()


async def _answers(load: ServerLoad) -> bool:
    """Return whether a server answers."""
    try:
        return (await load.ask("/")).is_success
    except httpx.TransportError:
        return False


@asynccontextmanager
async def asking(url: str, process: int, headers: dict[str, str] | None = None) -> AsyncIterator[ServerLoad]:
    """Ask a server in the block, over connections that stay open."""
    limits = httpx.Limits(max_connections=None, max_keepalive_connections=None)
    async with httpx.AsyncClient(base_url=url, headers=headers, limits=limits, timeout=PATIENCE) as client:
        yield ServerLoad(client, psutil.Process(process))
