"""Serve a store: drive every campaign that is queued, one after the other."""

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from campaign.cluster.cluster import Cluster
from campaign.coordinator.coordinator import coordinate
from campaign.coordinator.lease import HEARTBEAT_INTERVAL, LeaseHeld, hold_lease
from campaign.coordinator.state import close_campaign, state_of
from campaign.errors import CampaignError, StoreError
from campaign.plan import Plan
from campaign.store import Store
from campaign.store.layout import HEARTBEAT, SERVICE

logger = logging.getLogger(__name__)


def serve(store: Store, cluster: Cluster, *, once: bool = False, with_report: bool = True) -> list[str]:
    """Drive the campaigns of a store that are queued, and those whose coordinator died.

    Parameters
    ----------
    store : Store
        Where they are.
    cluster : Cluster
        Where to compute.
    once : bool
        Return when there is none; otherwise look for more for ever.
    with_report : bool
        Write a report at the end of each.

    Returns
    -------
    list of str
        Their ids.

    Raises
    ------
    LeaseHeld
        If another process serves the store.
    """
    done: list[str] = []
    with hold_lease(store, SERVICE), _beating(store):
        while True:
            waiting = [c for c in store.campaigns() if state_of(store, c)["open"]]
            for campaign_id in waiting:
                logger.info("driving %s", campaign_id)
                if _drive(store, campaign_id, cluster, with_report):
                    done.append(campaign_id)
            if once and not waiting:
                return done
            if not waiting:
                time.sleep(HEARTBEAT_INTERVAL)


def _drive(store: Store, campaign_id: str, cluster: Cluster, with_report: bool) -> bool:
    """Drive one campaign and write its report; what goes wrong with it is said and does not end the service."""
    try:
        outcome = coordinate(store, store.plan(campaign_id), cluster, report_due=with_report)
        if with_report:
            _report(store, outcome.plan)
    except LeaseHeld as error:
        logger.info("%s", error)
        time.sleep(HEARTBEAT_INTERVAL)
        return False
    except CampaignError as error:
        logger.warning("campaign %s: %s", campaign_id, error)
        time.sleep(HEARTBEAT_INTERVAL)
        return False
    return True


def _report(store: Store, plan: Plan) -> None:
    """Write the report of a completed campaign; only then is it closed, so that a service that is killed writes it."""
    from campaign.reports.report import report

    try:
        report(store, plan)
    except StoreError:
        raise  # the campaign stays open, and the store is asked again
    except CampaignError as error:
        logger.warning("campaign %s: %s", plan.campaign_id, error)
        close_campaign(store, plan.campaign_id, str(error))
    except Exception as error:  # a fault in one report keeps no other campaign waiting
        logger.exception("report of %s", plan.campaign_id)
        close_campaign(store, plan.campaign_id, f"no report, a fault in clearcap: {error!r}")
    else:
        close_campaign(store, plan.campaign_id)


@contextmanager
def _beating(store: Store) -> Iterator[None]:
    """Say every two seconds that the service is there."""
    over = threading.Event()

    def beat() -> None:
        count = 0
        while not over.is_set():
            count += 1
            try:
                store.write_json(SERVICE, HEARTBEAT, {"beat": count, "time": time.time()})
            except StoreError as error:
                logger.warning("%s", error)
            over.wait(HEARTBEAT_INTERVAL)

    thread = threading.Thread(target=beat, name="service", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
