"""Middleware: the outermost, which checks host, body size and body time of every request; and answers to HEAD."""

import asyncio
import re
import secrets
from collections import Counter
from collections.abc import Iterable

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from clearcap.web.access.throttle import place_of
from clearcap.web.http.responses import Refusal, problem_response
from clearcap.web.settings import LOOPBACK, Limits

CONTENT_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self';"
    " form-action 'self'; frame-src 'self'; base-uri 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": CONTENT_POLICY,
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
    "Cache-Control": "no-store",
}
TRANSPORT_SECURITY = "max-age=31536000"
# paths that receive files
UPLOADS = (
    *("/api/v1/campaigns", "/api/v1/checks/campaign", "/api/v1/drawings", "/api/v1/measured"),
    *("/campaigns/new", "/mechanisms/drawings", "/measured"),
)
_UPLOAD = re.compile(r"(/api/v1)?/campaigns/[^/]+/monitor")  # the same of a campaign
LARGEST_DOCUMENT = 2 * 1024**2  # bytes of all other bodies: no other request is answered while one is parsed
MOST_VALUES = 10_000  # in a JSON document: each would become an object in memory
OPEN_FORMS, LARGEST_OPEN_FORM = ("/login", "/login/link"), 64 * 1024  # open to everybody, and largest body [bytes]
_HOST = re.compile(r"(\[[0-9a-fA-F:.]+\]|[A-Za-z0-9.-]+)(?::(\d{1,5}))?")


class RequestLimits:
    """Refuse requests for other hosts or with too large or too slow bodies; add the headers common to all answers.

    Besides the names of loopback only `names` are accepted as host, which also stops a foreign site whose own name
    resolves to this machine (DNS rebinding). `secure` says that browsers connect by TLS.
    """

    def __init__(self, app: ASGIApp, names: Iterable[str], limits: Limits, secure: bool) -> None:
        self._app, self._limits = app, limits
        self._arrived: Counter[str] = Counter()  # bytes of the bodies at work, by address
        self._names = {name.lower() for name in (*LOOPBACK, *names)}
        self._headers = HEADERS | ({"Strict-Transport-Security": TRANSPORT_SECURITY} if secure else {})

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass one request on, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        state = scope.setdefault("state", {})
        state["request"] = secrets.token_hex(8)
        begun = False

        async def send_with_headers(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                sent = MutableHeaders(scope=message)
                for name, value in {**self._headers, "X-Request-Id": state["request"]}.items():
                    sent.setdefault(name, value)
            await send(message)

        headers = dict(scope["headers"])
        place = place_of(scope["client"][0] if scope.get("client") else "unknown")
        body = _Body(self._arrived, self._limits, place)
        try:
            # several Host headers are joined, so that they match no name
            hosts = [value.decode("latin-1") for name, value in scope["headers"] if name == b"host"]
            host = hosts[0] if len(hosts) == 1 else ", ".join(hosts)
            named = _HOST.fullmatch(host)
            if named is None or named[1].strip("[]").lower() not in self._names:
                raise Refusal(421, f"host {host!r:.100}: this server has other names; clearcap serve --name adds one")
            most = self._largest_body(scope["path"], headers.get(b"content-type", b""))
            length = headers.get(b"content-length", b"0")
            if not length.isdigit() or int(length[:20]) > most:  # int() refuses more than 4300 digits
                raise _body_too_large(most)
            await self._app(scope, self._bounded(receive, most, body), send_with_headers)
        except Refusal as refused:
            if begun:
                raise
            refused.headers.setdefault("Connection", "close")
            await problem_response(refused)(scope, receive, send_with_headers)
        finally:
            body.forget()

    def _largest_body(self, path: str, kind: bytes) -> int:
        """Return the largest size that the body of a request may have [bytes]."""
        if takes_files(path) and kind.lower().startswith(b"multipart/form-data"):  # its files go to the disk
            return self._limits.body
        return min(self._limits.body, LARGEST_OPEN_FORM if path in OPEN_FORMS else LARGEST_DOCUMENT)

    def _bounded(self, receive: Receive, most: int, body: "_Body") -> Receive:
        """Return a reader of the body that raises a refusal when the body becomes too large or takes too long."""
        limits = self._limits
        over, ended = asyncio.get_running_loop().time() + limits.body_seconds, False

        async def read() -> Message:
            nonlocal ended
            if ended:  # the application waits for the end of the connection
                return await receive()
            try:
                async with asyncio.timeout_at(over):
                    message = await receive()
            except TimeoutError:
                words = f"the body did not arrive within {limits.body_seconds:g} s; send it again"
                raise _body_refused(408, words) from None
            ended = message["type"] != "http.request" or not message.get("more_body", False)
            body.add(len(message.get("body", b"")))
            if body.size > most:
                raise _body_too_large(most)
            return message

        return read


class _Body:
    """The body of a request, as far as it has arrived; all at work bound the memory and disk that they take."""

    def __init__(self, arrived: Counter[str], limits: Limits, place: str) -> None:
        self._arrived, self._limits, self._place, self.size = arrived, limits, place, 0

    def add(self, size: int) -> None:
        """Count what has arrived; refuse it (503) if all bodies, or those from its address, are too large together."""
        self.size += size
        self._arrived[self._place] += size
        most, most_of_one = self._limits.bodies, max(self._limits.body, self._limits.bodies // 4)
        if self._arrived[self._place] > most_of_one or self._arrived.total() > most:
            raise _body_refused(503, "other large requests are at work; send this one again in some seconds", "5")

    def forget(self) -> None:
        """Forget the body, because its request is answered."""
        self._arrived[self._place] -= self.size
        if not self._arrived[self._place]:
            del self._arrived[self._place]


def takes_files(path: str) -> bool:
    """Return whether a request to this path may have files."""
    return path in UPLOADS or _UPLOAD.fullmatch(path) is not None


def check_values(document: bytes) -> None:
    """Refuse (413) a JSON document of more than `MOST_VALUES` values, which is not parsed for that."""
    if _most_values(document) > MOST_VALUES:
        outside = document.replace(rb"\\", b"").replace(rb"\"", b"").split(b'"')[::2]
        if _most_values(b"".join(outside)) > MOST_VALUES:
            raise _body_refused(413, f"the document has more than {MOST_VALUES} values; send less, or data as a file")


def _most_values(text: bytes) -> int:
    """Return a number that the values of a JSON text without strings do not exceed."""
    return 1 + sum(map(text.count, (b",", b"[", b"{")))


def _body_too_large(most: int) -> Refusal:
    return _body_refused(413, f"the body may have at most {most} bytes here")


def _body_refused(status: int, detail: str, retry_after_s: str = "") -> Refusal:
    """Return the refusal of a body; it closes the connection, because the rest of the body is not read."""
    later = {"Retry-After": retry_after_s} if retry_after_s else {}
    return Refusal(status, detail, headers={"Connection": "close", **later})


ONCE = ("/login/", "/shared/")  # paths where GET is not safe: it begins a session, with a link that may work only once


class Head:
    """Answer HEAD like GET, but without the body (RFC 9110, section 9.3.2); the application handles only GET.

    Paths with one-time links are left out, so that a program that previews a link does not use it up.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http" or scope["method"] != "HEAD" or scope["path"].startswith(ONCE):
            await self._app(scope, receive, send)
            return
        asked = {**scope, "method": "GET"}

        async def send_head(message: Message) -> None:
            if message["type"] != "http.response.start":
                return
            scope.update({key: asked[key] for key in ("route", "path_params") if key in asked})  # for the log
            await send(message)
            await send({"type": "http.response.body"})  # ends the answer here, even an endless one such as events

        await self._app(asked, receive, send_head)
