"""Sign-offs: signed documents on who approved which bytes of a campaign, verifiable by anybody without the server.

An export, a ZIP with a campaign and its sign-offs, is written as a stream, and read with distrust.
"""

import hashlib
import json
import os
import re
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile, ZipInfo

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat, load_pem_public_key
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from campaign.errors import CampaignError, SpecError
from campaign.plan_header import PlanHeader
from campaign.store import Store
from campaign.store.files.files import LARGEST, TEMPORARY
from campaign.store.layout import CAMPAIGN_FILE, PLAN, REPEATS, REPORT, STOPPED
from campaign.store.repeat_sets import repeat_plans
from clearcap.questions.exported_rows import SentBytes
from engine.platform.regular_file import UnfitFile, read_regular_file

LONGEST_COMMENT = 5000  # characters

Digest = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class Signoff(BaseModel):
    """The content that an approver signed; file names are relative to the campaign's folder."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)
    kind: Literal["clearcap sign-off"] = "clearcap sign-off"
    format: Literal[1] = 1
    campaign: str = Field(description="Id of the campaign", examples=["c60-0a1b2c3d4e"])
    plan: Digest = Field(description="SHA-256 of plan.json", examples=["0f" * 32])
    rows: Digest = Field(description="Digest over names and SHA-256 of all files of rows", examples=["1e" * 32])
    report: Digest = Field(description="Digest over names and SHA-256 of the report's files", examples=["2d" * 32])
    files: dict[str, Digest] = Field(description="SHA-256 of each file", examples=[{"plan.json": "0f" * 32}])
    signer: str = Field(examples=["ada"])
    role: str = Field(examples=["approver"])
    time: str = Field(description="When it was signed, ISO 8601 in UTC", examples=["2026-11-23T09:00:00Z"])
    comment: str = Field(examples=["checked against drawing 4711"])
    submitted_by: str = Field(description="Who submitted the campaign, as its store says", examples=["eva"])
    is_submitter: bool = Field(description="The signer also submitted the campaign: no second pair of eyes")
    previous: Digest | None = Field(description="Digest of the campaign's sign-off before; null for the first")

    @model_validator(mode="after")
    def _digests_fit(self) -> "Signoff":
        """Raise ValueError if the digests are not those of the listed files."""
        if (self.plan, self.rows, self.report) != digests_of(self.files):
            raise ValueError("its digests are not those of its files")
        return self

    def to_bytes(self) -> bytes:
        """Return the canonical bytes of the document, which are signed."""
        return canonical(self.model_dump())


def canonical(content: Any) -> bytes:
    """Return plain data as canonical JSON for signing: sorted keys, no spaces, UTF-8."""
    return json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()


def sha256(content: bytes) -> str:
    """Return a SHA-256 as 64 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def digests_of(files: Mapping[str, str]) -> tuple[str, str, str]:
    """Return the digests of the plan, the rows and the report, given the SHA-256 of each file by name.

    Rows are all files that belong neither to the plan nor to the report: parts, repeats, and the documents on the end
    of the table and on further repeats.
    """
    report = {name: value for name, value in files.items() if part_of(name) == "report"}
    rows = {name: value for name, value in files.items() if part_of(name) == "rows"}
    return files.get(PLAN, ""), sha256(canonical(rows)), sha256(canonical(report))


def part_of(name: str) -> str:
    """Return the part of a campaign that a file belongs to: ``plan``, ``rows`` or ``report``."""
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
        if name not in found:
            words.append(f"{part_of(name)}: {name} is missing")
        elif name not in signed:
            words.append(f"{part_of(name)}: {name} was not signed")
        elif signed[name] != found[name]:
            words.append(f"{part_of(name)}: {name} differs")
    return words


def fingerprint(key: Ed25519PublicKey) -> str:
    """Return the fingerprint of a server's key: the SHA-256 of its 32 bytes."""
    return sha256(key.public_bytes_raw())


def sign(document: bytes, key: Ed25519PrivateKey) -> bytes:
    """Return the signature of a document, 64 bytes."""
    return key.sign(document)


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
    documents = [name for name in (STOPPED, REPEATS) if store.files.exists(f"{campaign}/{name}")]
    reports = [f"{REPORT}/{name}" for name in store.files.names(f"{campaign}/{REPORT}") if not name.endswith(TEMPORARY)]
    return [PLAN, CAMPAIGN_FILE, *documents, *_files_of_rows(store, header), *reports]


def digest_file(store: Store, campaign: str, name: str) -> str:
    """Return the SHA-256 of a file of a campaign; FileNotFoundError if it does not exist."""
    return sha256(store.files.read(f"{campaign}/{name}"))


def signed_files(
    store: Store, header: PlanHeader, digest: Callable[[Store, str, str], str] = digest_file
) -> dict[str, str]:
    """Return the SHA-256 of each file that a sign-off covers, in its current state in the store.

    `digest` returns that of a file by store, campaign and name; by default it reads the file.
    """
    found = {}
    for name in signed_names(store, header):
        try:
            found[name] = digest(store, header.campaign_id, name)
        except FileNotFoundError:  # removed since the listing
            continue
    return found


def check_whole(store: Store, header: PlanHeader) -> None:
    """Raise CampaignError, with the remedy, unless a campaign has all its rows, all of them sound, and a report."""
    for table in (header, *repeat_plans(store, header)):
        survey = store.survey(table, verify=True)
        if survey.bad:
            raise CampaignError(f"{header.campaign_id}: {next(iter(survey.bad.values()))}; compute it again first")
        if survey.missing:
            batches = len(survey.missing)
            raise CampaignError(f"{header.campaign_id}: {batches} batches have no rows; continue the campaign first")
    if not store.files.names(f"{header.campaign_id}/{REPORT}"):
        raise CampaignError(f"{header.campaign_id} has no report; write it first: an approver signs what it says")


def _files_of_rows(store: Store, header: PlanHeader) -> Iterator[str]:
    """Yield the names of the files that hold the rows and the repeats."""
    for table in (header, *repeat_plans(store, header)):
        held = {part.file for part in store.survey(table).parts.values()}
        yield from (f"{table.folder}/{name}" for name in sorted(held))


SIGNOFFS = "signoffs"  # folder of the documents
KEY = f"{SIGNOFFS}/key.pem"
MOST_FILES = 200_000
MOST_BYTES = 2**36  # of all files together, 64 GiB
_CHUNK = 2**20


@dataclass(frozen=True)
class SignedDocument:
    """A stored sign-off: the canonical bytes of the document, and their signature."""

    document: bytes
    signature: bytes


def document_name(number: int) -> str:
    """Return the name of the document of a sign-off by its number, from 1."""
    return f"{SIGNOFFS}/{number:04d}.json"


def signature_name(number: int) -> str:
    """Return the name of the signature of a sign-off by its number, from 1."""
    return f"{SIGNOFFS}/{number:04d}.sig"


def stream_export(
    store: Store, campaign: str, names: Sequence[str], signed: Sequence[SignedDocument], key: Ed25519PublicKey
) -> Iterator[bytes]:
    """Yield the bytes of a ZIP with files of a campaign, its sign-offs, oldest first, and the key that verifies them.

    Each piece is one file, the last one the directory. Raises FileNotFoundError if a file no longer exists; the ZIP is
    then incomplete, and no program can open it.
    """
    sink = SentBytes()
    with ZipFile(sink, "w", ZIP_STORED) as archive:
        for name in names:
            archive.writestr(_entry(campaign, name), store.files.read(f"{campaign}/{name}"))
            yield sink.taken()
        for number, each in enumerate(signed, start=1):
            archive.writestr(_entry(campaign, document_name(number)), each.document)
            archive.writestr(_entry(campaign, signature_name(number)), each.signature)
            yield sink.taken()
        pem = key.public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
        archive.writestr(_entry(campaign, KEY), pem)
    yield sink.taken()


def _entry(campaign: str, name: str) -> ZipInfo:
    """Return the header of a file in the ZIP; it has no date, so that equal campaigns give equal ZIPs."""
    entry = ZipInfo(f"{campaign}/{name}")
    entry.external_attr = (stat.S_IFREG | 0o644) << 16
    return entry


class UnfitArchive(CampaignError):
    """The archive is not an export of a campaign; the message names the file at fault and the fault."""


class Archive(Protocol):
    """The files of an export; names are relative to the campaign's folder."""

    campaign: str  # name of the campaign's folder
    names: frozenset[str]

    def read(self, name: str, at_most: int) -> bytes:
        """Return the content of a file; UnfitArchive if it cannot be read or has more than ``at_most`` bytes."""

    def digest(self, name: str) -> str:
        """Return the SHA-256 of a file; UnfitArchive if it cannot be read."""


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
        self.campaign, names = _without_top(path, [entry.filename for entry in entries])
        self._entries = dict(zip(names, entries, strict=True))
        if len(self._entries) < len(entries):
            twice = sorted(name for name in names if names.count(name) > 1)[0]
            raise UnfitArchive(f"{path}: has {twice!r:.200} twice; an export has each file once")
        self.names = frozenset(self._entries)

    def read(self, name: str, at_most: int) -> bytes:
        """Return the content of a file."""
        return b"".join(self._chunks(name, at_most))

    def digest(self, name: str) -> str:
        """Return the SHA-256 of a file."""
        digest = hashlib.sha256()
        for chunk in self._chunks(name, LARGEST):
            digest.update(chunk)
        return digest.hexdigest()

    def _chunks(self, name: str, at_most: int) -> Iterable[bytes]:
        """Yield the content of a file in chunks; UnfitArchive if it has more than ``at_most`` bytes."""
        if name not in self._entries:
            raise UnfitArchive(f"{self._path}: {name} is missing")
        size = 0
        try:
            with ZipFile(self._path) as archive, archive.open(self._entries[name]) as file:
                while chunk := file.read(_CHUNK):
                    size += len(chunk)
                    if size > at_most:  # the size that the ZIP states may be wrong
                        raise UnfitArchive(f"{self._path}: {name} has more than {at_most} bytes")
                    yield chunk
        except (BadZipFile, OSError, EOFError, ValueError, NotImplementedError, RuntimeError) as error:
            raise UnfitArchive(f"{self._path}: {name} is damaged ({error})") from error
        except Exception as error:
            if type(error).__module__ != "zlib":  # zipfile lets zlib.error, a plain Exception, through
                raise
            raise UnfitArchive(f"{self._path}: {name} is damaged ({error})") from error


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

    def digest(self, name: str) -> str:
        """Return the SHA-256 of a file."""
        return hashlib.sha256(self.read(name, LARGEST)).hexdigest()


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
    """Refuse more files, or more bytes, than an export has."""
    if len(sizes) > MOST_FILES or sum(sizes) > MOST_BYTES:
        raise UnfitArchive(f"{path}: has {len(sizes)} files of {sum(sizes)} bytes; allowed: {MOST_FILES}, {MOST_BYTES}")


def _without_top(path: Path, names: list[str]) -> tuple[str, list[str]]:
    """Return the single folder that all names begin with, and the names below it."""
    tops = {name.split("/")[0] for name in names}
    if len(tops) != 1 or any("/" not in name for name in names):
        raise UnfitArchive(f"{path}: is not an export: it does not hold the folder of one campaign")
    return tops.pop(), [name.partition("/")[2] for name in names]


LARGEST_SIGNOFF = 64 * 2**20  # bytes; a sign-off lists every file
_LARGEST_KEY = 10_000  # bytes
_DOCUMENT = re.compile(rf"{SIGNOFFS}/(\d{{4,}})\.json")


@dataclass(frozen=True)
class VerifiedSignoff:
    """A sign-off of an export with a valid signature."""

    number: int  # from 1, the oldest first
    signoff: Signoff
    differences: list[str]  # between the files of the export and the signed files


@dataclass(frozen=True)
class Verification:
    """The result of verifying an export."""

    campaign: str
    key: str  # fingerprint of the key in the export
    signoffs: list[VerifiedSignoff]  # the valid ones, the oldest first
    faults: list[str]  # why the export is not what was signed last; empty if it is


def verify_export(archive: Archive, key: str | None = None) -> Verification:
    """Verify an export; raise UnfitArchive if a file of it cannot be read.

    It is sound if there are no faults: every signature is valid, each sign-off refers to the one before, and the last
    one covers exactly these files. `key` is the fingerprint of the server's key from another source; without it,
    anybody could have made the export with a key of their own.
    """
    public = _public_key(archive)
    found = {name: archive.digest(name) for name in archive.names if not name.startswith(f"{SIGNOFFS}/")}
    signed, faults = list[VerifiedSignoff](), list[str]()
    if key is not None and key.lower().replace(":", "") != fingerprint(public):
        faults.append(f"key: the export has the key {fingerprint(public)}, not {key}")
    count = sum(1 for name in archive.names if _DOCUMENT.fullmatch(name))
    known = {KEY} | {name(number) for number in range(1, count + 1) for name in (document_name, signature_name)}
    faults += [f"sign-offs: {name} belongs to no sign-off" for name in sorted(_documents(archive) - known)]
    faults += [] if count else ["sign-offs: there is none"]
    previous = None
    for number in range(1, count + 1):
        try:
            document, signoff = _signoff(archive, number, public)
        except CampaignError as error:
            faults.append(f"sign-off {number}: {error}")
            # the next ones cannot be shown to follow it
            break
        if signed and signoff.campaign != signed[0].signoff.campaign:
            faults.append(f"sign-off {number}: is of another campaign, {signoff.campaign}")
        if signoff.previous != previous:
            faults.append(f"sign-off {number}: does not follow the one before: one was removed or inserted")
        previous = sha256(document)
        signed.append(VerifiedSignoff(number, signoff, differences(signoff.files, found)))
    if signed and signed[-1].differences:
        faults += [f"signed version differs: {words}" for words in signed[-1].differences]
    campaign = signed[-1].signoff.campaign if signed else archive.campaign
    return Verification(campaign, fingerprint(public), signed, faults)


def _documents(archive: Archive) -> set[str]:
    """Return the names of all files among the sign-offs."""
    return {name for name in archive.names if name.startswith(f"{SIGNOFFS}/")}


def _public_key(archive: Archive) -> Ed25519PublicKey:
    """Return the key of an export."""
    try:
        key = load_pem_public_key(archive.read(KEY, _LARGEST_KEY))
    except (ValueError, UnsupportedAlgorithm) as error:
        raise UnfitArchive(f"{KEY}: is not a public key; get the export from the server again") from error
    if not isinstance(key, Ed25519PublicKey):
        raise UnfitArchive(f"{KEY}: is a key of another kind than Ed25519; a server has none of that kind")
    return key


def _signoff(archive: Archive, number: int, key: Ed25519PublicKey) -> tuple[bytes, Signoff]:
    """Return the document of a sign-off as bytes and as a model."""
    document = archive.read(document_name(number), LARGEST_SIGNOFF)
    if not is_signed(document, archive.read(signature_name(number), 64), key):
        raise CampaignError(f"{document_name(number)} was changed, or the key of {KEY} did not sign it")
    try:
        return document, Signoff.model_validate_json(document)
    except ValidationError as error:
        first = error.errors()[0]
        raise CampaignError(f"{document_name(number)}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error
