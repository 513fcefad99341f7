"""A dask scheduler whose workers compute nothing: what a call, a heartbeat and a worker cost it, as there are more.

Scheduler, messages and mutual TLS are real, and so is the client, that of `campaign.cluster`. The workers are stubs,
many in one process: each has the three connections of a real one (its stream, its heartbeats, the results that are
fetched from it), sends what a real one sends, at the interval that the scheduler asks for, and answers a call at once.
What is measured is processor time of the scheduler and the client; calls a second are those that fit into one core.
`python -m benchmarks.scheduler 1000` measures one number of workers. Each takes three open files of the scheduler.
"""

import asyncio
import json
import logging
import pickle
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

import dask
import psutil
from distributed import Scheduler, Security, Status
from distributed.batched import BatchedSend
from distributed.comm import connect
from distributed.core import Server
from distributed.protocol import to_serialize
from distributed.scheduler import heartbeat_interval
from distributed.utils import silence_logging_cmgr
from distributed.versions import get_versions

from benchmarks import ROOT
from campaign.cluster.connect import client_at
from campaign.cluster.local import CLOSED, SETTINGS
from campaign.cluster.tls_certificates import passing_security
from campaign.cluster.workers import Answered, DaskWorkers
from campaign.coordinator.dispatch import CALLS_PER_WORKER
from campaign.row_build import row_build
from campaign.store import Part
from campaign.worker.batch import run_batches
from campaign.worker.messages import BatchRequest, BatchResult, CampaignAddress, Moments

SIZES = (100, 1_000, 4_000)  # numbers of workers
CALLS = 3_000  # at least, and one for each worker
WARM_UP = 2  # calls for each worker before, whose results open a connection to each
IDLE, ALONE = 20.0, 10.0  # s during which only heartbeats are measured, and nothing at all
PER_PROCESS = 2_000  # stubs, each with four open files
HEARTBEAT = {  # as a real worker sends it
    "task_counts": {"executing": 1, "memory": 1},
    "bandwidth": {"total": 100_000_000, "workers": {}, "types": {}},
    "digests_total_since_heartbeat": {"tick-duration": 2.0, "latency": 0.002},
    "managed_bytes": 3_000,
    "spilled_bytes": {"memory": 0, "disk": 0},
    "transfer": dict.fromkeys(
        [f"{way}_{what}" for way in ("incoming", "outgoing") for what in ("bytes", "count", "count_total")], 0
    ),
    "event_loop_interval": 0.5,
    "cpu": 100.0,
    "memory": 180_000_000,
    "time": 1.8e9,
    "host_net_io": {"read_bps": 1000.0, "write_bps": 1000.0},
    "host_disk_io": {"read_bps": 1000.0, "write_bps": 1000.0},
    "num_fds": 30,
}


def measure() -> list[dict[str, Any]]:
    """Return what a scheduler takes with some numbers of workers, each in processes of its own."""
    return [measure_one(workers) for workers in SIZES]


def measure_one(workers: int) -> dict[str, Any]:
    """Return what a scheduler takes; see `schedule`."""
    command = [sys.executable, "-m", "benchmarks.scheduler", str(workers)]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    figures: dict[str, Any] = json.loads(done.stdout)
    return figures


def schedule(workers: int, calls: int, idle_s: float = IDLE) -> dict[str, Any]:
    """Return processor times of scheduler and client, with so many stubs and calls [s, ms], and memory [MiB, kiB]."""
    security = passing_security()
    with ExitStack() as stack:
        address, scheduler = stack.enter_context(_process(serve_scheduler, security))
        empty, alone = _memory(scheduler), _idle(scheduler, min(idle_s, ALONE))
        begun = _processor_s(scheduler)
        for first in range(0, workers, PER_PROCESS):
            count = min(PER_PROCESS, workers - first)
            stack.enter_context(_process(serve_stubs, security, address, first, count))
        joining = _processor_s(scheduler) - begun
        memory = _memory(scheduler)
        interval = heartbeat_interval(workers)
        idle = _idle(scheduler, max(idle_s, 2.0 * interval))
        client = DaskWorkers(stack.enter_context(client_at(address, security)))
        look_s, look_client_s = _look(client, scheduler)
        _call(client, workers, WARM_UP * workers, scheduler)
        taken = _call(client, workers, calls, scheduler)
    of_call = (taken["scheduler_s"] - idle * taken["wall_s"]) / calls
    return {
        "workers": workers,
        "join_ms": 1e3 * joining / workers,
        "worker_KiB": 1024 * (memory - empty) / workers,
        "idle_share": idle,
        "heartbeat_ms": 1e3 * (idle - alone) * interval / workers,
        "look_ms": 1e3 * look_s,
        "look_client_ms": 1e3 * look_client_s,
        "calls": calls,
        "call_ms": 1e3 * of_call,
        "client_call_ms": 1e3 * taken["client_s"] / calls,
        # that fit into one core of the scheduler, beside the heartbeats
        "calls_a_second": (1.0 - idle) / of_call,
        "memory_MiB": taken["memory"],
        "wall_s": taken["wall_s"],
    }


def _idle(scheduler: psutil.Process, seconds: float) -> float:
    """Return the share of a core that a scheduler takes while nothing is asked of it."""
    before = _processor_s(scheduler)
    time.sleep(seconds)
    return (_processor_s(scheduler) - before) / seconds


def _look(client: DaskWorkers, scheduler: psutil.Process, times: int = 5) -> tuple[float, float]:
    """Return processor times of scheduler and client for counting the workers, as every two seconds [s]."""
    before, own = _processor_s(scheduler), time.process_time()
    for _ in range(times):
        client.count()
    return (_processor_s(scheduler) - before) / times, (time.process_time() - own) / times


def _call(client: DaskWorkers, workers: int, calls: int, scheduler: psutil.Process) -> dict[str, float]:
    """Keep calls in flight as a coordinator does; return what they take."""
    address = CampaignAddress("/shared/runs", "c60-0123456789", row_build())
    before, own, begun, submitted, finished = _processor_s(scheduler), time.process_time(), time.perf_counter(), 0, 0
    most = 0.0
    while finished < calls:
        while submitted < calls and submitted - finished < CALLS_PER_WORKER * workers:
            client.submit(f"batch-{submitted:06d}", run_batches, address, [BatchRequest(submitted)])
            submitted += 1
        future = client.next_finished()
        assert future is not None
        assert len(future.result()) == 1
        finished += 1
        if finished % 1000 == 0:
            most = max(most, _memory(scheduler))
    return {
        "scheduler_s": _processor_s(scheduler) - before,
        "client_s": time.process_time() - own,
        "wall_s": time.perf_counter() - begun,
        "memory": max(most, _memory(scheduler)),
    }


def _processor_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def _memory(process: psutil.Process) -> float:
    return float(process.memory_info().rss) / 2**20


# -- processes ---------------------------------------------------------------------------------------------------------


@contextmanager
def _process(serve: Any, security: Security, *arguments: Any) -> Iterator[tuple[str, psutil.Process]]:
    """Start a process that serves until the block ends; yield what it says once it is ready, and the process."""
    context = get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_run, args=(serve, there, security, *arguments), daemon=True)
    process.start()
    there.close()
    try:
        yield here.recv(), psutil.Process(process.pid)
    finally:
        process.kill()
        process.join()


def _run(serve: Any, ready: Connection, *arguments: Any) -> None:
    with dask.config.set({**SETTINGS, **CLOSED}), silence_logging_cmgr(logging.CRITICAL):
        asyncio.run(serve(ready, *arguments))


async def serve_scheduler(ready: Connection, security: Security) -> None:
    """Serve a scheduler as `campaign.cluster.local` starts one, and say its address."""
    options = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
    async with Scheduler(host="127.0.0.1", protocol="tls", security=security, **options) as scheduler:
        ready.send(scheduler.address)
        await scheduler.finished()


async def serve_stubs(ready: Connection, security: Security, scheduler: str, first: int, count: int) -> None:
    """Serve stubs, and say when all have joined."""
    result = [
        BatchResult(Part(0, 500, {"ok": 500}, 60_000, "0" * 64), dict.fromkeys(RESPONSES, Moments(500, 1.0, 1.0)))
    ]
    answer = Answered(result, ("host", 1))

    async def get_data(comm: Any, keys: list[str], **_: Any) -> Any:
        await comm.write({"status": "OK", "data": {key: to_serialize(answer) for key in keys}})
        await comm.read()
        return Status.dont_reply

    server = Server({"get_data": get_data})
    stubs = []
    for number in range(first, first + count):
        await server.listen("tls://127.0.0.1:0", **security.get_listen_args("worker"))
        stub = Stub(number, scheduler, server.listeners[-1].contact_address, security.get_connection_args("worker"))
        await stub.join()
        stubs.append(stub)
    ready.send("joined")
    await asyncio.gather(*(each for stub in stubs for each in (stub.work(), stub.beat())))


VERSIONS = get_versions()
RESPONSES = [f"FC-{number}" for number in range(1, 7)]
_TYPE = pickle.dumps(Answered)


class Stub:
    """A worker for a scheduler: it joins, sends heartbeats, and says at once that a call is finished."""

    def __init__(self, number: int, scheduler: str, address: str, connection: dict[str, Any]) -> None:
        self._number, self._scheduler, self._address, self._connection = number, scheduler, address, connection
        self._interval = 1.0
        self._stream = BatchedSend(interval="2ms")

    async def join(self) -> None:
        """Join the scheduler, with what a real worker says of itself."""
        self._comm = await connect(self._scheduler, deserialize=False, **self._connection)
        await self._comm.write(
            {
                "op": "register-worker",
                "reply": False,
                "address": self._address,
                "status": "running",
                "nthreads": 1,
                "name": self._number,
                "now": time.time(),
                "resources": {},
                "memory_limit": 4 * 2**30,
                "local_directory": "/tmp/clearcap-scratch/worker",
                "services": {},
                "nanny": None,
                "pid": 1,
                "versions": VERSIONS,
                "metrics": HEARTBEAT,
                "extra": {},
                "stimulus_id": f"worker-connect-{time.time()}",
                "server_id": f"Worker-{self._number}",
            },
            serializers=["msgpack"],
        )
        self._interval = (await self._comm.read())["heartbeat-interval"]
        self._stream.start(self._comm)
        self._heart = await connect(self._scheduler, **self._connection)

    async def work(self) -> None:
        """Answer calls until the scheduler ends."""
        with suppress(OSError):
            while True:
                messages = await self._comm.read()
                for message in messages if isinstance(messages, tuple | list) else [messages]:
                    if message["op"] == "compute-task":
                        self._stream.send(self._finished(message))

    async def beat(self) -> None:
        """Send heartbeats until the scheduler ends."""
        await asyncio.sleep(random.random() * self._interval)
        with suppress(OSError):
            while True:
                beat = {"op": "heartbeat_worker", "reply": True, "address": self._address, "now": time.time()}
                await self._heart.write(beat | {"metrics": HEARTBEAT, "executing": {}, "extensions": {}})
                self._interval = (await self._heart.read())["heartbeat-interval"]
                await asyncio.sleep(self._interval)

    def _finished(self, call: dict[str, Any]) -> dict[str, Any]:
        now = time.time()
        return {
            "op": "task-finished",
            "status": "OK",
            "key": call["key"],
            "run_id": call["run_id"],
            "nbytes": 3_000,
            "type": _TYPE,
            "typename": "campaign.cluster.workers.Answered",
            "metadata": {},
            "thread": 1,
            "startstops": [{"action": "compute", "start": now, "stop": now}],
            "stimulus_id": f"task-finished-{now}",
        }


def main() -> None:
    """Print what a scheduler takes; the argument is the number of workers."""
    workers = int(sys.argv[1])
    print(json.dumps(schedule(workers, max(CALLS, workers))))


if __name__ == "__main__":
    main()
