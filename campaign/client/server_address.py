"""Checks of a server's address and of a token."""

import ipaddress
import os
from urllib.parse import urlsplit

from campaign.environment import SERVER, TOKEN
from campaign.errors import SpecError


def checked_address(url: str) -> str:
    """Return the address of a server as ``scheme://host[:port]``.

    Raises SpecError if it is invalid, contains a secret, or would send a token over the network without TLS.
    """
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


def is_loopback(host: str) -> bool:
    """Return whether a host name or address is that of this machine (loopback)."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def checked_token(token: str | None) -> str:
    """Return a token, by default the value of the environment variable ``CLEARCAP_TOKEN``.

    Raises SpecError, without quoting the token, if there is none or it has characters that no token has.
    """
    found = (os.environ.get(TOKEN, "") if token is None else token).strip()
    if not found:
        raise SpecError(
            f"no token: make one on the server's page Account, and put it into the environment variable {TOKEN};"
            f" {SERVER} may name the server"
        )
    if not (found.isascii() and found.isprintable() and " " not in found):
        raise SpecError("the token has characters that no token has; copy it once more, as the server showed it")
    return found
