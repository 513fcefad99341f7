"""Monitoring: a log line, Prometheus counts and, for a write, an audit entry of each request; service gauges."""

import asyncio
import collections
import json
import logging
import re
import time
import traceback
from collections.abc import Iterable, Mapping
from typing import TextIO

from fastapi import Request
from prometheus_client import (
    CONTENT_TYPE_LATEST,
    CollectorRegistry,
    Counter,
    Histogram,
    Metric,
    ProcessCollector,
    generate_latest,
)
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from campaign.errors import StoreError
from campaign.waits import SENTENCES
from clearcap.web.access.audit import AuditTrail
from clearcap.web.access.throttle import Throttle, place_of
from clearcap.web.http.authentication import SAFE_METHODS, TheService, Viewer
from clearcap.web.http.responses import Refusal, problem_response
from clearcap.web.index import LISTED_STATES
from clearcap.web.jobs.pool import EngineCompiling
from clearcap.web.web_service import Service

logger = logging.getLogger("clearcap.requests")
MOST_OF_STRANGERS, WITHIN = 30, 300.0  # unauthenticated writes from one place that are audited, within this time [s]
CLIENT_GONE = 499  # of nginx: whoever asked closed the connection before the request was whole
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
        words = "Time until the answer began"
        self.seconds = Histogram("clearcap_request_seconds", words, labels[:2], registry=self.registry)


class Record:
    """Log and count each request, audit each write before it is answered, and answer with 500 after a bug.

    Of strangers only the first writes from each place are audited, so that they cannot fill the disk.
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
                    fault = {"request": scope["state"].get("request", ""), "fault": str(error)}
                    logger.warning("%s", json.dumps(fault))
                    refusal = Refusal(503, str(error), headers={"Retry-After": "10"})
                    await problem_response(refusal)(scope, receive, send)
            if not refused:
                await send(message)

        try:
            await self._app(scope, receive, send_recorded)
        except Refusal:  # raised by `RequestLimits`, which answers it
            raise
        except ClientDisconnect:  # no bug, and nobody reads the answer
            await Response(status_code=CLIENT_GONE)(scope, receive, send_recorded)
        except asyncio.CancelledError:  # the server ends, and has waited for this request as long as it waits
            if begun:
                raise
            detail = (
                "the server ends while it answers; whether this was done shows when it is back: look, or send it again"
            )
            # not recorded: that may be what the request has waited for, as on a full disk
            await problem_response(Refusal(503, detail, headers={"Retry-After": "10"}))(scope, receive, send)
        except Exception:
            if begun:
                raise
            request = scope["state"].get("request", "")
            logger.error("%s", json.dumps({"request": request, "bug": traceback.format_exc()}))
            detail = f"a bug of the server; its log has the reason under the request {request}"
            await problem_response(Refusal(500, detail))(scope, receive, send_recorded)

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
            entry = (who, kind, address, f"{method} {route}"[:200], subject, status, state.get("detail", ""))
            await run_in_threadpool(self._audit.add, *entry)


class ServiceGauges(Collector):
    """Count campaigns by state, jobs and streams, and tell what coordinator and workers do, as the store says.

    It may only be queried in the event loop of the service, because no lock keeps the counts from changing meanwhile.
    """

    def __init__(self, service: Service) -> None:
        self._service = service

    def describe(self) -> Iterable[Metric]:
        """Return nothing, so that the registry does not count when this collector is registered."""
        return ()

    def collect(self) -> Iterable[Metric]:
        """Yield the gauges with their current values; of a store that cannot be read, only that."""
        watcher, turns = self._service.watcher, self._service.pool.turns
        campaigns = collections.Counter(dict.fromkeys(LISTED_STATES, 0))
        campaigns.update(entry.state for entry, _ in watcher.index.entries())
        yield _by_state("clearcap_campaigns", "Campaigns by state, as the list has them", campaigns)
        jobs = {"running": turns.running, "waiting": turns.waiting}
        yield _by_state("clearcap_jobs", "Jobs in the processes that compute for pages and calls", jobs)
        yield GaugeMetricFamily("clearcap_event_streams", "Open event streams", watcher.followers)
        work, free = self._service.workload, self._service.free_space()
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


def _by_state(name: str, help: str, counts: Mapping[str, int]) -> Metric:
    """Return a gauge with one value for each state."""
    gauge = GaugeMetricFamily(name, help, labels=("state",))
    for state, count in counts.items():
        gauge.add_metric((state,), count)
    return gauge


class Health(BaseModel):
    """The health of the server."""

    status: str = Field(examples=["ok"])


async def healthz() -> Health:
    """Answer that the process is alive; nothing else is checked."""
    return Health(status="ok")


def readyz(service: TheService) -> Health:
    """Check that the store and the database can be read, and that the engine is not being compiled."""
    if (seconds := service.pool.compilation.seconds) is not None:
        raise EngineCompiling(seconds)
    service.database.row("SELECT 1")
    try:
        service.store.folders()
    except Exception as error:
        # only in the log, because anybody may ask
        logging.getLogger(__name__).warning("the store cannot be read: %s", error)
        words = "the store cannot be read; the server's log says why"
        raise Refusal(503, words, headers={"Retry-After": "10"}) from error
    return Health(status="ok")


async def metrics(request: Request, service: TheService, _: Viewer) -> Response:
    """Return counts of requests, jobs, campaigns and workers, without names, in the text format of Prometheus."""
    await service.look_at_work()
    content = generate_latest(request.app.state.metrics.registry)
    return Response(content, headers={"Content-Type": CONTENT_TYPE_LATEST})
