"""The server's part in sign-offs: its signing key, the documents it has signed, and checks that they still hold."""

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)

from campaign.coordinator.state import state_of
from campaign.errors import CampaignError, SpecError
from campaign.store import Store
from campaign.store.layout import SUBMISSION
from clearcap.questions.signing import (
    SignedDocument,
    Signoff,
    check_whole,
    content_digest,
    differences,
    digest_file,
    digests_of,
    sha256,
    sign,
    signed_files,
    signed_names,
    stream_export,
)
from clearcap.web.access import Principal
from clearcap.web.access.database import Database
from engine.platform.regular_file import read_regular_file

KEY_FILE = "signing_key.pem"
_LARGEST_KEY = 10_000  # bytes
_SETTLED = 2.0  # s after the last change of a file; from then on, a further change shows in the file's times
_READ_WITHIN = 20.0  # s that a request waits while another one reads files
_MOST_DIGESTS = 200_000  # that are cached


@dataclass(frozen=True)
class KeptSignoff:
    """A sign-off kept by this server."""

    number: int  # among the sign-offs of its campaign, from 1
    digest: str  # SHA-256 of its document
    signoff: Signoff
    differences: list[str]  # between the files as they are now and as they were signed


class SigningService:
    """Sign campaigns for approvers, and check whether the signed files have changed.

    The key of this server is a file beside the database; it is generated if there is none. Raises SpecError if the file
    holds no valid key, or if other users can read it.
    """

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
            return signed_files(self._store, self._store.plan_header(campaign), self._digest)

    def signoffs(self, campaign: str, *, anew: bool = False) -> list[KeptSignoff]:
        """Return the sign-offs of a campaign, oldest first, with the differences since then; see `content`."""
        kept = self._kept(campaign)
        if not kept:
            return []
        found, made = self.content(campaign, anew=anew), []
        for number, each in enumerate(kept, start=1):
            signoff = Signoff.model_validate_json(each.document)
            made.append(KeptSignoff(number, sha256(each.document), signoff, differences(signoff.files, found)))
        return made

    def submitter(self, campaign: str) -> str:
        """Return the user who submitted a campaign; an empty string if the store does not say who."""
        user = (self._store.read_json(campaign, SUBMISSION) or {}).get("user")
        return user if isinstance(user, str) else ""

    def sign(self, campaign: str, who: Principal, comment: str, content: str) -> Signoff:
        """Sign the plan, rows and report of a campaign in the name of an approver.

        `content` is the `content_digest` of the files that the approver has looked at. An approver who repeats a
        request, because its answer was lost, gets the existing sign-off: the last one of the campaign, if it has the
        same signer, comment and content. Raises CampaignError if the campaign is not completed, is damaged, or has
        changed since the approver looked at it. For TimeoutError see `content`.
        """
        state = state_of(self._store, campaign)["state"]
        if state != "completed":
            raise CampaignError(f"{campaign} is {state}; only what is completed is signed")
        check_whole(self._store, self._store.plan_header(campaign))
        # read before the transaction, because no other request can write to the database during it
        files = self.content(campaign, anew=True)
        if content_digest(files) != content:
            raise CampaignError(f"{campaign} has changed since you looked at it; read the report again, then sign")
        submitter = self.submitter(campaign)
        plan, rows, report = digests_of(files)
        with self._database.write() as connection:
            # in the same transaction as the insertion, so that two sign-offs cannot both follow the same one
            last = connection.execute(
                "SELECT document FROM signoffs WHERE campaign = ? ORDER BY id DESC LIMIT 1", (campaign,)
            ).fetchone()
            earlier = None if last is None else Signoff.model_validate_json(last["document"])
            if earlier and (earlier.signer, earlier.comment, earlier.files) == (who.name, comment, files):
                return earlier
            signoff = Signoff(
                campaign=campaign,
                plan=plan,
                rows=rows,
                report=report,
                files=files,
                signer=who.name,
                role=who.role.word,
                time=datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
                comment=comment,
                submitted_by=submitter,
                is_submitter=submitter == who.name,
                previous=None if last is None else sha256(last["document"].encode()),
            )
            document = signoff.to_bytes()
            connection.execute(
                "INSERT INTO signoffs (campaign, document, signature) VALUES (?, ?, ?)",
                (campaign, document.decode(), sign(document, self.key).hex()),
            )
        return signoff

    def export(self, campaign: str) -> Iterator[bytes]:
        """Yield the bytes of a ZIP file with a campaign and its sign-offs; see `stream_export`."""
        names = signed_names(self._store, self._store.plan_header(campaign))
        return stream_export(self._store, campaign, names, self._kept(campaign), self.key.public_key())

    def _kept(self, campaign: str) -> list[SignedDocument]:
        rows = self._database.rows("SELECT document, signature FROM signoffs WHERE campaign = ? ORDER BY id", campaign)
        return [SignedDocument(row["document"].encode(), bytes.fromhex(row["signature"])) for row in rows]

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
        mark = _mark(store, f"{campaign}/{name}")
        known = self._digests.get((campaign, name))
        if known is not None and mark is not None and known[0] == mark:
            return known[1]
        digest = digest_file(store, campaign, name)
        if len(self._digests) >= _MOST_DIGESTS:
            self._digests.clear()
        self._digests[campaign, name] = mark, digest
        return digest


def _mark(store: Store, name: str) -> object:
    """Return a value that differs after any change of a file.

    None if no value certainly would: just after a change, and for a store behind a URL.
    """
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
