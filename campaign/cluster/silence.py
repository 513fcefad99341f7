"""Detect silent workers, which send no heartbeat because they hang or were stopped."""

from collections.abc import Mapping

LOOK_INTERVAL = 2.0  # s between two checks


class Silence:
    """The time for which each worker has sent no heartbeat, counted only while this process is awake.

    A check adds at most twice the interval between checks: if a laptop sleeps or all processes of a campaign are
    stopped, there are no checks, and no worker is to blame.

    A worker is silent after ``longest`` seconds without a heartbeat.
    """

    def __init__(self, longest: float) -> None:
        self._longest = longest
        self._heartbeats: dict[str, float] = {}
        self._silent_for: dict[str, float] = {}
        self._looked_at: float | None = None

    def look(self, heartbeats: Mapping[str, float], now: float) -> list[str]:
        """Record the last heartbeat of each worker and return the silent workers, whose counts then start anew.

        The times of heartbeats are by the receiver's clock and only checked for changes; ``now`` is this process's
        monotonic clock [s].
        """
        passed = 0.0 if self._looked_at is None else min(now - self._looked_at, 2.0 * LOOK_INTERVAL)
        self._looked_at = now
        self._silent_for = {
            worker: self._silent_for.get(worker, 0.0) + passed if self._heartbeats.get(worker) == last else 0.0
            for worker, last in heartbeats.items()
        }
        self._heartbeats = dict(heartbeats)
        silent = [worker for worker, seconds in self._silent_for.items() if seconds >= self._longest]
        self._silent_for.update(dict.fromkeys(silent, 0.0))
        return silent
