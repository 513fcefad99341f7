"""A stream of events that is open for long: it counts among those of its user, and ends with his login."""

from collections import Counter
from collections.abc import AsyncGenerator, AsyncIterator
from contextlib import aclosing

from fastapi import Request
from starlette.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from campaign.web.http.asking import is_still_known


class EventStream(StreamingResponse):
    """An answer that follows something.

    It counts from its first moment: many that begin at once cannot all be the last one that is allowed.

    Parameters
    ----------
    request : Request
        When its session or token ends, the next event is not sent, nor any after it.
    events : async generator of bytes
    counts : Counter of str
        Open streams by user.
    user : str
        Who follows.
    """

    def __init__(self, request: Request, events: AsyncGenerator[bytes], counts: Counter[str], user: str) -> None:
        sent = _while_known(request, events)
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
    """Yield events as long as the session or token of a request has not ended."""
    async with aclosing(events):
        async for event in events:
            if not is_still_known(request):
                return
            yield event
