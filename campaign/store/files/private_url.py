"""The URL of a store and its secrets: only opening the file system uses the full URL, all else sees it redacted.

A secret is the password of ``ftp://user:password@host``, or the value of a parameter such as ``?token=...``. The full
URL is kept here and in the `CampaignAddress` that is sent to workers, and nowhere else.
"""

import html
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import zip_longest
from urllib.parse import quote, quote_plus, unquote, unquote_plus

HIDDEN = "***"
SHORTEST = 6  # characters; a shorter secret is only searched for with its context, as it would match anywhere
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")
_SECRET_NAMES = re.compile(r"token|sig|pass|pwd|secret|key|cred|auth|session|code|jwt|sas", re.IGNORECASE)
_PARAMETER = re.compile(r"([?&;#])([^=&?#;]+)=((?:(?!::)[^&#;])*)")


@dataclass(frozen=True, repr=False)
class PrivateUrl:
    """A folder's path or a URL, also a chained one, whose secrets are not shown."""

    full: str  # with its secrets

    @cached_property
    def shown(self) -> str:
        """The URL with ``***`` in place of each secret."""
        shown, end = "", 0
        for begin, stop, _ in self._places:
            shown += self.full[end:begin] + HIDDEN
            end = stop
        return shown + self.full[end:]

    @cached_property
    def has_secrets(self) -> bool:
        """Whether the URL has secrets."""
        return bool(self._places)

    def __str__(self) -> str:
        return self.shown

    def __repr__(self) -> str:
        return f"PrivateUrl({self.shown!r})"

    def redact(self, text: str) -> str:
        """Return a text, such as the message of a library, without the secrets."""
        if not self.has_secrets:
            return text
        text = text.replace(self.full, self.shown)
        for secret, hidden in self._forms:
            text = text.replace(secret, hidden)
        return text

    def is_in(self, content: bytes) -> bool:
        """Return whether content to be stored contains a secret, plain or as JSON, HTML or URLs write it."""
        return any(secret.encode() in content for secret, _ in self._forms)

    @cached_property
    def _places(self) -> list[tuple[int, int, str]]:
        """Begin and end of each secret in the URL, and the text before it that identifies it, such as the user."""
        schemes = list(_SCHEME.finditer(self.full))
        places = []
        for scheme, following in zip_longest(schemes, schemes[1:]):
            start, end = scheme.end(), following.start() if following else len(self.full)
            login = _login(self.full[start:end])
            user, colon, password = login.partition(":")
            if password:
                places.append((start + len(user) + 1, start + len(login), f"{user}:"))
            elif user and not colon and scheme[0].startswith("http"):
                places.append((start, start + len(login), "//"))  # a token in place of a user
            for match in _PARAMETER.finditer(self.full, start + len(login), end):
                if match[3] and _SECRET_NAMES.search(match[2]):
                    places.append((match.start(3), match.end(3), f"{match[2]}="))
        return places

    @cached_property
    def _forms(self) -> list[tuple[str, str]]:
        """Each form in which a secret may be written, with its replacement; the longest first."""
        forms = {}
        for begin, end, before in self._places:
            after = "@" if before.endswith((":", "//")) else ""
            for form in _spellings(self.full[begin:end]):
                forms[f"{before}{form}{after}"] = f"{before}{HIDDEN}{after}"
                if len(form) >= SHORTEST:
                    forms[form] = HIDDEN
        # the longest first: a short form within a longer one would leave the rest of that in the text
        return sorted(forms.items(), key=lambda item: -len(item[0]))


def _login(rest: str) -> str:
    """Return the user and password in the text after ``scheme://``; empty if there are none."""
    # A password with a slash, which is invalid in a URL, is recognized all the same, because it must not be shown.
    authority = re.split(r"[/?#]", rest, maxsplit=1)[0]
    if "@" in authority:
        return authority.rpartition("@")[0]
    # digits alone after the colon are a port, and the "@" is part of the path
    if "@" in rest and re.fullmatch(r"[^:\[\]]*:(?!\d*$).*", authority):
        return rest.rpartition("@")[0]
    return ""


def _spellings(secret: str) -> Iterator[str]:
    """Yield the ways in which URLs, JSON and HTML write a secret."""
    for plain in dict.fromkeys((secret, unquote(secret), unquote_plus(secret))):
        yield from (plain, quote(plain), quote(plain, safe=""), quote_plus(plain))
        for ascii_only in (False, True):
            yield json.dumps(plain, ensure_ascii=ascii_only)[1:-1]
        yield html.escape(plain)
        yield re.sub("%[0-9A-F]{2}", lambda code: code[0].lower(), quote(plain, safe=""))
