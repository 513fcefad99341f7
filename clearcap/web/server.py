"""The HTTP server of a service: its application, checks and lock, its first login link, and its connections."""

import asyncio
import fcntl
import itertools
import json
import logging
import os
import socket
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager, suppress
from dataclasses import fields
from functools import partial
from ipaddress import ip_address, ip_network
from pathlib import Path
from typing import Annotated, Any

import uvicorn
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.openapi.utils import get_openapi
from fastapi.staticfiles import StaticFiles
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError
from starlette.exceptions import HTTPException
from starlette.responses import Response
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from campaign.errors import CampaignError, SpecError, unwritable
from campaign.row_build import clearcap_version
from clearcap.web.access import Role
from clearcap.web.access.throttle import place_of
from clearcap.web.api import routers
from clearcap.web.http.monitoring import Metrics, Record, ServiceGauges, show_requests
from clearcap.web.http.request_limits import Head, RequestLimits
from clearcap.web.http.responses import Refusal, described, problem_response, problem_schemas, refusal_of
from clearcap.web.pages import STATIC, page_routers
from clearcap.web.pages.rendering import SITE, refused_page
from clearcap.web.settings import LOOPBACK, PREFIX, Limits, Oidc, Settings
from clearcap.web.web_service import Service
from engine import EngineError
from engine.platform.toml_file import UnfitToml, read_toml

DESCRIPTION = """
Mechanisms, campaigns and their reports over HTTP. Log in as a browser does, or send a token:
`Authorization: Bearer clearcap_token_...`. Every refusal is answered with problem details (RFC 9457).
"""


def make_app(service: Service) -> FastAPI:
    """Return the FastAPI application of a service, which is closed when the application ends."""

    @asynccontextmanager
    async def life(_: FastAPI) -> AsyncIterator[None]:
        async with service.working():
            yield

    app = FastAPI(
        title="clearcap",
        summary="From clearance to capability",
        description=DESCRIPTION,
        version=clearcap_version(),
        openapi_url=f"{PREFIX}/openapi.json",
        docs_url=None,  # they load scripts from other hosts
        redoc_url=None,
        lifespan=life,
    )
    app.openapi = partial(_described, app)  # type: ignore[method-assign]  # FastAPI's own way to extend it
    app.state.service = service
    app.state.metrics = Metrics()
    app.state.metrics.registry.register(ServiceGauges(service))
    for router in (*routers(), *page_routers()):
        app.include_router(router)
    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    if SITE.is_dir():
        app.mount("/help/documentation", StaticFiles(directory=SITE, html=True), name="documentation")
    for kind in (Refusal, CampaignError, EngineError, HTTPException, RequestValidationError):
        app.add_exception_handler(kind, _refuse)
    # A request passes the middleware added last first. RequestLimits is the outermost: it refuses foreign hosts and
    # large bodies before anything else is done for them, numbers the request for the log, and adds its headers to every
    # answer, also to the 500 of Record. Record comes before Head, so that it logs HEAD as such, and a bug in Head as
    # well.
    app.add_middleware(Head)
    app.add_middleware(Record, audit=service.audit, metrics=app.state.metrics)
    settings = service.settings
    app.add_middleware(RequestLimits, names=settings.names, limits=settings.limits, secure=not settings.is_local)
    return app


def _described(app: FastAPI) -> dict[str, Any]:
    """Return the OpenAPI 3.1 description of the API, with the schemas of refusals; it is generated once."""
    if app.openapi_schema is None:
        title, version, words = app.title, app.version, app.description
        app.openapi_schema = get_openapi(
            title=title, version=version, summary=app.summary, description=words, routes=app.routes
        )
        app.openapi_schema["components"]["schemas"].update(problem_schemas())
        for path in app.openapi_schema["paths"].values():
            for call in path.values():
                if "application/json" in call["responses"].get("422", {}).get("content", {}):  # FastAPI's own
                    call["responses"]["422"] = described(422)[422]
    return app.openapi_schema


def _refuse(request: Request, error: Exception) -> Response:
    """Answer an error of clearcap or of the framework with problem details, or with a page for a browser."""
    refusal = refusal_of(error)
    if isinstance(error, RequestValidationError):  # invalid parameters, or an invalid body
        listed = [([str(part) for part in each["loc"] or ["body"]], each["msg"]) for each in error.errors()[:100]]
        detail = "; ".join(f"{'.'.join(keys)}: {text}" for keys, text in listed[:5])
        refusal = Refusal(422, detail, [{"keys": keys, "text": text} for keys, text in listed])
    elif isinstance(error, HTTPException):  # such as an unknown path or method
        words = f"{request.url.path}: {error.detail}"[:500]
        while_read = error.__cause__ if isinstance(error.__cause__, Refusal) else None  # the framework read the body
        refusal = while_read or Refusal(error.status_code, words, headers=dict(error.headers or {}))
    assert refusal is not None
    if not request.url.path.startswith("/api/") and "text/html" in request.headers.get("accept", ""):
        return refused_page(request, refusal)
    return problem_response(refusal)


SECRET = "CLEARCAP_OIDC_SECRET"  # environment variable of the login service's client secret


class _Table(BaseModel):
    """A table of the configuration file."""

    model_config = ConfigDict(extra="forbid", strict=True)


class _OidcTable(_Table):
    """The table ``[oidc]``."""

    issuer: Annotated[str, Field(pattern=r"^https://[^\s]+$")]
    client_id: str
    roles_claim: str = "groups"
    roles: dict[str, str] = {}


class _WebhookTable(_Table):
    """The table ``[webhooks]``."""

    allow: list[Annotated[str, Field(pattern=r"^[A-Za-z0-9._:-]{1,253}$")]] = []


class _SigningTable(_Table):
    """The table ``[signing]``."""

    four_eyes: bool = False


class _Tables(_Table):
    """The tables of the file."""

    limits: dict[str, Annotated[float, Field(gt=0)]] = {}
    oidc: _OidcTable | None = None
    webhooks: _WebhookTable = _WebhookTable()
    signing: _SigningTable = _SigningTable()


def read_configuration(path: Path | None) -> dict[str, Any]:
    """Return the settings in a TOML file by their names in `Settings`; the secret of `[oidc]` is in the environment."""
    if path is None:
        return {}
    try:
        tables = TypeAdapter(_Tables).validate_python(read_toml(path))
    except (OSError, UnfitToml) as error:
        raise SpecError(f"--config {path}: cannot be read ({error})") from error
    except ValidationError as error:
        lines = [f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}" for fault in error.errors()]
        raise SpecError("\n  ".join([f"--config {path}:", *lines])) from error
    kinds: dict[str, Any] = {f.name: type(f.default) for f in fields(Limits)}
    if unknown := sorted(tables.limits.keys() - kinds.keys()):
        raise SpecError(f"--config {path}: limits.{unknown[0]}: no such limit; limits: {', '.join(kinds)}")
    return {
        "limits": Limits(**{name: kinds[name](value) for name, value in tables.limits.items()}),
        "oidc": _oidc(path, tables.oidc),
        "webhook_hosts": tuple(tables.webhooks.allow),
        "four_eyes": tables.signing.four_eyes,
    }


def _oidc(path: Path, table: _OidcTable | None) -> Oidc | None:
    """Return the login service."""
    if table is None:
        return None
    secret = os.environ.get(SECRET)
    if not secret:
        raise SpecError(f"--config {path}: oidc: the environment variable {SECRET} is missing; set the client's secret")
    for group, role in table.roles.items():
        try:
            Role.of(role)
        except ValueError as error:
            raise SpecError(f"--config {path}: oidc.roles.{group}: {error}") from error
    return Oidc(table.issuer, table.client_id, secret, table.roles_claim, table.roles)


LOCK = "server.lock"
FIRST_ADMIN = "admin"
FIRST_LINK = "first_login_link"  # file in the data folder
DRAIN = 20  # s that running requests may take to finish when the server ends
KEEP_ALIVE = 20  # s without a request, after which a connection is closed
CONNECTIONS = 1000
logger = logging.getLogger(__name__)


class Server(uvicorn.Server):
    """A server that ends its event streams before it shuts down, so that it need not wait for them."""

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End the event streams, then shut down."""
        self.config.app.state.service.watcher.end_streams()  # type: ignore[union-attr]  # it is a FastAPI
        await super().shutdown(sockets)


def check_settings(settings: Settings) -> None:
    """Raise SpecError if other machines could connect without TLS, or a proxy is not given as an address or network."""
    for proxy in settings.proxies:
        try:
            ip_network(proxy)
        except ValueError as error:
            raise SpecError(
                f"--proxy {proxy!r:.100}: is neither an address nor a network ({error}); write for example 10.1.2.3"
            ) from error
    if settings.is_local and settings.host not in LOOPBACK:
        raise SpecError(
            f"--host {settings.host}: other machines could read passwords and results on the way; give --https-cert and"
            " --https-key, or --behind-proxy if a proxy in front of the server ends TLS"
        )


def first_login(service: Service, *, is_terminal: bool) -> tuple[str | None, Path | None]:
    """Return, at a first start, the first admin's link for a terminal, else its file, because others may read logs."""
    file = service.settings.data / FIRST_LINK
    file.unlink(missing_ok=True)
    if service.users.all():
        return None, None
    link = login_link(service)
    if is_terminal:
        return link, None
    with open(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as opened:
        opened.write(f"{link}\n")
    return None, file


def login_link(service: Service, user: str = FIRST_ADMIN) -> str:
    """Return a one-time login link for a user; create the first admin if there is no user yet."""
    if not service.users.all():
        service.users.add(FIRST_ADMIN, Role.ADMIN)
    found = service.users.get(user)
    if found is None or found.is_disabled:
        names = ", ".join(each.name for each in service.users.all() if not each.is_disabled)
        raise SpecError(f"--login-link {user!r:.80}: no such user; users: {names}")
    return f"{service.settings.address}/login/link?key={service.sessions.new_link(user)}"


def serve_http(service: Service) -> None:
    """Answer requests until SIGTERM or Ctrl-C; running requests are finished first."""
    show_requests()
    http_server(service).run(sockets=[_listening(service.settings)])


def http_server(service: Service) -> Server:
    """Return the server of a service, ready to run; raise SpecError if the certificate cannot be used."""
    settings = service.settings
    cert, key = settings.https or (None, None)
    config = uvicorn.Config(
        make_app(service),
        host=settings.host,
        port=settings.port,
        ssl_certfile=cert,
        ssl_keyfile=key,
        proxy_headers=settings.behind_proxy,
        forwarded_allow_ips=list(settings.proxies),
        log_config=None,
        access_log=False,  # `Record` writes the log
        server_header=False,
        timeout_graceful_shutdown=DRAIN,
        timeout_keep_alive=KEEP_ALIVE,
        limit_concurrency=CONNECTIONS,
        http=BoundedConnection,
        ws="none",
    )
    try:
        config.load()
    except (OSError, ValueError) as error:
        raise SpecError(
            f"--https-cert {cert}, --https-key {key}: no PEM certificate and the key that belongs to it ({error})"
        ) from error
    return Server(config)


def _listening(settings: Settings) -> socket.socket:
    """Return a socket that listens on the port of the settings."""
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    # not left to uvicorn, which would end the process if the port is taken, instead of raising
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((settings.host, settings.port))
    except OSError as error:
        listening.close()
        raise SpecError(
            f"--host {settings.host} --port {settings.port}: cannot listen there ({error.strerror}); another process"
            " may use the port: choose another with --port"
        ) from error
    listening.listen(2048)
    return listening


@contextmanager
def instance_lock(settings: Settings) -> Iterator[None]:
    """Hold the lock of a data folder in the block; the end of the process releases it too, however it ends."""
    path = settings.data / LOCK
    with ExitStack() as stack:
        try:
            file = stack.enter_context(path.open("a+b", buffering=0))
        except OSError as error:
            raise unwritable(f"--data {settings.data}: cannot be used now ({error.strerror})", error) from error
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            file.seek(0)
            which = ""
            with suppress(ValueError, KeyError, TypeError):  # nothing is written yet
                known = json.loads(file.read(500))
                which = f" (process {known['process']}, {known['address']})"
            raise SpecError(
                f"--data {settings.data}: another server uses this folder{which}; end it first, or give this one a"
                " folder of its own with --data"
            ) from error
        with suppress(OSError):  # a full disk: only the message to a second server needs it
            file.truncate(0)
            file.write(json.dumps({"process": os.getpid(), "address": settings.address}).encode())
        yield


LARGEST_HEAD = 64 * 1024  # bytes, of a request's first line and headers
SLOWEST_READER = 1024  # bytes/s of an answer that a client must read at least
_numbers = itertools.count()  # of connections
SEND_BUFFER = 256 * 1024  # bytes; with a larger buffer the system would report too late what a client has read


class BoundedConnection(HttpToolsProtocol):
    """A connection that limits the size and arrival time of each request head and requires that answers are read.

    Uvicorn does not: a thousand connections that never finish their heads, or never read an answer, would keep all
    out, and an endless header would fill the memory. One too many from an address ends its oldest idle connection.
    """

    _number, _place = 0, ""  # in the order of their beginning, and which address may open so many; empty for a proxy
    _deadline: asyncio.TimerHandle | None = None
    _reader_watch: asyncio.TimerHandle | None = None
    _head_bytes = 0
    _is_in_head = False
    _has_taken = True  # whether the client has read all that was sent since the last check

    @property
    def _limits(self) -> Limits:
        limits: Limits = self.config.app.state.service.settings.limits  # type: ignore[union-attr]  # FastAPI
        return limits

    def connection_made(self, transport: Any) -> None:
        """Set up the new connection and wait for its first request."""
        super().connection_made(transport)
        self._number = next(_numbers)
        settings: Settings = self.config.app.state.service.settings  # type: ignore[union-attr]  # FastAPI
        if self.client is not None:
            address, proxies = self.client[0], settings.proxies if settings.behind_proxy else ()
            is_proxy = any(ip_address(address) in ip_network(each) for each in proxies)
            self._place = "" if is_proxy else place_of(address)
        if not self._make_room():
            self._cut("503 Service Unavailable")
            return
        if (connected := transport.get_extra_info("socket")) is not None:
            connected.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        transport.set_write_buffer_limits(high=0)  # so that `resume_writing` is called when everything was read
        self._expect_head()
        self._watch_reader(0)

    def data_received(self, data: bytes) -> None:
        """Process received bytes."""
        # after an answer; also for blank lines, which do not begin a request
        if not self._is_at_work and self._deadline is None:
            self._expect_head()
        super().data_received(data)
        if self._is_in_head or self._deadline is not None:  # also the head of a second request behind the first
            self._head_bytes += len(data)
            if self._head_bytes > LARGEST_HEAD:
                self._cut("431 Request Header Fields Too Large")

    def on_message_begin(self) -> None:
        """Note that a request head begins."""
        self._is_in_head = True
        super().on_message_begin()

    def on_header(self, name: bytes, value: bytes) -> None:
        """Process a header; ignore trailers, the headers after a body, because they may have no end."""
        if self._is_in_head:
            super().on_header(name, value)

    def on_headers_complete(self) -> None:
        """Note that the head is complete and the body begins."""
        self._is_in_head, self._head_bytes = False, 0
        self._forget_deadline()
        super().on_headers_complete()

    def resume_writing(self) -> None:
        """Continue an answer after the client has read everything that was buffered."""
        self._has_taken = True
        super().resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel the timers of the closed connection."""
        self._forget_deadline()
        if self._reader_watch is not None:
            self._reader_watch.cancel()
        super().connection_lost(exc)

    @property
    def _is_at_work(self) -> bool:
        """Whether a request is being answered."""
        return self.cycle is not None and not self.cycle.response_complete

    def _make_room(self) -> bool:
        """Close the oldest idle connection of an address that has too many; return whether there is room."""
        opened = (each for each in self.connections if isinstance(each, BoundedConnection))
        # one that is being closed takes no place, and closing it again would make none
        own = [
            each for each in opened if self._place and each._place == self._place and not each.transport.is_closing()
        ]
        if len(own) <= self._limits.connections:
            return True
        idle = [each for each in own if each is not self and not each._is_at_work]
        if idle:
            min(idle, key=lambda each: each._number)._cut("408 Request Timeout")
        return bool(idle)

    def _watch_reader(self, waiting: int) -> None:
        """Check periodically that the client reads a buffered answer fast enough; abort the connection if not."""
        left, seconds = self.transport.get_write_buffer_size(), self._limits.read_seconds
        if waiting and not self._has_taken and left > waiting - SLOWEST_READER * seconds:
            self.transport.abort()
            return
        self._has_taken = not left
        self._reader_watch = self.loop.call_later(seconds, self._watch_reader, left)

    def _expect_head(self) -> None:
        """Start to measure the time and size of a request head."""
        self._head_bytes = 0
        self._deadline = self.loop.call_later(self._limits.head_seconds, self._cut, "408 Request Timeout")

    def _forget_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _cut(self, status: str) -> None:
        """Send a status, unless another answer has begun, and close the connection."""
        self._forget_deadline()
        if self.cycle is not None and self.cycle.response_started and not self.cycle.response_complete:
            self.transport.abort()
        elif not self.transport.is_closing():
            self.transport.write(f"HTTP/1.1 {status}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n".encode())
            self.transport.close()
