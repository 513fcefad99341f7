"""A server under load in a separate process: requests to it, its use of processor and memory, and its answers."""

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

PATIENCE = 300.0  # s, limit of every wait
ROOT = Path(__file__).parents[1]


@dataclass
class ServerLoad:
    """A server under load."""

    client: httpx.AsyncClient
    process: psutil.Process  # the serving one; its child processes are not measured
    idle: float = 0.0  # share of a core that the process uses without requests; 0 until it is measured
    statuses: Counter[int] = field(default_factory=Counter)  # answers by status
    waits: list[float] = field(default_factory=list)  # until each answer [s]
    events: int = 0  # of all streams

    async def ask(self, path: str, method: str = "GET", **options: Any) -> httpx.Response:
        """Send a request and return the answer, which is counted."""
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
        """Processor time used by the process [s]."""
        times = self.process.cpu_times()
        return float(times.user + times.system)

    @property
    def memory_mib(self) -> float:
        """Memory of the process [MiB]."""
        return float(self.process.memory_info().rss / 2**20)

    async def share(self, seconds: float) -> float:
        """Return the share of a core that the process uses during `seconds` seconds."""
        before, start = self.taken, time.monotonic()
        await asyncio.sleep(seconds)
        return (self.taken - before) / (time.monotonic() - start)

    async def mean(self, count: int, act: Callable[[int], Awaitable[object]]) -> float:
        """Return the mean processor time of `act` over `count` calls [s], without that of the idle process."""
        await act(-1)  # the first call may load what the others find
        before, start = self.taken, time.monotonic()
        for number in range(count):
            await act(number)
        return (self.taken - before - self.idle * (time.monotonic() - start)) / count

    @asynccontextmanager
    async def followers(self, path: str, count: int) -> AsyncIterator[None]:
        """Keep event streams open in the block, after the first event of each; count the events of all."""
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
    """Provide a client of a server in the block; its connections stay open."""
    limits = httpx.Limits(max_connections=None, max_keepalive_connections=None)
    async with httpx.AsyncClient(base_url=url, headers=headers, limits=limits, timeout=PATIENCE) as client:
        yield ServerLoad(client, psutil.Process(process))
