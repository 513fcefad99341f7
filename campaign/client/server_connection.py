"""Requests to a server, with a token and verified TLS, and repeated where that is harmless."""

import logging
import random
import ssl
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from campaign.client.server_address import checked_address, checked_token
from campaign.client.server_errors import error_of
from campaign.errors import SpecError, UnreachableError

try:
    import httpx
except ModuleNotFoundError as error:
    raise SpecError("asking a server needs the package httpx: pip install 'clearcap[client]'") from error

PREFIX = "/api/v1"
TIMES = httpx.Timeout(120.0, connect=10.0)  # s; an answer may need a simulation
TRIES = 5
FIRST_PAUSE, LONGEST_PAUSE = 0.5, 30.0  # s between two tries
LATER = (429, 502, 503, 504)  # statuses of a server that may answer later
MOST_CONNECTIONS = 8

# httpx logs each URL at the level INFO; it contains no secret, but the lines would be noise
logging.getLogger("httpx").setLevel(logging.WARNING)


class ServerConnection:
    """A connection to one server; ``http`` is allowed only for this machine.

    The token is by default that of ``CLEARCAP_TOKEN``, and `ca`, a PEM file, by default the authorities that the system
    trusts. Raises SpecError if the address, token or certificates cannot be used.
    """

    def __init__(self, address: str, token: str | None = None, ca: Path | str | None = None) -> None:
        self.address = checked_address(address)
        try:
            trusted = ssl.create_default_context(cafile=ca)
        except OSError as error:
            raise SpecError(f"ca {ca}: no certificates in PEM can be read there ({error})") from error
        self._http = httpx.Client(
            base_url=self.address,
            headers={"Authorization": f"Bearer {checked_token(token)}", "User-Agent": "clearcap"},
            verify=trusted,
            timeout=TIMES,
            limits=httpx.Limits(max_connections=MOST_CONNECTIONS),
            follow_redirects=False,  # the token must not go to another address
            trust_env=self.address.startswith("https:"),  # requests to this machine must not pass through a proxy
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"ServerConnection({self.address!r})"

    def close(self) -> None:
        """Close the connection."""
        self._http.close()

    def get(self, path: str, **more: Any) -> httpx.Response:
        """Return the answer to a GET request, which is repeated if the server does not answer."""
        return self.ask("GET", path, repeats=True, **more)

    def ask(self, method: str, path: str, *, repeats: bool = False, **more: Any) -> httpx.Response:
        """Return the answer to a request for a path below ``/api/v1``; raise the error of `error_of` if it is refused.

        With `repeats`, sending it twice does no harm, so it is sent again if the connection is lost or the server says
        that it can answer later. `more` are ``params``, ``json`` and ``headers``, as in httpx. Raises UnreachableError
        if there is no answer.
        """
        request = self._http.build_request(method, PREFIX + path, **more)
        for tried in range(1, TRIES + 1):
            is_last = tried == TRIES or not repeats
            try:
                response = self._http.send(request)
            except httpx.TransportError as error:
                if is_last:
                    raise self._unreachable(error) from error
                self.wait(tried)
                continue
            if response.is_success:
                return response
            if is_last or response.status_code not in LATER:
                raise error_of(self.address, response)
            self.wait(tried, response.headers.get("retry-after", ""))
        raise AssertionError("the last try returns or raises")

    @contextmanager
    def stream(self, path: str, **more: Any) -> Iterator[httpx.Response]:
        """Yield an answer whose body is read piece by piece in the block; raise the errors of `ask`."""
        try:
            with self._http.stream("GET", PREFIX + path, **more) as response:
                if not response.is_success:
                    response.read()
                    raise error_of(self.address, response)
                yield response
        except httpx.TransportError as error:
            raise self._unreachable(error) from error

    def wait(self, tried: int, asked: str = "") -> None:
        """Wait before the next try as long as the server asked for, or twice as long each time, but at most 30 s."""
        pause = FIRST_PAUSE * 2.0 ** (tried - 1) * random.uniform(0.7, 1.3)
        if asked.isdigit():
            pause = float(asked[:6])
        time.sleep(min(pause, LONGEST_PAUSE))

    def _unreachable(self, error: httpx.TransportError) -> UnreachableError:
        """Return the error for a lost connection."""
        reason = str(error) or type(error).__name__
        return UnreachableError(f"server {self.address}: cannot be reached ({reason}); the same command works later")
