"""The cost of the service under load: lists, states and event streams, while a campaign is computed.

A real server in a separate process has a store of 1,000 synthetic campaigns. Each figure is the processor time of that
process alone, with its bound, and as a multiple of a bare answer.
"""

import asyncio
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import httpx
import numpy as np
import psutil

from benchmarks.web_answers import figure_row, made_up_campaign
from campaign.coordinator.state import write_state
from campaign.plan import Plan
from campaign.spec.load import load_campaign
from campaign.store import Store, open_store
from campaign.store.layout import SUBMISSION
from clearcap.questions.report import report
from clearcap.web.index import REPORT_DOCUMENT

# A minimal HTTP answer, one line of text by Starlette under uvicorn.
BARE_ANSWER = """
import sys, uvicorn
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route
async def bare_answer(_):
    return PlainTextResponse("ok")
uvicorn.run(Starlette(routes=[Route("/", bare_answer)]), port=int(sys.argv[1]), log_config=None, access_log=False)
"""
PATIENCE = 300.0  # s, limit of every wait
CAMPAIGNS, SAMPLES = 1000, 20
FILES, ROWS_OF_A_FILE = 309, 100  # of one larger campaign, that of the paper
FOLLOWERS = 200
LISTINGS, CHANGES, STATUSES, BARE = 40, 20, 200, 2000  # numbers of requests over which a figure is averaged
IDLE, FOLLOWED, FIRST_MIXED, MIXED = 10.0, 30.0, 20.0, 60.0  # s
CALLERS, PAUSE = 4, 0.1  # number of callers, and pause between two questions of a caller [s]
LIST = f"/api/v1/campaigns?limit={CAMPAIGNS}"
BESIDE = """format = 1
name = "beside"
mechanism = "c60"
samples = 60000

[variables.J1]
distribution = "uniform"
lower = 0.01
upper = 0.13
"""


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


def measure() -> dict[str, Any]:
    """Return the processor time of each kind of question [ms] as figures, and facts of the whole run."""
    with tempfile.TemporaryDirectory(prefix="clearcap-bench-") as folder:
        return asyncio.run(_measured(Path(folder)))


async def _measured(folder: Path) -> dict[str, Any]:
    """Measure servers of a store, one after the other; see `measure`."""
    changed, small, large = _filled(open_store(str(folder / "runs")))
    async with bare_server() as bare:
        table = _Table(await bare.mean(BARE, lambda _: bare.ask("/")))
        bare_wait = float(np.median(bare.waits))
    async with _serving(folder, "--no-drive") as load:
        without_index = load.taken
    async with _serving(folder, "--workers", "1") as load:
        table.add("the first list of all, more without an index than with one", without_index - load.taken)
        running = await _campaign_beside(load)
        load.idle = await load.share(IDLE)
        table.add("a second in which nobody asks", load.idle)
        await _measure_questions(load, table, changed, {"20 rows": small, "309 files": large, "running": running})
        async with load.followers(f"/api/v1/campaigns/{running}/events", FOLLOWERS):
            before = load.events
            table.add(f"a second of {FOLLOWERS} followers", await load.share(FOLLOWED) - load.idle, 100.0)
            facts = {"events a follower a second": (load.events - before) / FOLLOWED / FOLLOWERS}
            paths = [LIST, "/api/v1/campaigns", f"/api/v1/campaigns/{running}/status", f"/campaigns/{small}"]
            facts |= await _mixed(load, paths, bare_wait)
        facts |= {"answers": load.statuses.total(), "errors among them": load.errors}
    return {"figures": table.rows, "facts": facts}


class _Table:
    """Figures, each with its bound and relative to a bare answer [s of processor time]."""

    def __init__(self, bare_answer: float) -> None:
        self._unit, self.rows = bare_answer, list[dict[str, Any]]()
        self.add("a bare answer", bare_answer)

    def add(self, what: str, seconds: float, bar_ms: float | None = None) -> None:
        """Add a figure."""
        self.rows.append(figure_row(what, seconds, bar_ms) | {"in_bare_answers": seconds / self._unit})


def _filled(store: Store) -> tuple[str, str, str]:
    """Fill a store with completed campaigns that have reports; return the ids of two small ones and of a large one."""
    loaded = load_campaign("c60")
    first = made_up_campaign(store, loaded, SAMPLES, SAMPLES, "c60-0")
    report(store, first, kinds=("json",))
    document = store.files.read(f"{first.campaign_id}/{REPORT_DOCUMENT}")
    _complete(store, first, document)
    for number in range(1, CAMPAIGNS):
        second = made_up_campaign(store, loaded, SAMPLES, SAMPLES, f"c60-{number}")
        _complete(store, second, document)
    large = made_up_campaign(store, loaded, FILES * ROWS_OF_A_FILE, ROWS_OF_A_FILE)
    _complete(store, large, document)
    return first.campaign_id, second.campaign_id, large.campaign_id


def _complete(store: Store, plan: Plan, document: bytes) -> None:
    """Mark a campaign as completed, with a report."""
    with patch("os.fsync"):
        store.write_json(plan.campaign_id, SUBMISSION, {"user": "eva", "time": time.time()})
        store.files.write(f"{plan.campaign_id}/{REPORT_DOCUMENT}", document)
        write_state(store, plan.campaign_id, "completed")


@asynccontextmanager
async def _serving(folder: Path, *options: str) -> AsyncIterator[ServerLoad]:
    """Serve the store in the block, once all campaigns are listed."""
    from tests.clearcap.web.running import Served

    (folder / "limits.toml").write_text(f"[limits]\nstreams = {FOLLOWERS}\n", encoding="utf-8")
    with Served(folder, "--config", str(folder / "limits.toml"), *options) as served:
        served.wait()
        async with asking(served.url, served.process.pid, served.token("engineer")) as load:
            async with asyncio.timeout(PATIENCE):
                while (await load.ask(LIST)).json()["unread"]:
                    await asyncio.sleep(1.0)
            yield load


async def _campaign_beside(load: ServerLoad) -> str:
    """Submit a campaign that takes longer than all questions, wait until it has rows, and return its id."""
    campaign: str = (await load.ask("/api/v1/campaigns", "POST", json={"text": BESIDE})).json()["campaign"]
    async with asyncio.timeout(PATIENCE):
        while True:
            status = (await load.ask(f"/api/v1/campaigns/{campaign}/status")).json()
            if status["done"] and status["heartbeat"]:
                return campaign
            await asyncio.sleep(1.0)


async def _measure_questions(load: ServerLoad, table: _Table, changed: str, campaigns: dict[str, str]) -> None:
    """Measure the list, warm and after a change of a campaign, and the status of some campaigns by name."""

    async def change(number: int) -> None:
        await load.ask(f"/api/v1/campaigns/{changed}/labels", "PATCH", json={"note": f"number {number}"})
        await load.ask(LIST)

    table.add(f"a list of {CAMPAIGNS} campaigns", await load.mean(LISTINGS, lambda _: load.ask(LIST)), 50.0)
    table.add("a change of a label and the list after it", await load.mean(CHANGES, change), 50.0)
    for name, campaign in campaigns.items():
        path = f"/api/v1/campaigns/{campaign}/status"
        table.add(f"a status: {name}", await load.mean(STATUSES, lambda _, path=path: load.ask(path)), 2.5)


async def _mixed(load: ServerLoad, paths: list[str], bare_wait: float) -> dict[str, float]:
    """Request all paths repeatedly with several concurrent callers; return memory of the process and waiting times."""
    # `bare_wait` is the waiting time for a bare answer [s].
    at_first = load.memory_mib
    await _ask_all(load, paths, FIRST_MIXED)  # until each thread of the server has allocated its working memory
    load.waits.clear()
    before = load.taken
    at, mib = np.array(await _ask_all(load, paths, MIXED)).T
    median, late = np.quantile(load.waits, (0.5, 0.99))
    return {
        f"mixed questions in {MIXED:g} s": len(load.waits),
        "share of a core meanwhile": (load.taken - before) / MIXED,
        "waiting time, median, ms": 1e3 * float(median),
        "waiting time, 99 %, ms": 1e3 * float(late),
        "median in those of bare answers": float(median) / bare_wait,
        "memory before mixed questions, MiB": at_first,
        f"memory {FIRST_MIXED:g} s later, MiB": float(mib[0]),
        f"memory {MIXED:g} s later again, MiB": float(mib[-1]),
        "its slope, MiB a minute": 60.0 * float(np.polyfit(at - at[0], mib, 1)[0]),
    }


async def _ask_all(load: ServerLoad, paths: list[str], seconds: float) -> list[tuple[float, float]]:
    """Request all paths in turn with several concurrent callers; return (time [s], memory [MiB]) once per second."""
    end, memory = time.monotonic() + seconds, list[tuple[float, float]]()

    async def call(number: int) -> None:
        while time.monotonic() < end:
            await load.ask(paths[number % len(paths)])
            number += 1
            await asyncio.sleep(PAUSE)

    async def look() -> None:
        while time.monotonic() < end:
            memory.append((time.monotonic(), load.memory_mib))
            await asyncio.sleep(1.0)

    await asyncio.gather(look(), *map(call, range(CALLERS)))
    return memory


@asynccontextmanager
async def bare_server() -> AsyncIterator[ServerLoad]:
    """Serve a bare answer in the block."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    process = subprocess.Popen([sys.executable, "-c", BARE_ANSWER, str(port)])
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
