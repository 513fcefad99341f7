"""Verify an export without the server: who signed what, and whether the files are the signed ones."""

import re
from dataclasses import dataclass

from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import load_pem_public_key
from pydantic import ValidationError

from campaign.errors import CampaignError
from clearcap.questions.signing.signed_export import KEY, SIGNOFFS, Archive, UnfitArchive, document_name, signature_name
from clearcap.questions.signing.signoff_document import Signoff, differences, fingerprint, is_signed, sha256

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
    """Return the document of a sign-off as bytes and as a model.

    Raises CampaignError if it cannot be read, was not signed with the key, or is not a valid sign-off.
    """
    document = archive.read(document_name(number), LARGEST_SIGNOFF)
    if not is_signed(document, archive.read(signature_name(number), 64), key):
        raise CampaignError(f"{document_name(number)} was changed, or the key of {KEY} did not sign it")
    try:
        return document, Signoff.model_validate_json(document)
    except ValidationError as error:
        first = error.errors()[0]
        raise CampaignError(f"{document_name(number)}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error
