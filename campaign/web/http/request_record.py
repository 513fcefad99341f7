"""What is kept of a request: a line of the log, counts for Prometheus, and of a write an entry of the audit trail."""

import json
import logging
import time

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram
from starlette.concurrency import run_in_threadpool
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from campaign.web.access.audit import AuditTrail

logger = logging.getLogger("clearcap.requests")
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")


class Metrics:
    """Counts of requests, for ``/metrics``."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        labels = ("method", "route", "status")
        self.requests = Counter("clearcap_requests", "Answered requests", labels, registry=self.registry)
        self.seconds = Histogram(
            "clearcap_request_seconds", "Time until the answer began", ("method", "route"), registry=self.registry
        )
        self.streams = Gauge("clearcap_event_streams", "Open event streams", registry=self.registry)
        self.campaigns = Gauge("clearcap_campaigns", "Campaigns by state", ("state",), registry=self.registry)
        self.jobs = Gauge("clearcap_jobs", "Jobs by state", ("state",), registry=self.registry)


class Record:
    """Log and count each request; enter each write of a known user into the audit trail before it is answered.

    Parameters
    ----------
    app : ASGI application
    audit : AuditTrail
    metrics : Metrics
    """

    def __init__(self, app: ASGIApp, audit: AuditTrail, metrics: Metrics) -> None:
        self._app, self._audit, self._metrics = app, audit, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        start = time.perf_counter()

        async def send_recorded(message: Message) -> None:
            if message["type"] == "http.response.start":
                await self._record(scope, message["status"], time.perf_counter() - start)
            await send(message)

        await self._app(scope, receive, send_recorded)

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
        if method not in SAFE_METHODS:
            subject = " ".join(f"{value}" for value in scope.get("path_params", {}).values())[:200]
            kind = principal.kind if principal else state.get("how", "none")
            who = who if principal else state.get("who", "nobody")
            detail = state.get("detail", "")
            await run_in_threadpool(
                self._audit.add, who, kind, address, f"{method} {route}"[:200], subject, status, detail
            )
