"""The files of a campaign that a sign-off covers, with their SHA-256."""

from collections.abc import Callable, Iterator

from campaign.errors import CampaignError
from campaign.plan_header import PlanHeader
from campaign.reports.signing.signoff_document import sha256
from campaign.store import Store
from campaign.store.files.files import TEMPORARY
from campaign.store.layout import CAMPAIGN_FILE, PLAN, REPEATS, REPORT, STOPPED
from campaign.store.repeat_sets import repeat_plans


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
