"""Sign-offs: an approver signs the plan, rows and report; others see whether they are unchanged since."""

from collections.abc import Iterator
from contextlib import contextmanager

from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat
from fastapi import Query, Request
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.responses import StreamingResponse

from clearcap.questions.report import report_written_again
from clearcap.questions.report_source import deciding_campaigns
from clearcap.questions.signing import (
    LONGEST_COMMENT,
    Signoff,
    Withdrawal,
    check_reported,
    content_digest,
    digests_of,
    fingerprint,
)
from clearcap.web.access import Principal
from clearcap.web.http.authentication import Approver, Authenticated, TheCampaign, TheService
from clearcap.web.http.responses import Refusal
from clearcap.web.operations import Sent
from clearcap.web.signing_service import KeptSignoff
from clearcap.web.web_service import Service

MOST_DIFFERENCES = 100  # differences that are listed


class ListedSignoff(BaseModel):
    """A sign-off, without the list of files, or its withdrawal."""

    number: int = Field(examples=[1])
    digest: str = Field(description="SHA-256 of the signed document", examples=["0f" * 32])
    signer: str = Field(examples=["ada"])
    role: str = Field(examples=["approver"])
    time: str = Field(examples=["2026-11-23T09:00:00Z"])
    comment: str = Field(examples=["checked against drawing 4711"])
    submitted_by: str = Field(description="Empty for a withdrawal", examples=["eva"])
    is_submitter: bool = Field(description="The signer also submitted the campaign", examples=[False])
    status: str = Field(examples=["signed"], description="`signed`, `signed version differs`, or `withdrawn`")
    differences: list[str] = Field(
        description=f"What differs, {MOST_DIFFERENCES} files at most", examples=[["report: report/report.html differs"]]
    )

    @classmethod
    def of(cls, kept: KeptSignoff) -> "ListedSignoff":
        """Return the listed form of a sign-off."""
        same = {"signer", "role", "time", "comment", "submitted_by", "is_submitter"}
        shown = {"submitted_by": "", "is_submitter": False, **kept.signoff.model_dump(include=same)}
        differences = kept.differences[:MOST_DIFFERENCES]
        return cls(number=kept.number, digest=kept.digest, status=kept.status, differences=differences, **shown)


class SignoffList(BaseModel):
    """The sign-offs of a campaign, oldest first."""

    campaign: str = Field(examples=["c60-0a1b2c3d4e"])
    status: str = Field(examples=["signed"], description="`not signed`, or that of the last one")
    key: str = Field(description="Fingerprint of the server's key", examples=["0f" * 32])
    signoffs: list[ListedSignoff]


class SignedContent(BaseModel):
    """The content that would be signed now."""

    content: str = Field(description="Digest over all of it: sign with it", examples=["0f" * 32])
    plan: str = Field(description="SHA-256 of plan.json", examples=["1e" * 32])
    rows: str = Field(description="Digest over the files of rows", examples=["2d" * 32])
    report: str = Field(description="Digest over the files of the report", examples=["3c" * 32])
    files: int = Field(description="How many files", examples=[9])
    submitted_by: str = Field(examples=["eva"])
    is_submitter: bool = Field(description="You submitted it yourself", examples=[False])


class Signing(Sent):
    """A request to sign a campaign."""

    content: str = Field(
        pattern="^[0-9a-f]{64}$", description="From the call that shows what would be signed", examples=["0f" * 32]
    )
    comment: str = Field("", max_length=LONGEST_COMMENT, examples=["checked against drawing 4711"])


class SigningKey(BaseModel):
    """The public key that verifies the server's sign-offs."""

    fingerprint: str = Field(description="SHA-256 of the key", examples=["0f" * 32])
    pem: str = Field(examples=["-----BEGIN PUBLIC KEY-----\n...\n-----END PUBLIC KEY-----\n"])


@contextmanager
def one_at_a_time() -> Iterator[None]:
    """Turn a TimeoutError, because another request reads files for too long, into a Refusal (503)."""
    try:
        yield
    except TimeoutError as error:
        busy = "the server is reading files of campaigns for other users; try again in a minute"
        raise Refusal(503, busy, headers={"Retry-After": "60"}) from error


def show_signing_key(service: TheService, _: Authenticated) -> SigningKey:
    """Show the key that verifies sign-offs; `clearcap verify --key` takes its fingerprint."""
    key = service.signing_service.key.public_key()
    pem = key.public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo).decode()
    return SigningKey(fingerprint=fingerprint(key), pem=pem)


def list_signoffs(
    service: TheService,
    campaign: TheCampaign,
    _: Authenticated,
    check: bool = Query(False, description="Read every file again, including those that seem unchanged"),
) -> SignoffList:
    """List who signed a campaign, and whether it has changed since."""
    with one_at_a_time():
        kept = [ListedSignoff.of(each) for each in service.signing_service.signoffs(campaign, anew=check)]
    status = kept[-1].status if kept else "not signed"
    key = fingerprint(service.signing_service.key.public_key())
    return SignoffList(campaign=campaign, status=status, key=key, signoffs=kept)


def show_content(service: TheService, campaign: TheCampaign, who: Approver) -> SignedContent:
    """Show the digests of the content that would be signed now; refused without a report, which is what is read."""
    check_reported(service.store, campaign)
    with one_at_a_time():
        files = service.signing_service.content(campaign, anew=False)
    parts = dict(zip(("plan", "rows", "report"), digests_of(files), strict=True))
    submitter = service.signing_service.submitter(campaign)
    own = {"submitted_by": submitter, "is_submitter": submitter == who.name}
    return SignedContent(content=content_digest(files), files=len(files), **parts, **own)


async def sign_campaign(
    request: Request, service: TheService, campaign: TheCampaign, who: Approver, signing: Signing
) -> Signoff:
    """Sign the plan, rows and report of a completed campaign; the report is first made again from the rows."""
    if service.settings.four_eyes:
        await run_in_threadpool(_check_four_eyes, service, campaign, who)
    again = await service.pool.data(who.name, report_written_again, service.store.files.full_url, campaign)

    def sign() -> Signoff:
        with one_at_a_time():
            return service.signing_service.sign(campaign, who, signing.comment, signing.content, again)

    signoff = await run_in_threadpool(sign)
    request.state.detail = f"plan {signoff.plan[:12]}, rows {signoff.rows[:12]}, report {signoff.report[:12]}"
    return signoff


def _check_four_eyes(service: Service, campaign: str, who: Principal) -> None:
    """Refuse (403) to sign what the principal has submitted, or a campaign of which the store does not say who did."""
    if not service.signing_service.submitter(campaign):
        raise Refusal(
            403, f"{campaign}: the store does not say who submitted it, and nobody signs his own here; submit it"
        )
    for each in (campaign, *deciding_campaigns(service.store, campaign)):
        if service.signing_service.submitter(each) == who.name:
            raise Refusal(403, f"{each} was submitted by {who.name}; on this server another approver has to sign it")


class Withdrawing(Sent):
    """A request to withdraw the last sign-off of a campaign."""

    comment: str = Field(min_length=1, max_length=LONGEST_COMMENT, description="Why", examples=["wrong drawing"])


def withdraw_signoff(service: TheService, campaign: TheCampaign, who: Approver, withdrawing: Withdrawing) -> Withdrawal:
    """Withdraw the last sign-off of a campaign by a signed document; the campaign can then be changed again."""
    return service.signing_service.withdraw(campaign, who, withdrawing.comment)


def export_signed(service: TheService, campaign: TheCampaign, _: Authenticated) -> StreamingResponse:
    """Export a campaign with its sign-offs as a ZIP file, which `clearcap verify` verifies without the server."""
    if not service.signing_service.has_documents(campaign):
        raise Refusal(409, f"nobody has signed {campaign}; it can be exported once an approver has signed it")
    headers = {"Content-Disposition": f'attachment; filename="{campaign}.zip"'}
    return StreamingResponse(service.signing_service.export(campaign), media_type="application/zip", headers=headers)
