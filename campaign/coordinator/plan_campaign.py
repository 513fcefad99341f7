"""Check all inputs of a user, then write the plan of a campaign into a store."""

import logging
from collections.abc import Callable

from campaign.coordinator.submit import submit
from campaign.errors import SpecError
from campaign.plan import Plan, make_plan
from campaign.spec.campaign_cautions import campaign_cautions
from campaign.spec.load import Campaign, Source, load_campaign
from campaign.spec.open_campaign_questions import campaign_questions
from campaign.store import Store, open_store
from campaign.store.labels import LabelChange

logger = logging.getLogger(__name__)


def plan_campaign(
    campaign: Source | Campaign,
    url: str,
    samples: int | None = None,
    seed: int | None = None,
    batch_size: int | None = None,
    labels: LabelChange | None = None,
    *,
    when_new: Callable[[], None] = lambda: None,
) -> tuple[Store, Plan]:
    """Open the store, load the campaign and plan it; if the store already has its plan, return that one.

    For a new campaign, each caution is logged as a warning (see `campaign.spec.campaign_cautions`), and so is each open
    question of its file, which is a line that begins with ``#?``.

    Parameters
    ----------
    campaign : Campaign, or a source that `load_campaign` accepts
        What to compute.
    url : str
        Folder or URL of the store.
    samples, seed : int, optional
        Number of samples and seed, instead of those of the campaign.
    batch_size : int, optional
        Number of samples in a batch; see `campaign.coordinator.submit.submit`.
    labels : LabelChange, optional
        Owner and tags; see `campaign.coordinator.submit.submit`.
    when_new : callable
        Called as soon as the campaign is known to be valid and new, before any run.

    Raises
    ------
    SpecError
        If the campaign has faults, or the workers cannot reach the store.
    StoreError
        If the store cannot be written.
    """
    opened = open_store(url)
    if not opened.files.shared:
        raise SpecError(
            f"store {opened.url}: the workers cannot reach the memory of this process; name a folder or a URL"
        )
    loaded = campaign if isinstance(campaign, Campaign) else load_campaign(campaign, samples=samples, seed=seed)
    opened.files.check_writable()
    if make_plan(loaded, batch_size).campaign_id not in opened.campaigns():
        when_new()
        for question in campaign_questions(campaign):
            logger.warning("%s", question)
        for caution in campaign_cautions(loaded):
            logger.warning("warning: %s", caution)
    return opened, submit(opened, loaded, batch_size, labels=labels)
