"""The server's part in sign-offs: its signing key, the documents it has signed, and checks that they still hold."""

import logging
import os
import sqlite3
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, load_pem_private_key

from campaign.coordinator.lease import LeaseHeld, hold_lease
from campaign.coordinator.requests import being_signed, end_protection, is_protected, rerun_request
from campaign.coordinator.state import state_of
from campaign.errors import CampaignError, SpecError
from campaign.store import Store
from campaign.store.layout import REPORT, SUBMISSION
from clearcap.questions import signing
from clearcap.questions.report_source import deciding_campaigns, report_source, sha256, stored_at
from clearcap.web.access import Principal
from clearcap.web.access.database import KEY_FILE, Database
from engine.platform.regular_file import read_regular_file

logger = logging.getLogger(__name__)
_LARGEST_KEY = 10_000  # bytes
_SETTLED = 2.0  # s after the last change of a file; from then on, a further change shows in the file's times
_READ_WITHIN = 20.0  # s that a request waits while another one reads files
_MOST_DIGESTS = 200_000  # that are cached
_NEWEST = "SELECT document, (SELECT count(*) FROM signoffs) AS count FROM signoffs ORDER BY id DESC LIMIT 1"
_LAST_OF_EACH = "SELECT document FROM signoffs WHERE id IN (SELECT max(id) FROM signoffs GROUP BY campaign)"


@dataclass(frozen=True)
class KeptSignoff:
    """A sign-off kept by this server."""

    number: int  # among the sign-offs of its campaign, from 1
    digest: str  # SHA-256 of its document
    signoff: signing.Signoff | signing.Withdrawal
    differences: list[str]  # between the files as they are now and as they were signed; none for a withdrawal

    @property
    def status(self) -> str:
        """`signed`, `signed version differs` or `withdrawn`."""
        if isinstance(self.signoff, signing.Withdrawal):
            return "withdrawn"
        return "signed version differs" if self.differences else "signed"


class SigningService:
    """Sign campaigns for approvers by the key beside the database, and check whether signed files have changed."""

    def __init__(self, database: Database, store: Store) -> None:
        self._database, self._store = database, store
        self._lock = threading.Lock()
        self._digests: dict[tuple[str, str], tuple[object, str]] = {}
        self.key = _key(database.path.with_name(KEY_FILE))

    def content(self, campaign: str, *, anew: bool) -> dict[str, str]:
        """Return the SHA-256 of each file that a sign-off covers; only if `anew`, also those unchanged are read."""
        with self._reading():
            if anew:
                self._digests = {key: kept for key, kept in self._digests.items() if key[0] != campaign}
            return signing.signed_files(self._store, self._store.plan_header(campaign), self._digest)

    def signoffs(self, campaign: str, *, anew: bool = False) -> list[KeptSignoff]:
        """Return the sign-offs of a campaign, oldest first, with the differences since then; see `content`."""
        kept = self._kept(campaign)
        if not kept:
            return []
        found, made = self.content(campaign, anew=anew), []
        for number, each in enumerate(kept, start=1):
            signoff = signing.read_document(each.document)
            differ = signing.differences(signoff.files, found) if isinstance(signoff, signing.Signoff) else []
            made.append(KeptSignoff(number, sha256(each.document), signoff, differ))
        return made

    def submitter(self, campaign: str) -> str:
        """Return the user who submitted a campaign; an empty string if the store does not say who."""
        user = (self._store.read_json(campaign, SUBMISSION) or {}).get("user")
        return user if isinstance(user, str) else ""

    def sign(self, campaign: str, who: Principal, comment: str, content: str, again: Any) -> signing.Signoff:
        """Sign the plan, rows and report of a completed campaign for an approver, who has looked at `content`.

        `again` is what `report_written_again` gives. A request that is repeated, because its answer was lost, gets the
        same sign-off: the last one, if it has the same signer, comment and content.
        """
        header = self._store.plan_header(campaign)
        with ExitStack() as held:
            covered = (campaign, *deciding_campaigns(self._store, campaign))
            protections = [held.enter_context(being_signed(self._store, each)) for each in covered]
            state = state_of(self._store, campaign)["state"]
            if state != "completed":
                raise CampaignError(f"{campaign} is {state}; only what is completed is signed")
            if rerun_request(self._store, campaign) is not None:
                raise CampaignError(f"{campaign}: failed rows are to be computed again; wait for them")
            signing.check_whole(self._store, header)
            # read before the transaction, because no other request can write to the database during it
            files = self.content(campaign, anew=True)
            if signing.content_digest(files) != content:
                raise CampaignError(f"{campaign} has changed since you looked at it; read the report again, then sign")
            _check_report(campaign, files, report_source(self._store, header), again)
            submitter = self.submitter(campaign)
            parts: dict[str, Any] = dict(zip(("plan", "rows", "report"), signing.digests_of(files), strict=True))
            with self._database.write() as connection:
                chain = _Chain(connection, campaign)
                last = chain.last
                same = (who.name, comment, files)
                if isinstance(last, signing.Signoff) and (last.signer, last.comment, last.files) == same:
                    return last
                own: dict[str, Any] = {"submitted_by": submitter, "is_submitter": submitter == who.name}
                signoff = signing.Signoff(**chain.next(who, comment), **parts, files=files, **own)
                self._insert(connection, signoff)
                # before the transaction ends: without the marker nothing is signed
                for protection in protections:
                    protection(sha256(signoff.to_bytes()), who.name)
        return signoff

    def withdraw(self, campaign: str, who: Principal, comment: str) -> signing.Withdrawal:
        """Withdraw the last sign-off of a campaign, which can then be changed again; the reason is kept for ever."""
        with hold_lease(self._store, campaign), self._database.write() as connection:
            chain = _Chain(connection, campaign)
            if not isinstance(chain.last, signing.Signoff) or chain.last_digest is None:
                raise CampaignError(f"{campaign} is not signed; there is nothing to withdraw")
            withdrawal = signing.Withdrawal(**chain.next(who, comment), withdraws=chain.last_digest)
            self._insert(connection, withdrawal)
            for each in (campaign, *deciding_campaigns(self._store, campaign)):
                end_protection(self._store, each)
        return withdrawal

    def protect_signed(self) -> None:
        """Mark what is signed and not marked in the store: version 0.1 wrote no marker, and a backup may be older.

        A server that is killed while it signs may have the document, and leave the marker of a signer who crashed.
        What is being computed or changed, and all if the store cannot be written, is left for the next start.
        """
        try:
            self._protect(set(self._store.campaigns()))
        except (CampaignError, OSError) as error:
            logger.warning("what is signed may not be marked so in the store; the next start tries again: %s", error)

    def _protect(self, stored: set[str]) -> None:
        """Mark the signed ones of some campaigns."""
        for row in self._database.rows(_LAST_OF_EACH):
            signoff = signing.read_document(row["document"].encode())
            if not isinstance(signoff, signing.Signoff) or signoff.campaign not in stored:
                continue
            for each in (signoff.campaign, *deciding_campaigns(self._store, signoff.campaign)):
                if not is_protected(self._store, each):
                    with suppress(LeaseHeld), being_signed(self._store, each) as protect:
                        protect(sha256(row["document"].encode()), signoff.signer)

    def is_signed(self, campaign: str) -> bool:
        """Return whether a campaign has a sign-off that was not withdrawn."""
        row = self._database.row("SELECT document FROM signoffs WHERE campaign = ? ORDER BY id DESC LIMIT 1", campaign)
        return row is not None and isinstance(signing.read_document(row["document"].encode()), signing.Signoff)

    def has_documents(self, campaign: str) -> bool:
        """Return whether a campaign has sign-offs, withdrawn ones included."""
        return self._database.row("SELECT 1 FROM signoffs WHERE campaign = ?", campaign) is not None

    def export(self, campaign: str) -> Iterator[bytes]:
        """Yield the bytes of a ZIP file with a campaign and its sign-offs; see `stream_export`."""
        names = signing.signed_names(self._store, self._store.plan_header(campaign))
        kept, newest = self._kept(campaign), self._database.row(_NEWEST)
        head = signing.Head(
            time=signing.now_in_utc(),
            documents=0 if newest is None else newest["count"],
            newest=None if newest is None else sha256(newest["document"].encode()),
            campaign=campaign,
            of_campaign=len(kept),
            last=sha256(kept[-1].document) if kept else None,
        ).to_bytes()
        signed = signing.SignedDocument(head, self.key.sign(head))
        return signing.stream_export(self._store, campaign, names, kept, self.key.public_key(), signed)

    def _insert(self, connection: sqlite3.Connection, document: signing.Signoff | signing.Withdrawal) -> None:
        """Sign a document and add it to the chain."""
        content = document.to_bytes()
        connection.execute(
            "INSERT INTO signoffs (campaign, document, signature) VALUES (?, ?, ?)",
            (document.campaign, content.decode(), self.key.sign(content).hex()),
        )

    def _kept(self, campaign: str) -> list[signing.SignedDocument]:
        rows = self._database.rows("SELECT document, signature FROM signoffs WHERE campaign = ? ORDER BY id", campaign)
        return [signing.SignedDocument(row["document"].encode(), bytes.fromhex(row["signature"])) for row in rows]

    @contextmanager
    def _reading(self) -> Iterator[None]:
        """Hold the lock for reading files, because only one request reads at a time."""
        if not self._lock.acquire(timeout=_READ_WITHIN):
            raise TimeoutError
        try:
            yield
        finally:
            self._lock.release()

    def _digest(self, store: Store, campaign: str, name: str) -> str:
        """Return the digest of a file; the file is read only if it may have changed since it was last read."""
        mark = _mark(store, stored_at(campaign, name))
        known = self._digests.get((campaign, name))
        if known is not None and mark is not None and known[0] == mark:
            return known[1]
        digest = signing.digest_file(store, campaign, name)
        if len(self._digests) >= _MOST_DIGESTS:
            self._digests.clear()
        self._digests[campaign, name] = mark, digest
        return digest


class _Chain:
    """The ends of the chains of documents, read in the transaction of an insertion, so that no two follow the same."""

    def __init__(self, connection: sqlite3.Connection, campaign: str) -> None:
        self._campaign = campaign
        statement = "SELECT document FROM signoffs WHERE campaign = ? ORDER BY id DESC LIMIT 1"
        row, newest = connection.execute(statement, (campaign,)).fetchone(), connection.execute(_NEWEST).fetchone()
        self.last = None if row is None else signing.read_document(row["document"].encode())
        self.last_digest = None if row is None else sha256(row["document"].encode())
        self._number = 1 if newest is None else newest["count"] + 1
        self._before = None if newest is None else sha256(newest["document"].encode())

    def next(self, who: Principal, comment: str) -> dict[str, Any]:
        """Return the fields that every document has, for the one that follows."""
        return {
            "campaign": self._campaign,
            "signer": who.name,
            "role": who.role.word,
            "time": signing.now_in_utc(),
            "comment": comment,
            "previous": self.last_digest,
            "number": self._number,
            "before": self._before,
        }


def _check_report(campaign: str, files: dict[str, str], source: dict[str, str], again: Mapping[str, Any]) -> None:
    """Raise CampaignError unless the files of a report are those written again, from the rows that are there now."""
    if again["source"] != source:
        raise CampaignError(f"{campaign}: its rows have changed just now; read the report again, then sign")
    found = {
        name.removeprefix(f"{REPORT}/"): digest for name, digest in files.items() if signing.part_of(name) == "report"
    }
    other = sorted(name for name in found.keys() | again["files"].keys() if found.get(name) != again["files"].get(name))
    if other:
        raise CampaignError(
            f"{campaign}: {REPORT}/{other[0]} is not what this server writes from these rows: it is of other rows, was"
            " changed, or was written by another version or on another machine; write the report again, read it, sign"
        )


def _mark(store: Store, name: str) -> object:
    """Return what differs after any change of a file; None if nothing surely would: just changed, or behind a URL."""
    if not store.files.local:
        return None
    status = os.lstat(store.files.path(name))
    is_settled = time.time() - max(status.st_mtime, status.st_ctime) > _SETTLED
    return (status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns) if is_settled else None


def _key(path: Path) -> Ed25519PrivateKey:
    """Return the key in a file; generate the file if it is missing."""
    if not path.exists():
        # The file gets its name when it is complete and on the disk, so that a crash leaves no broken key. Others
        # cannot read it at any moment.
        made, unfinished = Ed25519PrivateKey.generate(), path.with_suffix(".new")
        unfinished.unlink(missing_ok=True)
        with open(os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            file.write(made.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(path)
    if path.stat().st_mode & 0o077:
        raise SpecError(f"{path}: others can read the key of sign-offs; chmod 600 it, if nobody has")
    try:
        key = load_pem_private_key(read_regular_file(path, _LARGEST_KEY), None)
    except (ValueError, TypeError) as error:
        raise SpecError(f"{path}: is not a sign-off key ({error}); restore it from a backup") from error
    if not isinstance(key, Ed25519PrivateKey):
        raise SpecError(f"{path}: is a key of another kind than Ed25519; restore it from a backup")
    return key
