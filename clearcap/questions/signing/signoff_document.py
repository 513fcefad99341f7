"""The document of a sign-off: its format, the files it covers, their digests, and its signature by Ed25519."""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Any, Literal

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from pydantic import BaseModel, ConfigDict, Field, model_validator

from campaign.errors import CampaignError
from campaign.plan_header import PlanHeader
from campaign.store import Store
from campaign.store.files.files import TEMPORARY
from campaign.store.layout import CAMPAIGN_FILE, PLAN, REPEATS, REPORT, STOPPED
from campaign.store.repeat_sets import repeat_plans

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
