"""How users name a store and its campaigns: ids from their first letters, and commands that they can copy."""

import os
import re
import shlex
import stat
from collections.abc import Callable, Collection, Iterable, Sequence

from campaign.environment import STORE
from campaign.errors import SpecError
from campaign.store.files.files import Files
from campaign.store.files.private_url import PrivateUrl
from campaign.store.layout import PLAN

MOST_LISTED = 10  # ids in a message
_CAMPAIGN = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}")


def check_is_store(files: Files) -> None:
    """Raise SpecError unless the folder of a store exists and is not that of one campaign; a URL needs no folder."""
    if not files.local:
        return
    try:
        is_folder = stat.S_ISDIR(os.stat(files.full_url).st_mode)
    except (FileNotFoundError, NotADirectoryError):
        raise SpecError(
            f"store {files.url}: no such folder; name the folder of your results with --store, or make one:"
            f" {command_line(files, 'run', 'CAMPAIGN')}"
        ) from None
    except OSError:
        return  # reading it reports why it cannot be read
    if not is_folder:
        raise SpecError(f"store {files.url}: is a file, not a folder of campaigns; name the folder with --store")
    if files.exists(PLAN):
        parent, name = os.path.split(files.url.rstrip("/"))
        raise SpecError(
            f"store {files.url}: is the folder of one campaign, not a store; write {name} --store {parent or '.'}"
        )


def folders_of_campaigns(names: Iterable[str]) -> list[str]:
    """Return the names that are valid as the folder of a campaign, sorted."""
    return sorted(filter(_CAMPAIGN.fullmatch, names))


def which_campaign(
    files: Files,
    ids: Sequence[str],
    wanted: str | None,
    deciding: Callable[[Sequence[str]], Collection[str]] = lambda ids: (),
) -> str:
    """Return the id that a user means by it, by its first letters if no other begins so, or by None for the only one.

    Campaigns that only decide another one, as ``deciding`` tells of some ids, are meant only by their own names.
    """
    check_is_store(files)
    if not ids:
        raise SpecError(f"store {files.url}: holds no campaign; make one: {command_line(files, 'run', 'CAMPAIGN')}")
    if wanted is not None and wanted in ids:
        return wanted
    matching = [each for each in ids if wanted is None or (wanted and each.startswith(wanted))]
    if 1 < len(matching) <= MOST_LISTED:
        aimed = deciding(matching)
        matching = [each for each in matching if each not in aimed] or matching
    if len(matching) == 1:
        return matching[0]
    if wanted is None:
        raise SpecError(f"store {files.url}: name the campaign; its campaigns: {_listed(files, ids)}")
    if matching:
        raise SpecError(
            f"store {files.url}: {wanted} could be several campaigns: {_listed(files, matching)}; write more of it"
        )
    raise SpecError(f"store {files.url}: no campaign {wanted or repr(wanted)}; its campaigns: {_listed(files, ids)}")


def _listed(files: Files, ids: Sequence[str]) -> str:
    """Return the first ids in one line, and the number of further ones."""
    others = len(ids) - MOST_LISTED
    return ", ".join(ids[:MOST_LISTED]) + (
        f" and {others} more, see: {command_line(files, 'list')}" if others > 0 else ""
    )


def command_line(files: Files, verb: str, *words: str) -> str:
    """Return a complete ``clearcap`` command on a store: verb, arguments and further options, and the store."""
    return shlex.join(["clearcap", verb, *words, *store_option(files)])


def store_option(files: Files) -> list[str]:
    """Return the words that name the store; none if the environment names one with a password, which stays unseen."""
    named = os.environ.get(STORE)
    if files.has_secrets and named is not None and PrivateUrl(named).shown == files.url:
        return []
    return ["--store", files.url]
