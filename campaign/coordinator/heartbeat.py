"""The heartbeat of a campaign: its progress, in a small JSON file that its coordinator replaces every two seconds.

Whoever follows campaigns does so by the heartbeats in the store.
"""

import logging
import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from typing import Annotated, Any

from pydantic import AfterValidator, ConfigDict, Field, StrictStr, TypeAdapter, ValidationError, with_config

from campaign.coordinator.lease import HEARTBEAT_INTERVAL, STALE_AFTER, SignOfLife, holder, judge_life
from campaign.coordinator.state import LATEST, state_of
from campaign.inputs.sampling import sampler_named
from campaign.plan import Plan, resolution
from campaign.processes import ProcessName
from campaign.store import Store, Survey
from campaign.store.layout import HEARTBEAT, LEASE, PLAN
from campaign.waits import STOPPING, Wait, in_words, is_wait
from campaign.worker.messages import BatchResult, Moments, add_moments, moments

RATE_WINDOW = 60.0  # s over which the rate of runs is averaged
MOST_LISTED = 200  # workers in a heartbeat: those that were seen last
STALLED = (3.0, 10.0)  # times a batch takes, and at the least seconds, after which it is odd that none has finished

logger = logging.getLogger(__name__)


Count = Annotated[int, Field(strict=True, ge=0, lt=2**63)]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]


def _only_if(is_sound: Callable[[Any], bool]) -> AfterValidator:
    """Return the annotation of a value that must pass a check."""

    def check(value: Any) -> Any:
        if not is_sound(value):
            raise ValueError("clearcap writes no such value")
        return value

    return AfterValidator(check)


RESPONSE = {"n", "mean", "std", "cpk"}
Response = Annotated[dict[str, Number | None], _only_if(lambda response: response.keys() >= RESPONSE)]


@with_config(ConfigDict(extra="forbid"))
@dataclass(frozen=True)
class WorkerProgress:
    """What one worker has computed of a campaign since its coordinator began."""

    host: StrictStr  # its machine
    pid: Count  # number of its process there
    rows: Count
    rate: Number  # rows per second, of the time in which it computed
    seen: Number  # when its last batch came [s since 1970], by the coordinator's clock


@with_config(ConfigDict(extra="forbid"))
@dataclass(frozen=True)
class Heartbeat:
    """The progress of a campaign."""

    campaign: StrictStr  # its id
    state: StrictStr  # ``running``, and at the end ``completed``, ``cancelled``, ``failed`` or ``interrupted``
    samples: Count  # rows that are planned, or fewer once the stopping rule ended the campaign
    done: Count  # stored rows
    ok: Count  # stored rows of this status
    failed: Count  # stored rows that failed, see `PlanHeader.is_failed`
    left: Count  # rows still to be computed
    statuses: dict[str, Count]  # stored rows by status
    rate: Number  # runs per second over the last minute
    eta_s: Number | None  # remaining time at that rate; None while the rate is unknown, and while it does not hold
    workers: Count
    idle_s: Number = 0.0  # since the last batch was completed, or since the start
    responses: dict[str, Response] = field(default_factory=dict)  # what is known of the stored rows
    token: StrictStr = ""  # of the coordinator's lease
    pid: Count = 0  # of the coordinator
    beat: Count = 0  # number of this heartbeat, from 1
    time: Annotated[Number, Field(ge=0.0, lt=LATEST)] = 0.0  # when it was written [s since 1970]
    message: StrictStr = ""  # details of the state; may be empty
    repeats: Count = 0  # samples to be repeated with half the step; not counted as rows
    repeated: Count = 0  # of these, those already repeated
    # what it waits for, see `campaign.waits.Wait`
    waiting: list[Annotated[dict[str, Any], _only_if(is_wait)]] = field(default_factory=list)
    by_worker: list[WorkerProgress] = field(default_factory=list)  # by host and process, at most `MOST_LISTED`

    @property
    def waits_for(self) -> str:
        """What the campaign waits for, in words; empty if nothing, and in another state than ``running``."""
        return in_words(self.waiting, self.time) if self.state == "running" else ""

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "Heartbeat | None":
        """Return the heartbeat that ``to_json`` wrote; None if the content has another format."""
        try:
            return _HEARTBEAT.validate_python(dict(content))
        except ValidationError:
            return None


_HEARTBEAT = TypeAdapter(Heartbeat)
Show = Callable[[Heartbeat], None]


class Progress:
    """Counts and moments of the stored rows of a campaign, and the rate at which rows are computed.

    `computed` rows are those since the start; `samples` decreases if the stopping rule ends the campaign.
    """

    def __init__(self, store: Store, plan: Plan, survey: Survey) -> None:
        self.plan = plan
        self.repeats = self.repeated = 0
        self.statuses: Counter[str] = Counter()
        self.moments: dict[str, Moments] = {}
        self.samples = plan.spec.samples
        self.computed = 0
        self.workers = 0
        self._by_worker: dict[ProcessName, WorkerProgress] = {}
        self._busy: defaultdict[ProcessName, float] = defaultdict(float)  # s that each has computed
        self._times: deque[tuple[float, int]] = deque([(time.monotonic(), 0)])
        self._batch_seconds = 0.0  # of the slowest of the last batches
        self.recount(store, survey)

    def recount(self, store: Store, survey: Survey) -> None:
        """Count the rows in the store again, up to the end of the campaign."""
        self.statuses, self.moments = Counter(survey.statuses), {}
        self.samples = store.end(self.plan)
        if survey.parts:
            names = list(self.plan.mechanism.responses)
            columns = [*names, *sampler_named(self.plan.spec.sampler).columns]
            for table in store.stream(self.plan, columns):
                add_moments(self.moments, moments(table, names))

    def add(self, result: BatchResult, worker: ProcessName | None = None) -> None:
        """Count the rows of a batch, and its repeats; `worker` is the process that computed it, if that is known."""
        self.repeated += result.repeats
        if result.part is not None:
            self.statuses.update(result.part.statuses)
            self.computed += result.part.rows if result.computed else 0
        add_moments(self.moments, result.moments)
        self._batch_seconds = max(result.seconds, 0.9 * self._batch_seconds)
        self._times.append((time.monotonic(), self.computed))
        while len(self._times) > 2 and self._times[0][0] < self._times[-1][0] - RATE_WINDOW:
            self._times.popleft()
        if worker is not None:
            self._add_of(worker, result.part.rows if result.part and result.computed else 0, result.seconds)

    def _add_of(self, worker: ProcessName, rows: int, seconds: float) -> None:
        """Count the rows of a worker; the one that was seen last is the last."""
        before = self._by_worker.pop(worker, None)
        self._busy[worker] += seconds
        total = rows + (before.rows if before else 0)
        rate = total / self._busy[worker] if self._busy[worker] > 0 else 0.0
        self._by_worker[worker] = WorkerProgress(*worker, total, rate, time.time())
        if len(self._by_worker) > MOST_LISTED:  # of those that were replaced
            oldest = next(iter(self._by_worker))
            del self._by_worker[oldest], self._busy[oldest]

    @property
    def done(self) -> int:
        """Number of stored rows."""
        return sum(self.statuses.values())

    @property
    def failed(self) -> int:
        """Number of stored rows that failed."""
        return self.plan.failed(self.statuses)

    @property
    def is_stalled(self) -> bool:
        """Whether nothing has finished for several times the length of a batch."""
        times, least = STALLED
        return time.monotonic() - self._times[-1][0] > max(times * self._batch_seconds, least)

    def heartbeat(self, state: str, waits: Iterable[Wait] = (), **of_coordinator: Any) -> Heartbeat:
        """Return a heartbeat; ``of_coordinator`` are its ``token``, ``pid`` and ``beat``."""
        now, idle = time.time(), time.monotonic() - self._times[-1][0]
        waiting = list(waits)
        is_stopped = any(wait.what in STOPPING for wait in waiting)
        holds = not self.is_stalled and not is_stopped
        if self.is_stalled and not is_stopped:
            waiting.append(Wait("idle", now - idle))
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
            # none while only repeats are left: they take their time too, but are not counted in the rate
            eta_s=left / rate if rate and holds and (left or self.repeated >= self.repeats) else None,
            workers=self.workers,
            idle_s=idle,
            responses={name: self._response(name, m) for name, m in self.moments.items()},
            time=now,
            waiting=[wait.to_json() for wait in waiting],
            by_worker=sorted(self._by_worker.values(), key=lambda each: (each.host, each.pid)),
            repeats=self.repeats,
            repeated=min(self.repeated, self.repeats),
            **of_coordinator,
        )

    def _response(self, name: str, m: Moments) -> dict[str, float | None]:
        response = self.plan.spec.responses.get(name)
        lsl, usl, _ = response.limits() if response else (None, None, None)
        return {
            "n": m.n,
            "mean": m.mean if m.n else None,
            "std": m.std,
            "cpk": _cpk(m, lsl, usl, resolution(self.plan.mechanism, name)[0]),
        }


def _cpk(m: Moments, lsl: float | None, usl: float | None, least: float) -> float | None:
    """Return Cpk of the values so far; None without limits, or if the spread does not exceed `least` and rounding."""
    if not m.std or m.std <= least or (lsl is None and usl is None):
        return None
    from reporting.arrays import ROUNDING
    from reporting.capability.indices import cpk  # loads all of reporting, which `clearcap status` does not need

    return None if m.std <= ROUNDING * abs(m.mean) else cpk(m.mean, m.std, lsl, usl)


# -- followers ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Observation:
    """One observation of a campaign; equal to an earlier one if it shows a follower nothing new."""

    campaign: str  # its id
    state: str  # as in `state_of`; ``gone`` if there is no plan, state or heartbeat
    message: str
    since: float | None  # when the state began [s since 1970]
    is_open: bool  # whether a coordinator that serves the store would continue the campaign
    heartbeat: Heartbeat | None  # the last one, with the state and the message above; None if clearcap wrote none
    odd: str | None  # content of the files that clearcap never writes
    sign: SignOfLife | None = field(compare=False)  # of the coordinator, while the state is ``running``

    @property
    def is_over(self) -> bool:
        """Whether nothing more happens without a new request."""
        return self.state not in ("running", "queued")


def observe(
    store: Store, campaign_id: str, earlier: Observation | None = None, now: float | None = None
) -> Observation:
    """Observe a campaign once, from at most four small files and without waiting, so that one can observe many."""
    # Judging a coordinator on another machine takes the ``earlier`` observation too; the heartbeat of one that no
    # longer writes says so. ``now`` is the time of a monotonic clock [s], None for that of this process.
    state, document = state_of(store, campaign_id), store.read_json(campaign_id, HEARTBEAT)
    written, sign = Heartbeat.from_json(document or {}), None
    if state["state"] == "running":
        at = time.monotonic() if now is None else now
        before = None if earlier is None else earlier.sign
        lease = store.read_json(campaign_id, LEASE)
        sign = judge_life(lease, document, before, at)
        if written and sign.is_alive is False:
            written = _last_of(lease, written)
    is_gone = state["state"] == "planned" and not store.files.exists(f"{campaign_id}/{PLAN}")
    name, message = "gone" if is_gone else state["state"], state["message"]
    return Observation(
        campaign_id,
        name,
        message,
        state["since"],
        state["open"],
        written and replace(written, state=name, message=message),
        state["fault"] or (f"{HEARTBEAT} was not written by clearcap" if document and not written else None),
        sign,
    )


def _last_of(lease: dict[str, Any] | None, written: Heartbeat) -> Heartbeat:
    """Return the last heartbeat of a coordinator that no longer writes, with who that is: its promises do not hold."""
    pid, machine = holder(lease)
    last = datetime.fromtimestamp(written.time).astimezone().isoformat(sep=" ", timespec="seconds")
    silence = Wait("coordinator", written.time, f"process {pid} on {machine}, last at {last} by its clock")
    return replace(written, eta_s=None, waiting=[silence.to_json()])


def observe_patiently(store: Store, campaign_id: str) -> Observation:
    """Observe a campaign, again and again for up to ten seconds if its coordinator elsewhere seems to be silent."""

    # The clocks of two machines decide only whether it is worth a second look.
    def is_in_doubt(seen: Observation) -> bool:
        beat = seen.heartbeat if seen.sign is not None and seen.sign.is_alive is None else None
        return beat is not None and abs(time.time() - beat.time) >= STALE_AFTER

    seen = observe(store, campaign_id)
    while is_in_doubt(seen):
        time.sleep(HEARTBEAT_INTERVAL / 2)
        seen = observe(store, campaign_id, seen)
    return seen


def heartbeats(store: Store, campaign_id: str) -> Iterator[Heartbeat]:
    """Yield the heartbeats of a campaign as they are written, until the state in which it ends; for one follower."""
    said: set[str] = set()
    seen: Observation | None = None
    while True:
        seen = observe(store, campaign_id, seen)
        if seen.odd and seen.odd not in said:
            logger.warning("%s: %s", campaign_id, seen.odd)
            said.add(seen.odd)
        yield seen.heartbeat or replace(_before_first(store, campaign_id), state=seen.state, message=seen.message)
        if seen.is_over:
            return
        # twice as often as heartbeats are written, so that none is missed
        time.sleep(HEARTBEAT_INTERVAL / 2)


def _before_first(store: Store, campaign_id: str) -> Heartbeat:
    plan = store.plan(campaign_id)
    survey = store.survey(plan)
    ok = survey.statuses.get("ok", 0)
    samples = store.end(plan)
    counts = (samples, survey.rows, ok, survey.rows - ok, samples - survey.rows)
    return Heartbeat(campaign_id, "planned", *counts, survey.statuses, 0.0, None, 0)
