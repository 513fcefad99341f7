"""Prometheus gauges of a service, which are counted when they are queried."""

from collections import Counter
from collections.abc import Iterable, Mapping

from prometheus_client import Metric
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from campaign.web.answers.job_pool import JobPool
from campaign.web.watch.entry import LISTED_STATES
from campaign.web.watch.watcher import Watcher


class ServiceGauges(Collector):
    """Count campaigns by state, running and waiting jobs, and open event streams.

    It may only be queried in the event loop of the service, because no lock keeps the counts from changing meanwhile.
    """

    def __init__(self, watcher: Watcher, pool: JobPool) -> None:
        self._watcher, self._pool = watcher, pool

    def collect(self) -> Iterable[Metric]:
        """Yield the gauges with their current values."""
        campaigns = Counter(dict.fromkeys(LISTED_STATES, 0))
        campaigns.update(entry.state for entry, _ in self._watcher.index.entries())
        yield _by_state("clearcap_campaigns", "Campaigns by state, as the list has them", campaigns)
        jobs = {"running": self._pool.running, "waiting": self._pool.waiting}
        yield _by_state("clearcap_jobs", "Jobs in the processes that compute for pages and calls", jobs)
        yield GaugeMetricFamily("clearcap_event_streams", "Open event streams", self._watcher.followers)

    def describe(self) -> Iterable[Metric]:
        """Return nothing, so that the registry does not count when this collector is registered."""
        return ()


def _by_state(name: str, help: str, counts: Mapping[str, int]) -> Metric:
    """Return a gauge with one value for each state."""
    gauge = GaugeMetricFamily(name, help, labels=("state",))
    for state, count in counts.items():
        gauge.add_metric((state,), count)
    return gauge
