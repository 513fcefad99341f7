"""Monitoring: a log line, Prometheus counts and, for a write, an audit entry of each request; service gauges."""

import collections
import json
import logging
import re
import time
import traceback
from collections.abc import Callable, Iterable, Mapping
from typing import TextIO

from prometheus_client import CollectorRegistry, Counter, Histogram, Metric, ProcessCollector
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from campaign.errors import StoreError
from campaign.waits import SENTENCES
from clearcap.web.access.audit import AuditTrail
from clearcap.web.access.throttle import Throttle, place_of
from clearcap.web.answers.job_pool import JobPool
from clearcap.web.http.problems import MEDIA_TYPE, Refusal, problem
from clearcap.web.watch.entry import LISTED_STATES
from clearcap.web.watch.watcher import Watcher
from clearcap.web.watch.workload import Workload

logger = logging.getLogger("clearcap.requests")
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
MOST_OF_STRANGERS, WITHIN = 30, 300.0  # unauthenticated writes from one place that are audited, within this time [s]
_SECRET = re.compile(r"clearcap_[a-z]+_[\w-]+")


def show_requests(stream: TextIO | None = None) -> None:
    """Write the log of requests to a stream, by default standard error, as one line of ASCII JSON per request."""
    handler = logging.StreamHandler(stream)
    handler.setFormatter(logging.Formatter("%(message)s"))
    logger.handlers, logger.propagate = [handler], False
    logger.setLevel(logging.INFO)


class Metrics:
    """Counts of requests, and the registry of all metrics that ``/metrics`` returns."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        labels = ("method", "route", "status")
        self.requests = Counter("clearcap_requests", "Answered requests", labels, registry=self.registry)
        self.seconds = Histogram(
            "clearcap_request_seconds", "Time until the answer began", ("method", "route"), registry=self.registry
        )


class Record:
    """Log and count each request, audit each write before it is answered, and answer with 500 after a bug.

    Only the first unauthenticated writes from each place are audited, so that strangers cannot fill the disk.
    """

    def __init__(self, app: ASGIApp, audit: AuditTrail, metrics: Metrics) -> None:
        self._app, self._audit, self._metrics = app, audit, metrics
        self._strangers = Throttle(MOST_OF_STRANGERS, WITHIN)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        start, begun, refused = time.perf_counter(), False, False

        async def send_recorded(message: Message) -> None:
            nonlocal begun, refused
            if message["type"] == "http.response.start":
                begun = True
                try:
                    # before the first byte is sent, so that no answer reports a write that is not in the audit trail
                    await self._record(scope, message["status"], time.perf_counter() - start)
                except StoreError as error:  # a write that cannot be audited is not reported as done
                    refused = True
                    await self._refuse(scope, receive, send, error)
            if not refused:
                await send(message)

        try:
            await self._app(scope, receive, send_recorded)
        except Refusal:  # raised by `RequestLimits`, which answers it
            raise
        except Exception:
            if begun:
                raise
            request = scope["state"].get("request", "")
            logger.error("%s", json.dumps({"request": request, "bug": traceback.format_exc()}))
            detail = f"a bug of the server; its log has the reason under the request {request}"
            body = problem(500, detail).model_dump_json()
            await Response(body, 500, media_type=MEDIA_TYPE)(scope, receive, send_recorded)

    async def _refuse(self, scope: Scope, receive: Receive, send: Send, error: StoreError) -> None:
        """Answer that a request cannot be audited now."""
        logger.warning("%s", json.dumps({"request": scope["state"].get("request", ""), "fault": str(error)}))
        body = problem(503, str(error)).model_dump_json()
        await Response(body, 503, {"Retry-After": "10"}, MEDIA_TYPE)(scope, receive, send)

    async def _record(self, scope: Scope, status: int, seconds: float) -> None:
        """Record a request that is about to be answered."""
        state, method = scope["state"], scope["method"]
        route = getattr(scope.get("route"), "path", "none")
        principal = state.get("principal")
        who = principal.name if principal else "nobody"
        method_label = method if method in ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS") else "other"
        self._metrics.requests.labels(method_label, route, status).inc()
        self._metrics.seconds.labels(method_label, route).observe(seconds)
        address = scope["client"][0] if scope.get("client") else "unknown"
        line = {"method": method, "route": route, "status": status, "ms": round(1e3 * seconds, 1), "who": who}
        logger.info("%s", json.dumps({**line, "address": address, "request": state.get("request", "")}))
        is_known = principal is not None or ("who" in state and state.get("how") != "password")
        if method not in SAFE_METHODS and (is_known or not self._strangers.attempt(place_of(address))):
            subject = " ".join(f"{value}" for value in scope.get("path_params", {}).values())
            subject = _SECRET.sub("(a secret)", subject)[:200]
            kind = principal.kind if principal else state.get("how", "none")
            who = who if principal else state.get("who", "nobody")
            detail = state.get("detail", "")
            await run_in_threadpool(
                self._audit.add, who, kind, address, f"{method} {route}"[:200], subject, status, detail
            )


class ServiceGauges(Collector):
    """Count campaigns by state, running and waiting jobs, and open event streams.

    It may only be queried in the event loop of the service, because no lock keeps the counts from changing meanwhile.
    """

    def __init__(self, watcher: Watcher, pool: JobPool) -> None:
        self._watcher, self._pool = watcher, pool

    def collect(self) -> Iterable[Metric]:
        """Yield the gauges with their current values."""
        campaigns = collections.Counter(dict.fromkeys(LISTED_STATES, 0))
        campaigns.update(entry.state for entry, _ in self._watcher.index.entries())
        yield _by_state("clearcap_campaigns", "Campaigns by state, as the list has them", campaigns)
        jobs = {"running": self._pool.running, "waiting": self._pool.waiting}
        yield _by_state("clearcap_jobs", "Jobs in the processes that compute for pages and calls", jobs)
        yield GaugeMetricFamily("clearcap_event_streams", "Open event streams", self._watcher.followers)

    def describe(self) -> Iterable[Metric]:
        """Return nothing, so that the registry does not count when this collector is registered."""
        return ()


class WorkGauges(Collector):
    """Tell what coordinator and workers do, as the store says: who scrapes the server need not reach them.

    `work` returns what was seen last, None if the store could not be read; `free` the room on its disk, if known.
    """

    def __init__(self, work: Callable[[], Workload | None], free: Callable[[], int | None]) -> None:
        self._work, self._free = work, free

    def collect(self) -> Iterable[Metric]:
        """Yield the gauges with their values; without the store only that it cannot be read."""
        work, free = self._work(), self._free()
        yield GaugeMetricFamily("clearcap_store_up", "The store can be read", float(work is not None))
        if free is not None:
            yield GaugeMetricFamily("clearcap_store_free_bytes", "Room on the disk of the store", free)
        if work is None:
            return
        serves = work.serving is not None and work.serving.sign.is_alive is not False
        yield GaugeMetricFamily("clearcap_coordinator_up", "A coordinator serves the store", float(serves))
        beats = [each.seen.heartbeat for each in work.running if each.seen.heartbeat]
        yield GaugeMetricFamily("clearcap_workers", "Workers of all running campaigns", work.workers)
        rate = sum(beat.rate or 0.0 for beat in beats)
        yield GaugeMetricFamily("clearcap_rows_per_second", "Rows that all workers compute", rate)
        waits = collections.Counter(dict.fromkeys(SENTENCES, 0))
        waits.update({wait["what"] for beat in beats for wait in beat.waiting})
        yield _by_state("clearcap_waiting", "Running campaigns that wait, by what for", waits)

    def describe(self) -> Iterable[Metric]:
        """Return nothing, so that the registry does not look when this collector is registered."""
        return ()


def _by_state(name: str, help: str, counts: Mapping[str, int]) -> Metric:
    """Return a gauge with one value for each state."""
    gauge = GaugeMetricFamily(name, help, labels=("state",))
    for state, count in counts.items():
        gauge.add_metric((state,), count)
    return gauge
