"""The progress of a campaign, counted now: what ``clearcap status --json`` prints."""

from typing import Any

from pydantic import BaseModel, Field

from campaign.coordinator.progress.progress_report import progress_report
from campaign.web.api.calls import calls
from campaign.web.api.whose import TheCampaign
from campaign.web.http.asking import TheService
from campaign.web.http.problems import described

router = calls("campaigns")


class CampaignStatus(BaseModel):
    """How far a campaign is."""

    campaign: str = Field(examples=["c60-0a1b2c3d4e"])
    store: str = Field(description="Where its files are", examples=["runs"])
    state: str = Field(examples=["running"])
    message: str = Field("", description="Details of the state")
    since: str | None = Field(description="When the state began, ISO 8601", examples=["2026-11-23T09:00:00+00:00"])
    open: bool = Field(description="A coordinator that serves the store would continue it")
    fault: str | None = Field(description="What the file of its state says that clearcap never writes", examples=[None])
    samples: int = Field(examples=[30850])
    done: int = Field(description="Rows that are stored", examples=[12000])
    ok: int = Field(examples=[11998])
    failed: int = Field(examples=[2])
    left: int = Field(examples=[18850])
    statuses: dict[str, int] = Field(description="Rows by status", examples=[{"ok": 11998, "not_at_rest": 2}])
    repeats: int = Field(description="Samples that are to be repeated with half the step")
    repeated: int
    heartbeat: dict[str, Any] | None = Field(description="Of a campaign that runs: rate, time to go, each Cpk so far")
    comparisons: dict[str, str] = Field(description="Where its comparisons are, by the id of the other campaign")
    remarks: list[str] = Field(description="What is wrong with its files", examples=[[]])


@router.get("/campaigns/{campaign}/status", responses=described(404))
def campaign_status(service: TheService, campaign: TheCampaign) -> CampaignStatus:
    """Count the rows of a campaign now: state, rows by status, and the last message of its coordinator."""
    store, remarks = service.store.hasty, list[str]()
    document = progress_report(store, store.plan_header(campaign), remarks.append)
    if document["heartbeat"]:
        document["heartbeat"]["token"] = ""  # of the coordinator's lease
    return CampaignStatus(**document, remarks=remarks)
