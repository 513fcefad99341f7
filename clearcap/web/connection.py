"""HTTP connections that cut off a client whose request head is too slow or too long, or that reads no answer."""

import asyncio
import socket
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from clearcap.web.settings import Limits

LARGEST_HEAD = 64 * 1024  # bytes, of a request's first line and headers
SLOWEST_READER = 1024  # bytes/s of an answer that a client must read at least
SEND_BUFFER = 256 * 1024  # bytes; with a larger buffer the system would report too late what a client has read


class BoundedConnection(HttpToolsProtocol):
    """A connection that limits the size and arrival time of each request head and requires that answers are read.

    Uvicorn has none of these limits: a thousand connections that never finish their heads, or never read an answer,
    would keep everybody else out, and one endless header would fill the memory. `RequestLimits` limits the bodies.
    """

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
        if (connected := transport.get_extra_info("socket")) is not None:
            connected.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        transport.set_write_buffer_limits(high=0)  # so that `resume_writing` is called when everything was read
        self._expect_head()
        self._watch_reader(0)

    def data_received(self, data: bytes) -> None:
        """Process received bytes."""
        is_idle = self.cycle is None or self.cycle.response_complete
        if is_idle and self._deadline is None:  # after an answer; also for blank lines, which do not begin a request
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

    def _watch_reader(self, waiting: int) -> None:
        """Check periodically that the client reads a buffered answer fast enough; abort the connection if not.

        `waiting` is the size of the write buffer at the last check [bytes].
        """
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
