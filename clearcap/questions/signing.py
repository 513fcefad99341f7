"""Sign-offs: signed documents on who approved which bytes of a campaign, verifiable by anybody without the server.

An export, a ZIP with a campaign and its sign-offs, is written as a stream, and read with distrust.
"""

import os
import stat
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal, Protocol
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile, ZipInfo

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, model_validator

from campaign.errors import CampaignError, SpecError
from campaign.plan_header import PlanHeader
from campaign.store import Store
from campaign.store.files.files import LARGEST, TEMPORARY
from campaign.store.layout import CAMPAIGN_FILE, PLAN, REPORT
from clearcap.questions.exported_rows import SentBytes
from clearcap.questions.report_source import canonical, documents_of, sha256, stored_at, tables_of
from engine.platform.regular_file import UnfitFile, read_regular_file

LONGEST_COMMENT = 5000  # characters

Digest = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class _Document(BaseModel):
    """What a server signs; two chains show that none was removed: of the campaign's documents, and of the server's."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)
    format: Literal[1, 2] = Field(2, description="1 if written by version 0.1: without the chain of the server")
    campaign: str = Field(description="Id of the campaign", examples=["c60-0a1b2c3d4e"])
    signer: str = Field(examples=["ada"])
    role: str = Field(examples=["approver"])
    time: str = Field(description="When it was signed, ISO 8601 in UTC", examples=["2026-11-23T09:00:00Z"])
    comment: str = Field(examples=["checked against drawing 4711"])
    previous: Digest | None = Field(description="Digest of the campaign's document before; null for the first")
    number: int | None = Field(None, ge=1, description="Among all documents of the server", examples=[12])
    before: Digest | None = Field(None, description="Digest of the server's document before; null for the first")

    def to_bytes(self) -> bytes:
        """Return the canonical bytes of the document, which are signed."""
        return canonical(self.model_dump(exclude={"number", "before"} if self.format == 1 else None))


class Withdrawal(_Document):
    """An approver's statement that the last sign-off of a campaign no longer holds."""

    kind: Literal["clearcap withdrawal"] = "clearcap withdrawal"
    withdraws: Digest = Field(description="Digest of the sign-off", examples=["0f" * 32])


class Signoff(_Document):
    """The content that an approver signed; file names are relative to the campaign's folder."""

    kind: Literal["clearcap sign-off"] = "clearcap sign-off"
    plan: Digest = Field(description="SHA-256 of plan.json", examples=["0f" * 32])
    rows: Digest = Field(description="Digest over names and SHA-256 of all files of rows", examples=["1e" * 32])
    report: Digest = Field(description="Digest over names and SHA-256 of the report's files", examples=["2d" * 32])
    files: dict[str, Digest] = Field(description="SHA-256 of each file", examples=[{"plan.json": "0f" * 32}])
    submitted_by: str = Field(description="Who submitted the campaign, as its store says", examples=["eva"])
    is_submitter: bool = Field(description="The signer also submitted the campaign: no second pair of eyes")

    @model_validator(mode="after")
    def _digests_fit(self) -> "Signoff":
        if (self.plan, self.rows, self.report) != digests_of(self.files):
            raise ValueError("its digests are not those of its files")
        return self


class Head(BaseModel):
    """What a server had signed when it exported a campaign: shows that the export lacks no later document."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)
    kind: Literal["clearcap head"] = "clearcap head"
    format: Literal[1] = 1
    time: str = Field(description="When it was exported, ISO 8601 in UTC")
    documents: int = Field(description="Of the server")
    newest: Digest | None = Field(description="Digest of the server's newest document")
    campaign: str
    of_campaign: int = Field(description="Documents of the campaign")
    last: Digest | None = Field(description="Digest of the campaign's last document")

    def to_bytes(self) -> bytes:
        """Return the canonical bytes, which are signed."""
        return canonical(self.model_dump())


_DOCUMENTS: TypeAdapter[Signoff | Withdrawal] = TypeAdapter(
    Annotated[Signoff | Withdrawal, Field(discriminator="kind")]
)


def read_document(content: bytes) -> Signoff | Withdrawal:
    """Return a sign-off or a withdrawal from its bytes; ValidationError if it is neither."""
    return _DOCUMENTS.validate_json(content)


def now_in_utc() -> str:
    """Return the present time as documents state it."""
    return datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


def digests_of(files: Mapping[str, str]) -> tuple[str, str, str]:
    """Return the digests of the plan, the rows and the report, given the SHA-256 of each file by name."""
    parts = ({name: value for name, value in files.items() if part_of(name) == part} for part in ("rows", "report"))
    rows, report = (sha256(canonical(part)) for part in parts)
    return files.get(PLAN, ""), rows, report


def part_of(name: str) -> str:
    """Return the part of a campaign that a file belongs to: ``plan``, ``report``, or ``rows`` for all else."""
    if name in (PLAN, CAMPAIGN_FILE):
        return "plan"
    return "report" if name.startswith(f"{REPORT}/") else "rows"


def content_digest(files: Mapping[str, str]) -> str:
    """Return one digest of all files to be signed, by which approvers state what they have looked at."""
    return sha256(canonical(dict(files)))


def differences(signed: Mapping[str, str], found: Mapping[str, str]) -> list[str]:
    """Describe the differences from the signed files, one per file; empty if all bytes are the same."""
    words = []
    for name in sorted(signed.keys() | found.keys()):
        if signed.get(name) != found.get(name):
            what = "is missing" if name not in found else "was not signed" if name not in signed else "differs"
            words.append(f"{part_of(name)}: {name} {what}")
    return words


def fingerprint(key: Ed25519PublicKey) -> str:
    """Return the fingerprint of a server's key: the SHA-256 of its 32 bytes."""
    return sha256(key.public_bytes_raw())


def is_signed(document: bytes, signature: bytes, key: Ed25519PublicKey) -> bool:
    """Return whether the signature of a document was made with a key."""
    try:
        key.verify(signature, document)
    except InvalidSignature:
        return False
    return True


def signed_names(store: Store, header: PlanHeader) -> list[str]:
    """Return the names of all files that a sign-off would cover now, relative to the campaign's folder."""
    campaign = header.campaign_id
    reports = [f"{REPORT}/{name}" for name in store.files.names(f"{campaign}/{REPORT}") if not name.endswith(TEMPORARY)]
    rows = []
    for where, table in tables_of(store, header):
        held = {part.file for part in store.survey(table).parts.values()}
        rows += [f"{where}{table.folder}/{name}" for name in sorted(held)]
    return [PLAN, CAMPAIGN_FILE, *documents_of(store, header), *rows, *reports]


def digest_file(store: Store, campaign: str, name: str) -> str:
    """Return the SHA-256 of a file of a campaign; FileNotFoundError if it does not exist."""
    return sha256(store.files.read(stored_at(campaign, name)))


def signed_files(
    store: Store, header: PlanHeader, digest: Callable[[Store, str, str], str] = digest_file
) -> dict[str, str]:
    """Return the SHA-256 of each file that a sign-off covers now, by `digest` of store, campaign and name."""
    found = {}
    for name in signed_names(store, header):
        with suppress(FileNotFoundError):  # removed since the listing
            found[name] = digest(store, header.campaign_id, name)
    return found


def check_whole(store: Store, header: PlanHeader) -> None:
    """Raise CampaignError, with the remedy, unless a campaign has all its rows, all of them sound, and a report."""
    for _, table in tables_of(store, header):
        survey = store.survey(table, verify=True)
        if survey.bad:
            raise CampaignError(f"{table.campaign_id}: {next(iter(survey.bad.values()))}; compute it again first")
        if survey.missing:
            batches = len(survey.missing)
            raise CampaignError(f"{table.campaign_id}: {batches} batches have no rows; continue the campaign first")
    check_reported(store, header.campaign_id)


def check_reported(store: Store, campaign_id: str) -> None:
    """Raise CampaignError, with the remedy, unless a campaign has a report."""
    if not store.files.names(f"{campaign_id}/{REPORT}"):
        raise CampaignError(f"{campaign_id} has no report; write it first: an approver signs what it says")


SIGNOFFS = "signoffs"  # folder of the documents
KEY = f"{SIGNOFFS}/key.pem"
HEAD, HEAD_SIGNATURE = f"{SIGNOFFS}/head.json", f"{SIGNOFFS}/head.sig"
MOST_FILES = 200_000
MOST_BYTES = 2**36  # of all files together, 64 GiB


@dataclass(frozen=True)
class SignedDocument:
    """A stored sign-off: the canonical bytes of the document, and their signature."""

    document: bytes
    signature: bytes


def document_names(number: int) -> tuple[str, str]:
    """Return the names of the document of a sign-off and of its signature by its number, from 1."""
    return f"{SIGNOFFS}/{number:04d}.json", f"{SIGNOFFS}/{number:04d}.sig"


def stream_export(
    store: Store,
    campaign: str,
    names: Sequence[str],
    signed: Sequence[SignedDocument],
    key: Ed25519PublicKey,
    head: SignedDocument | None = None,
) -> Iterator[bytes]:
    """Yield the bytes of a ZIP with files of a campaign, its sign-offs, oldest first, and the key that verifies them.

    ``head`` shows that no later document is missing.

    Each piece is one file, the last one the directory. Raises FileNotFoundError if a file no longer exists; the ZIP is
    then incomplete, and no program can open it.
    """
    sink = SentBytes()

    def contents() -> Iterator[tuple[str, bytes]]:
        yield from ((name, store.files.read(stored_at(campaign, name))) for name in names)
        documents = [(document_names(number), each) for number, each in enumerate(signed, start=1)]
        documents += [] if head is None else [((HEAD, HEAD_SIGNATURE), head)]
        for (name, name_of_signature), each in documents:
            yield from ((name, each.document), (name_of_signature, each.signature))
        yield KEY, key.public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)

    with ZipFile(sink, "w", ZIP_STORED) as archive:
        for name, content in contents():
            entry = ZipInfo(f"{campaign}/{name}")  # without a date: equal campaigns give equal ZIPs
            entry.external_attr = (stat.S_IFREG | 0o644) << 16
            archive.writestr(entry, content)
            yield sink.taken()
    yield sink.taken()


class UnfitArchive(CampaignError):
    """The archive is not an export of a campaign; the message names the file at fault and the fault."""


class Archive(Protocol):
    """The files of an export; names are relative to the campaign's folder."""

    campaign: str  # name of the campaign's folder
    names: frozenset[str]

    def read(self, name: str, at_most: int) -> bytes:
        """Return the content of a file; UnfitArchive if it cannot be read or has more than ``at_most`` bytes."""


def open_archive(path: Path) -> Archive:
    """Open an export: a ZIP file, or the folder unpacked from it; raise SpecError if there is nothing."""
    if path.is_dir():
        return FolderArchive(path)
    if not path.exists():
        raise SpecError(f"{path}: no such file or folder; name the ZIP that the server exported, or its folder")
    return ZipArchive(path)


class ZipArchive:
    """An export as a ZIP file; see `Archive`."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            with ZipFile(path) as archive:
                entries = archive.infolist()
        except (BadZipFile, OSError, ValueError, NotImplementedError) as error:
            raise UnfitArchive(f"{path}: cannot be read as a ZIP ({error}); get it from the server again") from error
        for entry in entries:
            _check_entry(path, entry)
        _check_amount(path, [entry.file_size for entry in entries])
        names = [entry.filename for entry in entries]
        tops = {name.split("/")[0] for name in names}
        if len(tops) != 1 or any("/" not in name for name in names):
            raise UnfitArchive(f"{path}: is not an export: it does not hold the folder of one campaign")
        self.campaign, names = tops.pop(), [name.partition("/")[2] for name in names]
        self._entries = dict(zip(names, entries, strict=True))
        if len(self._entries) < len(entries):
            twice = sorted(name for name in names if names.count(name) > 1)[0]
            raise UnfitArchive(f"{path}: has {twice!r:.200} twice; an export has each file once")
        self.names = frozenset(self._entries)

    def read(self, name: str, at_most: int) -> bytes:
        """Return the content of a file."""
        if name not in self._entries:
            raise UnfitArchive(f"{self._path}: {name} is missing")
        try:
            with ZipFile(self._path) as archive, archive.open(self._entries[name]) as file:
                content = file.read(at_most + 1)
        except (BadZipFile, OSError, EOFError, ValueError, NotImplementedError, RuntimeError) as error:
            raise UnfitArchive(f"{self._path}: {name} is damaged ({error})") from error
        except Exception as error:
            if type(error).__module__ != "zlib":  # zipfile lets zlib.error, a plain Exception, through
                raise
            raise UnfitArchive(f"{self._path}: {name} is damaged ({error})") from error
        if len(content) > at_most:  # the size that the ZIP states may be wrong
            raise UnfitArchive(f"{self._path}: {name} has more than {at_most} bytes")
        return content


class FolderArchive:
    """An unpacked export; see `Archive`."""

    def __init__(self, path: Path) -> None:
        inner = [each for each in path.iterdir() if each.is_dir() and not each.is_symlink()]
        is_campaign = (path / "plan.json").exists()
        self._root = path if is_campaign or len(inner) != 1 else inner[0]
        self.campaign = self._root.resolve().name
        found: list[Path] = []
        for folder, folders, files in os.walk(self._root):
            for name in (*folders, *files):
                full = Path(folder, name)
                status = full.lstat()
                if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
                    raise UnfitArchive(f"{full}: is a link or no regular file; an export has none")
            found += [Path(folder, name) for name in files]
        _check_amount(path, [each.lstat().st_size for each in found])
        self.names = frozenset(each.relative_to(self._root).as_posix() for each in found)

    def read(self, name: str, at_most: int) -> bytes:
        """Return the content of a file."""
        if name not in self.names:
            raise UnfitArchive(f"{self._root}: {name} is missing")
        try:
            return read_regular_file(self._root / name, at_most, follow_link=False)
        except UnfitFile as error:
            raise UnfitArchive(f"{self._root / name}: {error.strerror}") from error
        except OSError as error:
            raise UnfitArchive(f"{self._root / name}: cannot be read ({error.strerror})") from error


def _check_entry(path: Path, entry: ZipInfo) -> None:
    """Refuse an entry that no export has."""
    name, mode = entry.filename, entry.external_attr >> 16
    parts = name.split("/")
    faults = {
        "a name that leads elsewhere": name.startswith(("/", "~")) or ".." in parts or "" in parts or "." in parts,
        "a name that no export has": not name.isprintable() or "\\" in name or ":" in name or len(name) > 500,
        "a link": stat.S_IFMT(mode) not in (0, stat.S_IFREG),
        "encryption": bool(entry.flag_bits & 1),
        "a compression that no export has": entry.compress_type not in (ZIP_STORED, ZIP_DEFLATED),
        f"more than {LARGEST} bytes": entry.file_size > LARGEST,
    }
    for fault, is_so in faults.items():
        if is_so:
            raise UnfitArchive(f"{path}: {name!r:.200} has {fault}; get the export from the server again")


def _check_amount(path: Path, sizes: list[int]) -> None:
    if len(sizes) > MOST_FILES or sum(sizes) > MOST_BYTES:
        raise UnfitArchive(f"{path}: has {len(sizes)} files of {sum(sizes)} bytes; allowed: {MOST_FILES}, {MOST_BYTES}")
