"""Verbs of who operates a server: ``backup``, ``restore`` and ``doctor``."""

import os
import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from clearcap.cli.options import StoreUrl
from clearcap.cli.output import Json, print_json, print_text, say
from clearcap.cli.servers import data_folder

PASSPHRASE = "CLEARCAP_BACKUP_PASSPHRASE"  # environment variable
Data = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Folder of the server; by default the one of this store.")
]
Encrypted = Annotated[bool, typer.Option("--encrypted", help=f"The passphrase is in the variable {PASSPHRASE}.")]
File = Annotated[Path, typer.Argument(metavar="FILE", help="The backup.")]


def backup(
    file: File, store: StoreUrl = "runs", data: Data = None, encrypted: Encrypted = False, json: Json = False
) -> None:
    """Back up accounts, audit trail, sign-offs and signing key of a server, which may run meanwhile.

    Copy the store afterwards, as you copy other files: what is signed was there before it was signed.
    """
    from clearcap.web.maintenance import audit_fault, back_up

    folder = data or _folder_of(store)
    contents = back_up(folder, file, time.time(), _passphrase(encrypted))
    if json:
        print_json({"file": str(file), **asdict(contents)})
        return
    print_text(f"{file}: {_words(contents)}")
    if (entry := audit_fault(folder)) is not None:
        say(f"warning: entry {entry} of the audit trail was changed, or is missing")


def restore(
    file: File,
    store: StoreUrl = "runs",
    data: Data = None,
    check: Annotated[bool, typer.Option("--check", help="Only check the backup; write nothing.")] = False,
    encrypted: Encrypted = False,
    json: Json = False,
) -> None:
    """Make the folder of a server from a backup, and compare its sign-offs with the store.

    Restore the store first. A folder that holds anything is refused: move it away.
    """
    from clearcap.web.maintenance import check_backup
    from clearcap.web.maintenance import restore as restored

    folder = data or _folder_of(store)
    contents = check_backup(file, _passphrase(encrypted)) if check else restored(file, folder, _passphrase(encrypted))
    differing = [] if check else _differing(store, folder)
    if json:
        where = None if check else str(folder)
        print_json({"file": str(file), "data": where, **asdict(contents), "differing": differing})
    else:
        print_text(f"{file}: {'whole' if check else f'restored to {folder}'}: {_words(contents)}")
        for campaign in differing:
            say(f"warning: {campaign} is signed, and the store has not what was signed; restore the store too")
    if differing:
        raise typer.Exit(1)


def _differing(store: str, folder: Path) -> list[str]:
    """Return the signed campaigns that are not in the store as they were signed."""
    from contextlib import closing

    from campaign.errors import CampaignError
    from campaign.store import open_store
    from campaign.store.files.retry_policy import QUICK
    from clearcap.web.access.database import DATABASE, Database
    from clearcap.web.signing_service import SigningService

    opened, found = open_store(store, QUICK), []
    with closing(Database(folder / DATABASE)) as database:
        signing, stored = SigningService(database, opened), set(opened.campaigns())
        for row in database.rows("SELECT DISTINCT campaign FROM signoffs ORDER BY campaign"):
            campaign = row["campaign"]
            try:
                is_same = not signing.is_signed(campaign) or (
                    campaign in stored and not signing.signoffs(campaign, anew=True)[-1].differences
                )
            except CampaignError:
                is_same = False
            found += [] if is_same else [campaign]
    return found


def doctor(store: StoreUrl = "runs", data: Data = None, json: Json = False) -> None:
    """Look at a store and at the folder of its server: versions, access, room, clocks, queue, database.

    Exit status 1 if anything is at fault; nothing is changed.
    """
    from campaign.store import open_store
    from campaign.store.files.retry_policy import QUICK
    from clearcap.web.maintenance import FAULT, examine

    findings = examine(open_store(store, QUICK), data or _folder_of(store))
    if json:
        print_json([asdict(each) for each in findings])
    else:
        for each in findings:
            print_text(f"{each.status:8}{each.what:10}{each.text}")
    if any(each.status == FAULT for each in findings):
        raise typer.Exit(1)


def _folder_of(store: str) -> Path:
    """Return the folder of the server of a store."""
    from campaign.store import open_store

    return data_folder(open_store(store).files.full_url)


def _passphrase(encrypted: bool) -> str | None:
    """Return the passphrase for a backup; raise SpecError if it is missing."""
    from campaign.errors import SpecError

    if not encrypted:
        return None
    if not (passphrase := os.environ.get(PASSPHRASE)):
        raise SpecError(f"--encrypted: the environment variable {PASSPHRASE} is missing; set the passphrase")
    return passphrase


def _words(contents: object) -> str:
    """Return what a backup has, for the user."""
    from campaign.waits import counted
    from clearcap.web.maintenance import Contents

    assert isinstance(contents, Contents)
    parts = [counted(contents.users, "user"), counted(contents.signoffs, "signed document")]
    return (
        f"{', '.join(parts)}, {contents.audit} entries of the audit trail, the newest {contents.newest[:12] or 'none'}"
    )
