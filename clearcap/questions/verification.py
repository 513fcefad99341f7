"""Verify an export without the server: who signed what, and whether the files are the signed ones."""

import json
import math
import re
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import load_pem_public_key
from pydantic import ValidationError

from campaign.errors import CampaignError
from campaign.store import open_store
from campaign.store.files.files import LARGEST
from campaign.store.layout import PLAN, REPORT
from campaign.store.parts import BadPart, read_seal
from clearcap.questions.report import analysis
from clearcap.questions.report_source import sha256, source_digests, stated_source, stored_at
from clearcap.questions.signing import (
    HEAD,
    HEAD_SIGNATURE,
    KEY,
    SIGNOFFS,
    Archive,
    Head,
    Signoff,
    UnfitArchive,
    Withdrawal,
    differences,
    document_names,
    fingerprint,
    is_signed,
    part_of,
    read_document,
)
from reporting.render.data_files import render_json
from reporting.write import NAMES

LARGEST_SIGNOFF = 64 * 2**20  # bytes; a sign-off lists every file
_LARGEST_KEY = _LARGEST_HEAD = 10_000  # bytes
MOST_DIFFERENCES = 20  # that are listed
# They say when, where and by what a report was written, and by whom the campaign was submitted: not what follows from
# the rows.
_OF_THE_WRITING = ("written", "ended", "author", "provenance", "replay", "drawing", "drawing_note")
_DOCUMENT = re.compile(rf"{SIGNOFFS}/(\d{{4,}})\.json")


@dataclass(frozen=True)
class VerifiedSignoff:
    """A sign-off of an export, or its withdrawal, with a valid signature."""

    number: int  # from 1, the oldest first
    signoff: Signoff | Withdrawal
    differences: list[str]  # between the files of the export and the signed files; none for a withdrawal


@dataclass(frozen=True)
class Verification:
    """The result of verifying an export."""

    campaign: str
    key: str  # fingerprint of the key in the export
    signoffs: list[VerifiedSignoff]  # the valid ones, the oldest first
    head: Head | None  # what the server had signed when it made the export; None before version 0.2
    faults: list[str]  # why the export is not what was signed last; empty if it is


def verify_export(archive: Archive, key: str | None = None) -> Verification:
    """Verify an export; raise UnfitArchive if a file of it cannot be read.

    It is sound if there are no faults: every signature is valid, each document refers to the one before and none is
    missing, the last one is a sign-off of exactly these files, and the report is that of these rows. `key` is the
    fingerprint of the server's key from another source; without it, anybody could have made the export with a key of
    their own.
    """
    public = _public_key(archive)
    found = {n: sha256(archive.read(n, LARGEST)) for n in archive.names if not n.startswith(f"{SIGNOFFS}/")}
    signed, faults = list[VerifiedSignoff](), list[str]()
    if key is not None and key.lower().replace(":", "") != fingerprint(public):
        faults.append(f"key: the export has the key {fingerprint(public)}, not {key}")
    count = sum(1 for name in archive.names if _DOCUMENT.fullmatch(name))
    known = {KEY, HEAD, HEAD_SIGNATURE, *(name for n in range(1, count + 1) for name in document_names(n))}
    others = {name for name in archive.names if name.startswith(f"{SIGNOFFS}/")} - known
    faults += [f"sign-offs: {name} belongs to no sign-off" for name in sorted(others)]
    faults += [] if count else ["sign-offs: there is none"]
    previous = None
    for number in range(1, count + 1):
        try:
            document, signoff = _signoff(archive, number, public)
        except CampaignError as error:
            faults.append(f"sign-off {number}: {error}")
            break  # the next ones cannot be shown to follow it
        if signed and signoff.campaign != signed[0].signoff.campaign:
            faults.append(f"sign-off {number}: is of another campaign, {signoff.campaign}")
        if signoff.previous != previous:
            faults.append(f"sign-off {number}: does not follow the one before: one was removed or inserted")
        previous = sha256(document)
        differ = differences(signoff.files, found) if isinstance(signoff, Signoff) else []
        signed.append(VerifiedSignoff(number, signoff, differ))
    head, of_head = _head(archive, public, [each.signoff for each in signed], previous)
    faults += of_head
    if signed:
        faults += _faults_of_last(signed[-1], archive)
    campaign = signed[-1].signoff.campaign if signed else archive.campaign
    return Verification(campaign, fingerprint(public), signed, head, faults)


def _head(
    archive: Archive, key: Ed25519PublicKey, signed: Sequence[Signoff | Withdrawal], last: str | None
) -> tuple[Head | None, list[str]]:
    """Return the head of an export, and its faults, given the valid documents and the digest of the last one."""
    if HEAD not in archive.names:
        is_needed = any(each.format > 1 for each in signed)
        return None, [f"{HEAD} is missing: a later document may have been removed"] if is_needed else []
    content = archive.read(HEAD, _LARGEST_HEAD)
    if not is_signed(content, archive.read(HEAD_SIGNATURE, 64), key):
        return None, [f"{HEAD} was changed, or the key of {KEY} did not sign it"]
    try:
        head = Head.model_validate_json(content)
    except ValidationError as error:
        return None, [f"{HEAD}: {error.errors()[0]['msg']}"]
    if signed and (head.campaign, head.of_campaign, head.last) != (signed[-1].campaign, len(signed), last):
        stated = f"{head.of_campaign} documents of {head.campaign}"
        return head, [f"{HEAD}: the server had signed {stated}, and these are others: some were removed"]
    return head, []


def _faults_of_last(last: VerifiedSignoff, archive: Archive) -> list[str]:
    if isinstance(last.signoff, Withdrawal):
        return [f"the sign-off was withdrawn by {last.signoff.signer}, {last.signoff.time}: {last.signoff.comment}"]
    if last.differences:
        return [f"signed version differs: {words}" for words in last.differences]
    return _other_rows(archive) if last.signoff.format > 1 else []


def _other_rows(archive: Archive) -> list[str]:
    """Return that the report states other digests than those of its plan and rows; empty if it does not.

    A server that signs writes the report again and so cannot sign another; this tells it of a server that could.
    """
    rows = [name for name in archive.names if part_of(name) == "rows" and not name.startswith(f"{SIGNOFFS}/")]
    documents = {name: archive.read(name, LARGEST) for name in rows if not name.endswith(".parquet")}
    try:
        seals = {name: read_seal(archive.read(name, LARGEST))[0] for name in rows if name.endswith(".parquet")}
        found = source_digests(archive.read(PLAN, LARGEST), documents, seals)
        stated = stated_source(archive.read(f"{REPORT}/{NAMES['json']}", LARGEST))
    except (BadPart, CampaignError) as error:
        return [f"report: whether it is of these rows cannot be told: {error}"]
    return [] if stated == found else ["report: was made of another plan or of other rows than those beside it"]


def recomputed(archive: Archive) -> list[str]:
    """Make the numbers of an export's report again from its rows; return the differences, in words.

    Numbers may differ by a billionth, as between two kinds of processors. Of a report by another version of clearcap,
    which words its sentences in another way and states other numbers besides, what both state is compared. Raises
    CampaignError if the rows cannot be read. Verify the export first: this reads its rows as the program reads its own.
    """
    with tempfile.TemporaryDirectory(prefix="clearcap-verify-") as folder:
        for name in archive.names:
            if part_of(name) != "report" and not name.startswith(f"{SIGNOFFS}/"):
                path = Path(folder, stored_at(archive.campaign, name))
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(archive.read(name, LARGEST))
        store = open_store(folder)
        plan = store.plan(archive.campaign)
        made = json.loads(render_json(analysis(store, plan)))
    stated = json.loads(archive.read(f"{REPORT}/{NAMES['json']}", LARGEST))
    both = stated.get("provenance"), made["provenance"]
    same_version = isinstance(both[0], dict) and both[0].get("clearcap") == both[1]["clearcap"]
    for document in (made, stated):
        for name in _OF_THE_WRITING:
            document.pop(name, None)
    return list(islice(_unequal(stated, made, "", same_version=same_version), MOST_DIFFERENCES))


def _unequal(stated: Any, made: Any, where: str, *, same_version: bool) -> Iterator[str]:
    """Yield the places at which two documents differ, with both values."""
    if isinstance(stated, dict) and isinstance(made, dict):
        for name in sorted(stated.keys() | made.keys() if same_version else stated.keys() & made.keys()):
            place = f"{where}.{name}" if where else name
            yield from _unequal(stated.get(name), made.get(name), place, same_version=same_version)
    elif isinstance(stated, list) and isinstance(made, list) and len(stated) == len(made):
        for position, pair in enumerate(zip(stated, made, strict=True)):
            yield from _unequal(*pair, f"{where}[{position}]", same_version=same_version)
    elif not same_version and (_is_sentence(stated) or _is_sentence(made)):
        return
    elif isinstance(stated, float) and isinstance(made, float):
        if not math.isclose(stated, made, rel_tol=1e-9, abs_tol=1e-12):
            yield f"{where} is {stated!r}, and {made!r} when it is made again from the rows"
    elif stated != made and not (isinstance(stated, str) and "clearcap " in stated):  # a command names its store
        yield f"{where} is {stated!r:.80}, and {made!r:.80} when it is made again from the rows"


def _is_sentence(value: Any) -> bool:
    """Return whether a value is a sentence, or a list of them: a verdict or a name is not."""
    if isinstance(value, list):
        return bool(value) and all(map(_is_sentence, value))
    return isinstance(value, str) and value.count(" ") > 3


def _public_key(archive: Archive) -> Ed25519PublicKey:
    try:
        key = load_pem_public_key(archive.read(KEY, _LARGEST_KEY))
    except (ValueError, UnsupportedAlgorithm) as error:
        raise UnfitArchive(f"{KEY}: is not a public key; get the export from the server again") from error
    if not isinstance(key, Ed25519PublicKey):
        raise UnfitArchive(f"{KEY}: is a key of another kind than Ed25519; a server has none of that kind")
    return key


def _signoff(archive: Archive, number: int, key: Ed25519PublicKey) -> tuple[bytes, Signoff | Withdrawal]:
    """Return a document as bytes and as a model; CampaignError if it is not valid, or was not signed with the key."""
    name, signature = document_names(number)
    document = archive.read(name, LARGEST_SIGNOFF)
    if not is_signed(document, archive.read(signature, 64), key):
        raise CampaignError(f"{name} was changed, or the key of {KEY} did not sign it")
    try:
        return document, read_document(document)
    except ValidationError as error:
        first = error.errors()[0]
        raise CampaignError(f"{name}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error
