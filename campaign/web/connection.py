"""One connection: a client that sends a head too slowly or without an end, or takes no answer, is cut off."""

import asyncio
import socket
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from campaign.web.settings import Limits

LARGEST_HEAD = 64 * 1024  # bytes, of a request's first line and headers
SLOWEST_READER = 1024  # bytes/s that whoever asks must take of his answer
SEND_BUFFER = 256 * 1024  # bytes that the system keeps of an answer: of a large one it tells too late what was taken


class BoundedConnection(HttpToolsProtocol):
    """A connection on which each head has a limited size and must arrive in limited time, and each answer be taken.

    Uvicorn limits nothing of that: a thousand connections that never finish their heads, or never read an answer, would
    keep everybody else out, and one endless header would fill the memory. Bodies are limited by the gate.
    """

    _deadline: asyncio.TimerHandle | None = None
    _reader_watch: asyncio.TimerHandle | None = None
    _head_bytes = 0
    _is_in_head = False
    _has_taken = True  # since the reader was looked at

    @property
    def _limits(self) -> Limits:
        limits: Limits = self.config.app.state.service.settings.limits  # type: ignore[union-attr]  # FastAPI
        return limits

    def connection_made(self, transport: Any) -> None:
        """Wait for the first request."""
        super().connection_made(transport)
        if (connected := transport.get_extra_info("socket")) is not None:
            connected.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        transport.set_write_buffer_limits(high=0)  # so that `resume_writing` says that all was taken
        self._expect_head()
        self._watch_reader(0)

    def data_received(self, data: bytes) -> None:
        """Take what has arrived."""
        is_idle = self.cycle is None or self.cycle.response_complete
        if is_idle and self._deadline is None:  # after an answer; also for blank lines, which begin no request
            self._expect_head()
        super().data_received(data)
        if self._is_in_head or self._deadline is not None:  # also of a second request, while the first is at work
            self._head_bytes += len(data)
            if self._head_bytes > LARGEST_HEAD:
                self._cut("431 Request Header Fields Too Large")

    def on_message_begin(self) -> None:
        """Begin a head."""
        self._is_in_head = True
        super().on_message_begin()

    def on_header(self, name: bytes, value: bytes) -> None:
        """Take a header; what comes behind a body (trailers) nobody asks for, and it may be without an end."""
        if self._is_in_head:
            super().on_header(name, value)

    def on_headers_complete(self) -> None:
        """Go on with the body."""
        self._is_in_head, self._head_bytes = False, 0
        self._forget_deadline()
        super().on_headers_complete()

    def resume_writing(self) -> None:
        """Go on with an answer: what waited was taken."""
        self._has_taken = True
        super().resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """End."""
        self._forget_deadline()
        if self._reader_watch is not None:
            self._reader_watch.cancel()
        super().connection_lost(exc)

    def _watch_reader(self, waiting: int) -> None:
        """Look now and then whether something is taken of an answer that waits to be sent.

        Parameters
        ----------
        waiting : int
            What had to be sent the last time [bytes].
        """
        left, seconds = self.transport.get_write_buffer_size(), self._limits.read_seconds
        if waiting and not self._has_taken and left > waiting - SLOWEST_READER * seconds:
            self.transport.abort()
            return
        self._has_taken = not left
        self._reader_watch = self.loop.call_later(seconds, self._watch_reader, left)

    def _expect_head(self) -> None:
        """Begin to count the time and size of a head."""
        self._head_bytes = 0
        self._deadline = self.loop.call_later(self._limits.head_seconds, self._cut, "408 Request Timeout")

    def _forget_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _cut(self, status: str) -> None:
        """Answer, unless another answer is on its way, and close the connection."""
        self._forget_deadline()
        if self.cycle is not None and self.cycle.response_started and not self.cycle.response_complete:
            self.transport.abort()
        elif not self.transport.is_closing():
            self.transport.write(f"HTTP/1.1 {status}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n".encode())
            self.transport.close()
