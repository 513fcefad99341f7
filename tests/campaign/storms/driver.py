"""A coordinator for a campaign whose runs are those of the stand-in: ``python -m tests.campaign.storms.driver``.

It is ``clearcap coordinate`` but for the physics, which no option of the command replaces.
"""

import argparse
import signal
import sys
from functools import partial
from pathlib import Path

from campaign.cluster.cluster import Cluster, Tls
from campaign.coordinator.coordinate import coordinate
from campaign.errors import CampaignError
from campaign.store import open_store
from campaign.store.files.retry_policy import PATIENT, RetryPolicy
from clearcap.cli.output import show_logs
from tests.campaign import fake_engine


def main():
    """Coordinate the campaign; exit as the command does."""
    parser = argparse.ArgumentParser()
    parser.add_argument("store")
    parser.add_argument("campaign")
    parser.add_argument("--scheduler")
    parser.add_argument("--workers", type=int)
    parser.add_argument("--seconds", type=float, default=0.0, help="that a run takes")
    parser.add_argument("--patience", type=float, default=PATIENT.seconds, help="with a store that fails")
    parser.add_argument("--tls", type=Path, help="folder of certificates")
    options = parser.parse_args()
    show_logs()
    store = open_store(options.store, RetryPolicy(options.patience))
    tls = options.tls and Tls(*(str(options.tls / name) for name in ("ca.pem", "client.pem", "client.key")))
    where = Cluster(scheduler=options.scheduler, workers=options.workers, tls=tls)
    simulate = partial(fake_engine.takes, options.seconds) if options.seconds else fake_engine.simulate
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        coordinate(store, store.plan(options.campaign), where, simulate=simulate)
    except CampaignError as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
