"""Middleware for HEAD requests, which are answered with the head of the answer to GET."""

from starlette.types import ASGIApp, Message, Receive, Scope, Send

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
