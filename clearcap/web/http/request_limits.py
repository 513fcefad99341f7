"""The outermost middleware, which checks the host, body size and body time of every request."""

import asyncio
import re
import secrets
from collections.abc import Iterable

from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from clearcap.web.http.problems import MEDIA_TYPE, Refusal, problem
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
UPLOADS = "/api/v1/campaigns", "/api/v1/checks/campaign", "/campaigns/new"  # paths that receive files
LARGEST_DOCUMENT = 8 * 1024**2  # bytes of a body on other paths: no other request is answered while it is parsed
OPEN_FORM, LARGEST_OPEN_FORM = "/login", 64 * 1024  # form open to everybody, and its largest body [bytes]
_HOST = re.compile(r"(\[[0-9a-fA-F:.]+\]|[A-Za-z0-9.-]+)(?::(\d{1,5}))?")


class RequestLimits:
    """Refuse requests for other hosts or with too large or too slow bodies; add the headers common to all answers.

    Besides the names of loopback only `names` are accepted as host, which also stops a foreign site whose own name
    resolves to this machine (DNS rebinding). `secure` says that browsers connect by TLS.
    """

    def __init__(self, app: ASGIApp, names: Iterable[str], limits: Limits, secure: bool) -> None:
        self._app, self._limits = app, limits
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
                given = {name.lower() for name, _ in message["headers"]}
                added = {**self._headers, "X-Request-Id": state["request"]}
                message["headers"] = [
                    *message["headers"],
                    *((n.lower().encode(), v.encode()) for n, v in added.items() if n.lower().encode() not in given),
                ]
            await send(message)

        headers = dict(scope["headers"])
        try:
            # several Host headers are joined, so that they match no name
            hosts = [value.decode("latin-1") for name, value in scope["headers"] if name == b"host"]
            self._check_host(hosts[0] if len(hosts) == 1 else ", ".join(hosts))
            most = self._largest_body(scope["path"])
            _check_length(headers.get(b"content-length", b"0"), most)
            await self._app(scope, self._bounded(receive, most), send_with_headers)
        except Refusal as refused:
            if begun:
                raise
            answer = Response(
                problem(refused.status, refused.detail).model_dump_json(),
                refused.status,
                {"Connection": "close"},
                MEDIA_TYPE,
            )
            await answer(scope, receive, send_with_headers)

    def _check_host(self, host: str) -> None:
        match = _HOST.fullmatch(host)
        name = match[1].strip("[]").lower() if match else ""
        if name not in self._names:
            raise Refusal(421, f"host {host!r:.100}: this server has other names; clearcap serve --name adds one")

    def _largest_body(self, path: str) -> int:
        """Return the largest size that the body of a request may have [bytes]."""
        if path in UPLOADS:
            return self._limits.body
        return min(self._limits.body, LARGEST_OPEN_FORM if path == OPEN_FORM else LARGEST_DOCUMENT)

    def _bounded(self, receive: Receive, most: int) -> Receive:
        """Return a reader of the body that raises a refusal when the body becomes too large or takes too long."""
        size, limits = 0, self._limits
        over, ended = asyncio.get_running_loop().time() + limits.body_seconds, False

        async def read() -> Message:
            nonlocal size, ended
            if ended:  # the application waits for the end of the connection
                return await receive()
            try:
                async with asyncio.timeout_at(over):
                    message = await receive()
            except TimeoutError:
                raise _body_refused(
                    408, f"the body did not arrive within {limits.body_seconds:g} s; send it again"
                ) from None
            ended = message["type"] != "http.request" or not message.get("more_body", False)
            size += len(message.get("body", b""))
            if size > most:
                raise _body_too_large(most)
            return message

        return read


def _check_length(length: bytes, most: int) -> None:
    """Refuse a body whose Content-Length is too large or is not a number."""
    if not length.isdigit() or int(length[:20]) > most:  # int() refuses more than 4300 digits
        raise _body_too_large(most)


def _body_too_large(most: int) -> Refusal:
    return _body_refused(413, f"the body may have at most {most} bytes here")


def _body_refused(status: int, detail: str) -> Refusal:
    """Return the refusal of a body; it closes the connection, because the rest of the body is not read."""
    return Refusal(status, detail, headers={"Connection": "close"})
