"""How far a campaign is, as its coordinator says it: one small JSON file, replaced every two seconds."""

import time
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from campaign.plan import Plan
from campaign.store import Store, Survey
from campaign.worker.messages import BatchResult
from campaign.worker.moments import Moments, add_moments, moments, running_cpk

RATE_OVER = 60.0  # s


@dataclass(frozen=True)
class Heartbeat:
    """How far a campaign is.

    Attributes
    ----------
    campaign : str
        Its id.
    state : str
        ``running``, and at the end ``completed``, ``cancelled``, ``failed`` or ``interrupted``.
    samples, done, ok, failed, left : int
        Rows planned (or fewer, once it stopped when sure), there, good, not good, and to come.
    statuses : dict of str to int
        Rows there by status.
    rate : float
        Runs a second over the last minute.
    eta_s : float or None
        Time to go at that rate [s].
    workers : int
        Processes that compute.
    responses : dict
        By name: ``n``, ``mean``, ``std``, ``cpk`` of the rows there, in the order they came.
    token, pid, beat, time
        Of the coordinator: its lease, its process, how often it has said so, and when [s since 1970].
    message : str
        What is worth saying about the state.
    """

    campaign: str
    state: str
    samples: int
    done: int
    ok: int
    failed: int
    left: int
    statuses: dict[str, int]
    rate: float
    eta_s: float | None
    workers: int
    responses: dict[str, dict[str, float | None]] = field(default_factory=dict)
    token: str = ""
    pid: int = 0
    beat: int = 0
    time: float = 0.0
    message: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "Heartbeat | None":
        """Read what a coordinator said; None if it is of another format."""
        try:
            return cls(**content)
        except TypeError:
            return None


class Progress:
    """Counts and moments of the rows there are, and the rate at which they come.

    Parameters
    ----------
    store : Store
        Where the rows are that were there from the start.
    plan : Plan
        The campaign.
    survey : Survey
        What was there from the start.
    """

    def __init__(self, store: Store, plan: Plan, survey: Survey) -> None:
        self.plan = plan
        self.statuses: Counter[str] = Counter()
        self.moments: dict[str, Moments] = {}
        self.samples = plan.spec.samples
        self.computed = 0
        self._times: deque[tuple[float, int]] = deque([(time.monotonic(), 0)])
        self.recount(store, survey)

    def recount(self, store: Store, survey: Survey) -> None:
        """Forget what was told, and count what is there, up to where the campaign ends by now."""
        self.statuses, self.moments = Counter(survey.statuses), {}
        self.samples = store.end(self.plan)
        if survey.parts:
            names = list(self.plan.mechanism.responses)
            for table in store.stream(self.plan, names):
                add_moments(self.moments, moments(table, names))

    def add(self, done: BatchResult) -> None:
        """Take note of a batch."""
        self.statuses.update(done.part.statuses)
        add_moments(self.moments, done.moments)
        self.computed += done.part.rows if done.computed else 0
        self._times.append((time.monotonic(), self.computed))
        while len(self._times) > 2 and self._times[0][0] < self._times[-1][0] - RATE_OVER:
            self._times.popleft()

    @property
    def done(self) -> int:
        """Rows there."""
        return sum(self.statuses.values())

    @property
    def failed(self) -> int:
        """Rows there that are not good."""
        return self.done - self.statuses.get("ok", 0)

    def heartbeat(self, state: str, workers: int = 0, **of_coordinator: Any) -> Heartbeat:
        """Return how far the campaign is."""
        (first, before), rate = self._times[0], 0.0
        if self.computed > before:
            rate = (self.computed - before) / max(time.monotonic() - first, 1e-9)
        left = max(self.samples - self.done, 0)
        return Heartbeat(
            campaign=self.plan.campaign_id,
            state=state,
            samples=self.samples,
            done=self.done,
            ok=self.statuses.get("ok", 0),
            failed=self.failed,
            left=left,
            statuses=dict(sorted(self.statuses.items())),
            rate=rate,
            eta_s=left / rate if rate else None,
            workers=workers,
            responses={name: self._response(name, m) for name, m in self.moments.items()},
            time=time.time(),
            **of_coordinator,
        )

    def _response(self, name: str, m: Moments) -> dict[str, float | None]:
        asked = self.plan.spec.responses.get(name)
        lsl, usl, _ = asked.limits() if asked else (None, None, None)
        return {"n": m.n, "mean": m.mean if m.n else None, "std": m.std, "cpk": running_cpk(m, lsl, usl)}
