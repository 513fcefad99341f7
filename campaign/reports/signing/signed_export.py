"""A ZIP with a campaign and its sign-offs, streamed so that it is never complete in memory or on a disk."""

import io
import stat
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from zipfile import ZIP_STORED, ZipFile, ZipInfo

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

from campaign.store import Store

SIGNOFFS = "signoffs"  # folder of the documents
KEY = f"{SIGNOFFS}/key.pem"


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
