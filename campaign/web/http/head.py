"""HEAD: the head of the answer that GET would get."""

from starlette.types import ASGIApp, Message, Receive, Scope, Send

ONCE = ("/login/", "/shared/")  # where GET is no safe method: it begins a session, by a link that may work only once


class Head:
    """Answer HEAD as GET, and send no body (RFC 9110, section 9.3.2); what looks at a link must not use it up.

    Parameters
    ----------
    app : ASGI application
        It knows GET alone.
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
            await send({"type": "http.response.body"})  # so that an answer without an end, such as events, ends here

        await self._app(asked, receive, send_head)
