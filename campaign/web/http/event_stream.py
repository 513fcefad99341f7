"""A long-lived event stream, which counts toward its user's limit and ends with the user's login."""

from collections import Counter
from collections.abc import AsyncGenerator, AsyncIterator
from contextlib import aclosing

from fastapi import Request
from starlette.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from campaign.web.http.asking import is_still_known


class EventStream(StreamingResponse):
    """An answer that sends events as they come, until the request's session or token ends.

    It is counted when it is created, not when it starts, so that simultaneous requests cannot exceed the limit.
    `counts` holds the number of open streams by user.
    """

    def __init__(self, request: Request, events: AsyncGenerator[bytes], counts: Counter[str], user: str) -> None:
        sent = _while_known(request, events)
        # X-Accel-Buffering keeps nginx from holding events back
        super().__init__(sent, media_type="text/event-stream", headers={"X-Accel-Buffering": "no"})
        self._counts, self._user = counts, user
        counts[user] += 1

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the events."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._counts[self._user] -= 1


async def _while_known(request: Request, events: AsyncGenerator[bytes]) -> AsyncIterator[bytes]:
    """Yield events as long as the session or token of a request is valid."""
    async with aclosing(events):
        async for event in events:
            if not is_still_known(request):
                return
            yield event
