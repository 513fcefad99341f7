"""One connection of the server: a client that sends the head of a request too slowly, or without an end, is cut off."""

import asyncio
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

LARGEST_HEAD = 64 * 1024  # bytes, of a request's first line and headers


class BoundedConnection(HttpToolsProtocol):
    """A connection on which the head of each request has a limited size and must arrive in limited time.

    Uvicorn limits neither: a thousand connections that never finish their heads would keep everybody else out, and one
    endless header would fill the memory. Bodies are limited by the gate.
    """

    _deadline: asyncio.TimerHandle | None = None
    _head_bytes = 0

    @property
    def _seconds(self) -> float:
        """The time that a head may take [s]."""
        seconds: float = self.config.app.state.service.settings.limits.head_seconds  # type: ignore[union-attr]  # FastAPI
        return seconds

    def connection_made(self, transport: Any) -> None:
        """Wait for the first request."""
        super().connection_made(transport)
        self._expect_head()

    def data_received(self, data: bytes) -> None:
        """Take what has arrived."""
        is_idle = self.cycle is None or self.cycle.response_complete
        if is_idle and self._deadline is None:  # after an answer; also for blank lines, which begin no request
            self._expect_head()
        super().data_received(data)
        if self._deadline is not None:
            self._head_bytes += len(data)
            if self._head_bytes > LARGEST_HEAD:
                self._cut("431 Request Header Fields Too Large")

    def on_headers_complete(self) -> None:
        """Go on with the body."""
        self._forget_deadline()
        super().on_headers_complete()

    def connection_lost(self, exc: Exception | None) -> None:
        """End."""
        self._forget_deadline()
        super().connection_lost(exc)

    def _expect_head(self) -> None:
        """Begin to count the time and size of a head."""
        self._head_bytes = 0
        self._deadline = self.loop.call_later(self._seconds, self._cut, "408 Request Timeout")

    def _forget_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _cut(self, status: str) -> None:
        """Answer, and close the connection."""
        self._forget_deadline()
        if not self.transport.is_closing():
            self.transport.write(f"HTTP/1.1 {status}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n".encode())
            self.transport.close()
