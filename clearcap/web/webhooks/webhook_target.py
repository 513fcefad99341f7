"""Checks of where news may be sent: by TLS, and into the server's own network only to hosts that an admin allows."""

import ipaddress
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from urllib.parse import urlsplit

from campaign.errors import SpecError

LONGEST_URL = 2000  # characters
# networks whose addresses embed IPv4 addresses, which may be private
_TRANSLATED = [ipaddress.ip_network(each) for each in ("64:ff9b::/96", "64:ff9b:1::/48", "2002::/16", "2001::/32")]


@dataclass(frozen=True)
class WebhookTarget:
    """The parts of a webhook's address."""

    scheme: str
    host: str
    port: int
    rest: str  # path and query
    is_allowed: bool  # the configuration names the host, so that it may be in the server's own network

    @property
    def authority(self) -> str:
        """Host and port as in the header ``Host``."""
        shown = f"[{self.host}]" if ":" in self.host else self.host
        return shown if self.port == (443 if self.scheme == "https" else 80) else f"{shown}:{self.port}"


def webhook_target(url: str, allowed: Iterable[str]) -> WebhookTarget:
    """Check the address of a webhook, without looking up its host; the configuration names the hosts `allowed`.

    Raises SpecError if the URL is invalid, or if news may not be sent there.
    """
    try:
        parts = urlsplit(url)
        host, port = (parts.hostname or "").rstrip("."), parts.port
    except ValueError as error:
        raise SpecError(f"url = {url!r:.200}: not an address ({error})") from error
    is_allowed = host in {each.lower() for each in allowed}
    if len(url) > LONGEST_URL or not (url.isascii() and url.isprintable() and " " not in url) or not host:
        raise SpecError(f"url = {url!r:.200}: not an address; write https://HOST/PATH")
    if parts.username is not None or parts.password is not None or parts.fragment:
        raise SpecError("url: holds a user, a password or a fragment; news is signed instead: check the signature")
    if parts.scheme != "https" and not (parts.scheme == "http" and is_allowed and _is_loopback(host)):
        raise SpecError(f"url = {url!r:.200}: news is sent by https only")
    rest = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    return WebhookTarget(parts.scheme, host, port or (443 if parts.scheme == "https" else 80), rest, is_allowed)


def target_addresses(target: WebhookTarget) -> list[str]:
    """Look up the addresses of a target and check that news may be sent to each.

    Raises SpecError if the host has no address, or one in the server's own network that the configuration does not
    allow.
    """
    try:
        found = socket.getaddrinfo(target.host, target.port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        raise SpecError(f"url: the host {target.host:.200} has no address ({error})") from error
    addresses = list(dict.fromkeys(str(each[4][0]) for each in found))
    if not target.is_allowed:
        for address in addresses:
            if not is_public(address):
                raise SpecError(
                    f"url: the host {target.host:.200} is in the server's own network; an admin may allow it in the"
                    ' configuration: [webhooks] allow = ["HOST"]'
                )
    return addresses


def is_public(address: str) -> bool:
    """Return whether an address is on the public internet, not in a private, local or translated network."""
    try:
        parsed = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return False
    mapped = getattr(parsed, "ipv4_mapped", None)
    if mapped is not None:
        return is_public(str(mapped))
    is_translated = any(parsed in network for network in _TRANSLATED if network.version == parsed.version)
    return parsed.is_global and not (parsed.is_multicast or parsed.is_reserved or is_translated)


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
