"""News about campaigns for other systems."""

import time
from dataclasses import dataclass
from typing import Any

from campaign.web.watch.entry import CampaignEntry

ENDED = ("completed", "failed", "cancelled", "interrupted")
REPORT_WITHIN = 600.0  # s after the end of a completed campaign that its news waits for the report


@dataclass(frozen=True)
class CampaignNews:
    """Something that happened to a campaign."""

    key: str  # identifies event, time and campaign; news with the same key is sent only once
    campaign: str
    people: frozenset[str]  # users who own or submitted the campaign
    content: dict[str, Any]  # plain data


def campaign_news(entry: CampaignEntry, address: str, now: float | None = None) -> list[CampaignNews]:
    """Return the news that follows from the state of a campaign; as the state is in the store, no restart loses news.

    `address` is that of the server, for the link; `now` is in seconds since 1970.
    """
    if entry.state not in ENDED:
        return []
    since = 0.0 if entry.since is None else entry.since.timestamp()
    lacks_report = entry.state == "completed" and not entry.has_report and not entry.message
    if lacks_report and (time.time() if now is None else now) - since < REPORT_WITHIN:
        return []
    about = {"campaign": entry.campaign, "title": entry.title, "owner": entry.owner, "tags": entry.tags}
    about |= {"link": f"{address}/campaigns/{entry.campaign}"}
    ended = {"event": "campaign.ended", **about, "state": entry.state, "message": entry.message}
    ended |= entry.model_dump(
        mode="json", include={"since", "samples", "done", "failed", "share_ok", "weakest", "headline"}
    )
    people = frozenset({entry.owner, entry.submitted_by} - {""})
    # with the time, so that a campaign that is resumed and ends again is news again; a low Cpk is news only once
    news = [CampaignNews(f"ended {entry.campaign} {entry.state} {since:.3f}", entry.campaign, people, ended)]
    for below in entry.below_target:
        content = {"event": "cpk.below", **about, **below.model_dump(mode="json")}
        news.append(CampaignNews(f"below {entry.campaign} {below.response}", entry.campaign, people, content))
    return news
