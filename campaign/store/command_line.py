"""Commands about a campaign for messages, complete so that users can copy them."""

import os
import shlex
from typing import TYPE_CHECKING

from campaign.environment import STORE
from campaign.store.files.private_url import PrivateUrl

if TYPE_CHECKING:
    from campaign.store.files.files import Files


def command_line(files: "Files", verb: str, *words: str) -> str:
    """Return a complete ``clearcap`` command on a store: verb, arguments and further options, and the store."""
    return shlex.join(["clearcap", verb, *words, *store_option(files)])


def store_option(files: "Files") -> list[str]:
    """Return the command-line words that name the store.

    There are none if the environment names the store with a password, which no command line should contain.
    """
    named = os.environ.get(STORE)
    if files.has_secrets and named is not None and PrivateUrl(named).shown == files.url:
        return []
    return ["--store", files.url]
