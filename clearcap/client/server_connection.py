"""Requests to a server: checked address and token, verified TLS, harmless repetition, and refusals as errors."""

import logging
import os
import random
import ssl
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self
from urllib.parse import urlsplit

from campaign.errors import CampaignError, SpecError, StoreError, UnreachableError
from campaign.processes import SERVER, TOKEN, is_loopback

if TYPE_CHECKING:
    from engine.errors import Fault


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
LONGEST_DETAIL = 20_000  # characters
MOST_FAULTS = 100

# httpx logs each URL at the level INFO; it contains no secret, but the lines would be noise
logging.getLogger("httpx").setLevel(logging.WARNING)


class ServerConnection:
    """A connection to one server, by TLS unless it is this machine; `ca` has its authorities, else the system's."""

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
        """Return the answer to a request below ``/api/v1``, sent again if that may help and `repeats` without harm."""
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


def checked_address(url: str) -> str:
    """Return ``scheme://host[:port]``; SpecError if the address has a secret, or would send a token without TLS."""
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise SpecError(f"server {url!r:.120}: not an address ({error}); write https://HOST") from error
    if parts.username is not None or parts.password is not None or parts.query or parts.fragment:
        raise SpecError(
            f"server {parts.hostname}: the address holds more than a host and a port, and addresses are logged; put"
            f" the token into the environment variable {TOKEN}"
        )
    if parts.scheme not in ("http", "https") or not host or parts.path not in ("", "/"):
        raise SpecError(f"server {url!r:.120}: not the address of a server; write https://HOST or https://HOST:PORT")
    if parts.scheme == "http" and not is_loopback(host):
        raise SpecError(
            f"server {url!r:.120}: over http others read the token and the results on the way; write https://{host}"
        )
    shown = f"[{host}]" if ":" in host else host
    return f"{parts.scheme}://{shown}" + (f":{port}" if port is not None else "")


def checked_token(token: str | None) -> str:
    """Return a token, by default that of ``CLEARCAP_TOKEN``; SpecError, without quoting it, if it cannot be one."""
    found = (os.environ.get(TOKEN, "") if token is None else token).strip()
    if not found:
        raise SpecError(
            f"no token: make one on the server's page Account, and put it into the environment variable {TOKEN};"
            f" {SERVER} may name the server"
        )
    if not (found.isascii() and found.isprintable() and " " not in found):
        raise SpecError("the token has characters that no token has; copy it once more, as the server showed it")
    return found


def error_of(address: str, response: "httpx.Response") -> CampaignError:
    """Return the error for a refusal: SpecError if a change of the request helps, StoreError if only waiting does."""
    status, problem = response.status_code, _problem(response)
    detail = str(problem.get("detail") or f"answered with status {status}")[:LONGEST_DETAIL]
    message = f"server {address}: {detail}"
    if status == 401:
        message += "; a token may have expired, or may have been revoked: make another on the server's page Account"
    if 300 <= status < 400:
        message += "; it sends to another address, which gets no token: name that address if you trust it"
    if status >= 500:
        return StoreError(message)
    if status in (409, 429):
        return CampaignError(message)
    return SpecError(message, _faults(problem.get("faults")))


def _problem(response: "httpx.Response") -> dict[str, Any]:
    """Return the problem details of an answer; an empty dict if it has none."""
    try:
        document = response.json()
    except ValueError:  # the answer of a proxy or of another kind of server
        return {}
    return document if isinstance(document, dict) else {}


def _faults(listed: Any) -> "list[Fault]":
    """Return the faults of problem details; entries of another form are left out."""
    tables = [each for each in listed if isinstance(each, dict)] if isinstance(listed, list) else []
    if not tables:
        return []
    from engine.errors import Fault  # imported here, because it loads the engine

    return [
        Fault(
            tuple(map(str, table.get("keys") or ())),
            str(table.get("text", "")),
            value=table.get("value"),
            line=table["line"] if isinstance(table.get("line"), int) else None,
        )
        for table in tables[:MOST_FAULTS]
    ]
