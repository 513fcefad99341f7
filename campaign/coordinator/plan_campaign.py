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

    For a new campaign, ``when_new`` is called before any run, and each caution (`campaign.spec.campaign_cautions`) and
    each open question of its file (a line that begins with ``#?``) is logged as a warning. Raises SpecError if the
    campaign has faults, or the workers cannot reach the store; StoreError if the store cannot be written.
    """
    opened = open_store(url)
    if not opened.files.shared:
        raise SpecError(
            f"store {opened.url}: the workers cannot reach the memory of this process; name a folder or a URL"
        )
    loaded = campaign if isinstance(campaign, Campaign) else load_campaign(campaign, samples=samples, seed=seed)
    # before the trial runs of `submit`, which may take minutes
    opened.files.check_writable()
    if make_plan(loaded, batch_size).campaign_id not in opened.campaigns():
        when_new()
        for question in campaign_questions(campaign):
            logger.warning("%s", question)
        for caution in campaign_cautions(loaded):
            logger.warning("warning: %s", caution)
    return opened, submit(opened, loaded, batch_size, labels=labels)
