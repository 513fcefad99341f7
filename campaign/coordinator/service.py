"""Serve a store: coordinate its queued campaigns one after the other."""

import logging
import time
from collections.abc import Callable

from campaign.cluster.cluster import Cluster
from campaign.coordinator.coordinate import coordinate
from campaign.coordinator.failed_runs import lack_of_ok
from campaign.coordinator.lease import HEARTBEAT_INTERVAL, LeaseHeld, beating, hold_lease
from campaign.coordinator.rerun import rerun_requested
from campaign.coordinator.state import close_campaign, state_of
from campaign.errors import CampaignError, StoreError
from campaign.plan import Plan
from campaign.store import Store
from campaign.store.layout import SERVICE

logger = logging.getLogger(__name__)


Report = Callable[[Store, Plan], object]  # writes the report of a completed campaign
Decide = Callable[[Store, Plan, Cluster], object]  # computes the further campaigns that its verdicts need


def serve(
    store: Store, cluster: Cluster, *, report: Report | None, decide: Decide | None = None, once: bool = False
) -> list[str]:
    """Coordinate the queued campaigns of a store, and those whose coordinator died; return the completed ones."""
    # ``decide``, then ``report``, are called for each completed campaign. ``once`` returns when no campaign is queued.
    completed: list[str] = []
    unreadable: dict[str, str] = {}
    with hold_lease(store, SERVICE), beating(store, SERVICE):
        while True:
            queued = [c for c in store.campaigns() if _is_open(store, c, unreadable)]
            for campaign_id in queued:
                if not _is_open(store, campaign_id, unreadable):
                    continue  # it was cancelled or deleted while another one was computed
                logger.info("computing campaign %s", campaign_id)
                if _coordinate(store, campaign_id, cluster, report, decide):
                    completed.append(campaign_id)
            if once and not queued:
                return completed
            if not queued:
                time.sleep(HEARTBEAT_INTERVAL)


def _is_open(store: Store, campaign_id: str, unreadable: dict[str, str]) -> bool:
    """Return whether to continue a campaign; one that cannot be read is logged once, in ``unreadable``, and skipped."""
    try:
        is_open: bool = state_of(store, campaign_id)["open"]
    except StoreError as error:
        if unreadable.get(campaign_id) != str(error):
            unreadable[campaign_id] = str(error)
            logger.warning("campaign %s is skipped: %s", campaign_id, error)
        return False
    unreadable.pop(campaign_id, None)
    return is_open


def _coordinate(store: Store, campaign_id: str, cluster: Cluster, report: Report | None, decide: Decide | None) -> bool:
    """Coordinate one campaign, decide it and write its report; a failure is logged and does not end the service."""
    try:
        plan = store.plan(campaign_id)
        # first, so that the report has the new rows
        if again := rerun_requested(store, plan, cluster):
            logger.info("campaign %s: %d rows computed again: %s", campaign_id, again.samples, again.after)
        outcome = coordinate(store, plan, cluster, is_served=True, report_due=report is not None)
        if lack := lack_of_ok(outcome.plan, outcome.survey.statuses):
            logger.warning("campaign %s: %s", campaign_id, lack)
        if report:
            if decide:
                decide(store, outcome.plan, cluster)
            _report(store, outcome.plan, report)
    except LeaseHeld as error:
        logger.info("%s", error)
        time.sleep(HEARTBEAT_INTERVAL)
        return False
    except CampaignError as error:
        logger.warning("campaign %s: %s", campaign_id, error)
        time.sleep(HEARTBEAT_INTERVAL)
        return False
    return True


def _report(store: Store, plan: Plan, report: Report) -> None:
    """Write the report of a completed campaign, then close it, also if that fails, so that the next has its turn."""
    try:
        report(store, plan)
    except StoreError:
        raise  # the campaign stays open, and the service tries again
    except CampaignError as error:
        logger.warning("campaign %s: %s", plan.campaign_id, error)
        close_campaign(store, plan.campaign_id, str(error))
    except Exception as error:  # a fault in one report must not stop the service
        logger.exception("report of %s failed", plan.campaign_id)
        close_campaign(store, plan.campaign_id, f"no report, because of a bug in clearcap: {error!r}")
    else:
        close_campaign(store, plan.campaign_id)
