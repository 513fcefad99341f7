"""The dependency for calls about one campaign: it exists, and the principal may see it."""

from typing import Annotated

from fastapi import Depends, Path
from starlette.concurrency import run_in_threadpool

from campaign.store.layout import PLAN
from campaign.web.http.asking import Asking, TheService
from campaign.web.http.problems import Refusal

PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,99}$"


async def the_campaign(
    service: TheService,
    principal: Asking,
    campaign: Annotated[str, Path(pattern=PATTERN, description="Id of the campaign", examples=["c60-0a1b2c3d4e"])],
) -> str:
    """Return the id of a campaign after checking that it exists and that the principal may see it.

    Either failure is refused with 404, so that nobody learns which campaigns exist.
    """
    if principal.may_see(campaign):
        is_known = service.watcher.index.entry(campaign) is not None
        if is_known or await run_in_threadpool(service.store.files.exists, f"{campaign}/{PLAN}"):
            return campaign
    raise Refusal(404, f"no campaign {campaign} in the store")


TheCampaign = Annotated[str, Depends(the_campaign)]
