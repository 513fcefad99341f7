"""An export, a ZIP with a campaign and its sign-offs: written as a stream, and read with distrust."""

import hashlib
import io
import os
import stat
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile, ZipInfo

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

from campaign.errors import CampaignError, SpecError
from campaign.store import Store
from campaign.store.files.files import LARGEST
from engine.platform.regular_file import UnfitFile, read_regular_file

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
    sink = _Sink()
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


class _Sink(io.RawIOBase):
    """A buffer for written bytes until they are sent; it cannot seek, so no byte changes after it was sent."""

    def __init__(self) -> None:
        super().__init__()
        self._written = bytearray()

    def writable(self) -> bool:
        """Return True."""
        return True

    def write(self, content: "bytes | bytearray | memoryview") -> int:  # type: ignore[override]  # any buffer
        """Add bytes to the buffer; return their number."""
        self._written += content
        return len(content)

    def taken(self) -> bytes:
        """Return the bytes written since the last call."""
        content = bytes(self._written)
        self._written.clear()
        return content


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
    """Open an export: a ZIP file, or the folder unpacked from it; raise SpecError if there is nothing.

    Raises UnfitArchive if it is neither, or contains links, names that lead out of it, duplicate names, or too much
    data.
    """
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
