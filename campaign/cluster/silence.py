"""Which workers are silent: they send no heartbeat, because they hang or were stopped."""

from collections.abc import Mapping

LOOK_INTERVAL = 2.0  # s, between two looks


class Silence:
    """How long each worker has sent no heartbeat, counted while this process is awake.

    A look counts for no more than twice the interval of looks: when a laptop sleeps, or all processes of a campaign are
    stopped, nobody looks, and no worker is to blame.

    Parameters
    ----------
    longest : float
        A worker is silent after this many seconds without a heartbeat.
    """

    def __init__(self, longest: float) -> None:
        self._longest = longest
        self._heartbeats: dict[str, float] = {}
        self._silent_for: dict[str, float] = {}
        self._looked_at: float | None = None

    def look(self, heartbeats: Mapping[str, float], now: float) -> list[str]:
        """Take in the last heartbeat of each worker and return the workers that are silent; each begins anew then.

        Parameters
        ----------
        heartbeats : mapping of str to float
            When each worker sent its last one, by the clock of whoever received it, which is not compared with another.
        now : float
            This process's monotonic clock [s].
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
