"""The service behind the HTTP calls: the store, the server's own database, its coordinator and background tasks."""

import asyncio
import json
import logging
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from hashlib import sha256
from typing import Any

from campaign.errors import CampaignError, StoreError
from campaign.processes import STORE
from campaign.store import Store
from campaign.store.files.files import Files
from campaign.store.files.retry_policy import HASTY, CircuitBreaker
from clearcap.questions.mechanisms import engine_is_compiled, warm_up_try_out
from clearcap.web.access.audit import AuditTrail
from clearcap.web.access.company_login import CompanyLogin
from clearcap.web.access.credentials import Sessions, Tokens
from clearcap.web.access.database import DATABASE, Database
from clearcap.web.access.throttle import LoginThrottle, Throttle
from clearcap.web.access.users import Users
from clearcap.web.answers.column_cache import columns_folder
from clearcap.web.answers.fair_queue import Quota
from clearcap.web.answers.job_limits import JobLimits
from clearcap.web.answers.job_pool import JobPool
from clearcap.web.answers.query_service import QueryService, ResponseCache, SingleFlight
from clearcap.web.settings import Settings
from clearcap.web.signing_service import SigningService
from clearcap.web.watch.index import CampaignIndex, CountedStatuses
from clearcap.web.watch.watcher import Watcher
from clearcap.web.watch.workload import Workload, look_at_work
from clearcap.web.webhooks import CampaignEvent, WebhookRepository, WebhookSender, campaign_events
from engine.platform.child import python_environment

logger = logging.getLogger(__name__)
FIRST_PAUSE, LONGEST_PAUSE = 1.0, 60.0  # s between the end of a coordinator and the start of the next
SOUND_AFTER = 60.0  # s of run time after which the end of a coordinator no longer counts as a failed start
END_WITHIN = 30.0  # s
WORK_IS_FRESH = 5.0  # s


KEPT_BYTES = 64 << 20  # size of the cached results of jobs, such as pictures


@dataclass
class Service:
    """All that the handlers of requests share."""

    settings: Settings
    store: Store  # each operation is tried only once, so that no request waits for it
    database: Database  # the data that only the server keeps
    users: Users = field(init=False)
    sessions: Sessions = field(init=False)
    tokens: Tokens = field(init=False)
    audit: AuditTrail = field(init=False)
    webhooks: WebhookRepository = field(init=False)
    signing_service: SigningService = field(init=False)
    logins: LoginThrottle = field(init=False)  # counts wrong passwords
    throttle: Throttle = field(init=False)  # counts wrong tokens, and failed logins at the company's login service
    company: CompanyLogin | None = field(init=False)
    watcher: Watcher = field(init=False)  # reads the store once for all users
    statuses: CountedStatuses = field(init=False)
    streams: Counter[str] = field(init=False)  # open event streams by user
    submitting: Counter[str] = field(init=False)  # running submissions by user
    pool: JobPool = field(init=False)  # for jobs that need much processor time
    answers: QueryService = field(init=False)
    workload: Workload | None = field(init=False, default=None)  # what was seen of the work in the store last
    _look_again: float = field(init=False, default=0.0)  # time of the next look at it

    def __post_init__(self) -> None:
        self.users, self.sessions = Users(self.database), Sessions(self.database)
        self.tokens, self.audit = Tokens(self.database), AuditTrail(self.database)
        self.webhooks = WebhookRepository(self.database)
        self.signing_service = SigningService(self.database, self.store)
        self.streams, self.submitting = Counter(), Counter()
        self._kept, self._flights = ResponseCache(KEPT_BYTES), SingleFlight()
        limits = self.settings.limits
        # a job may also wait for the store or for a busy machine, so its wall-clock time is three times its processor
        # time
        taken = JobLimits(limits.job_seconds, 3.0 * limits.job_seconds, limits.job_memory / 2**30)
        quota = Quota(limits.jobs, limits.waiting)
        self.pool = JobPool(self.settings.processes, quota, taken, warm_up_try_out, engine_is_compiled)
        self.answers = QueryService(self.pool, self.store, columns_folder())
        index = CampaignIndex(self.database.path.with_name("index.sqlite"))
        self.watcher = Watcher(self.store, index, is_served=self.settings.coordinate is not None)
        self.statuses = CountedStatuses(self.store)
        self.logins = LoginThrottle(limits.failures, limits.failures_within)
        self.throttle = Throttle(limits.failures, limits.failures_within)
        oidc = self.settings.oidc
        self.company = CompanyLogin(oidc, self.settings.address) if oidc else None

    @asynccontextmanager
    async def working(self) -> AsyncIterator[None]:
        """Run the job pool and the background tasks, such as the coordinator, in the block; then close the files."""
        async with self.pool, self._beside():
            yield
        self.close()

    @asynccontextmanager
    async def _beside(self) -> AsyncIterator[None]:
        """Run the watcher of the store, the webhook sender and the coordinator in the block."""
        sender = WebhookSender(self.webhooks, self.events, self.settings.webhook_hosts)
        background = (self.watcher.run(), sender.run(), self._protect_signed())
        beside, child = [asyncio.create_task(each) for each in background], None
        if self.settings.coordinate is not None:
            child = CoordinatorChild(self.store, self.settings.coordinate)
            child.start()
        try:
            yield
        finally:
            if child is not None:
                await asyncio.to_thread(child.stop)
            for task in beside:
                task.cancel()
                with suppress(asyncio.CancelledError):
                    await task

    async def _protect_signed(self) -> None:
        """Have the store say what is signed, so that no command on it changes that."""
        try:
            await asyncio.to_thread(self.signing_service.protect_signed)
        except (CampaignError, OSError) as error:
            logger.warning("what is signed may not be marked so in the store; the next start tries again: %s", error)

    def close(self) -> None:
        """Close the index and the database."""
        self.watcher.index.close()
        self.database.close()

    async def kept(self, user: str, job: Callable[..., Any], *arguments: object) -> bytes:
        """Return the result of a job that depends on its arguments alone; recent results are cached.

        Equal arguments must have the same ``repr``, which is part of the key.
        """
        key = sha256(repr((job.__module__, job.__name__, arguments)).encode(errors="surrogatepass")).hexdigest()
        known = self._kept.get(key)
        if known is None:
            known = await self._flights.once(key, lambda: self.pool.run(user, job, *arguments))
            self._kept.put(key, known)
        return known

    async def kept_data(self, user: str, job: Callable[..., Any], *arguments: object) -> Any:
        """Return the plain data of a job; see `kept`."""
        return json.loads(await self.kept(user, job, *arguments))

    @property
    def store_fault(self) -> str:
        """The reason why the store cannot be read now; empty if it can."""
        return self.store.files.fault or self.watcher.fault

    async def look_at_work(self) -> None:
        """Look at the work in the store, unless that was done within the last seconds; without the store it is None."""
        if time.monotonic() < self._look_again:
            return
        self._look_again = time.monotonic() + WORK_IS_FRESH
        try:
            await self.watcher.list_first()
            entries = [entry for entry, _ in self.watcher.index.entries()]
            self.workload = await asyncio.to_thread(look_at_work, self.store, entries, self.workload)
        except StoreError:
            self.workload = None

    def free_space(self) -> int | None:
        """Return the room on the disk of the store [bytes]; None for a store behind a URL or a missing folder."""
        try:
            return shutil.disk_usage(self.store.files.full_url).free
        except OSError:
            return None

    def is_signed(self, campaign_id: str) -> bool:
        """Return whether a campaign has a sign-off."""
        return self.signing_service.is_signed(campaign_id)

    def events(self) -> list[CampaignEvent]:
        """Return the events of all campaigns that follow from their states."""
        entries = self.watcher.index.entries()
        return [event for entry, _ in entries for event in campaign_events(entry, self.settings.address)]

    def end_streams(self) -> None:
        """End all event streams, because the server ends."""
        self.watcher.end_streams()


def open_service(settings: Settings) -> Service:
    """Open the store and the files of a server."""
    from engine.platform.private_folder import private_folder

    folder = private_folder(settings.data.parent, settings.data.name)
    files = Files(settings.store, HASTY, CircuitBreaker())
    database = Database(folder / DATABASE)
    try:
        return Service(settings, Store(files), database)
    except BaseException:
        database.close()
        raise


class CoordinatorChild:
    """Keep ``clearcap coordinate`` running, which computes every campaign queued in the store, of other users too.

    If another coordinator already serves the store, that one does the work, and this one waits until it ends. The
    coordinator ends with its server, even if the server is killed, so stopping a server stops all its computations.
    """

    def __init__(self, store: Store, options: Sequence[str]) -> None:
        self._words = [sys.executable, "-P", "-m", "clearcap", "coordinate", "--parent", str(os.getpid()), *options]
        # the URL may hold credentials, and other users of the machine can see a command line
        self._environment = {**python_environment(), STORE: store.files.full_url}
        self._over = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._keep_alive, name="coordinator", daemon=True)

    def start(self) -> None:
        """Start the coordinator."""
        self._thread.start()

    @property
    def is_alive(self) -> bool:
        """Whether the coordinator runs now."""
        process = self._process
        return process is not None and process.poll() is None

    def stop(self) -> None:
        """Shut the coordinator down; the rows it has computed are in the store."""
        self._over.set()
        process = self._process
        if process is not None and process.poll() is None:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(END_WITHIN)
            except subprocess.TimeoutExpired:
                logger.warning("the coordinator (process %d) did not end within %g s", process.pid, END_WITHIN)
                process.kill()
                process.wait()
        if self._thread.is_alive():
            self._thread.join(END_WITHIN)

    def _keep_alive(self) -> None:
        """Restart the coordinator whenever it has ended; double the pause after each early end."""
        pause = FIRST_PAUSE
        while not self._over.is_set():
            begin = time.monotonic()
            self._process = subprocess.Popen(
                # in a session of its own, because Ctrl-C in a terminal must reach the server only, which then stops it
                self._words,
                stdin=subprocess.DEVNULL,
                cwd=os.sep,
                env=self._environment,
                start_new_session=True,
            )
            if self._over.is_set():  # the server ended while the coordinator started
                self._process.send_signal(signal.SIGTERM)
            status = self._process.wait()
            if self._over.is_set():
                return
            lasted = time.monotonic() - begin
            pause = FIRST_PAUSE if lasted > SOUND_AFTER else min(2.0 * pause, LONGEST_PAUSE)
            logger.warning(
                "the coordinator ended with status %d after %.0f s; starts again in %g s", status, lasted, pause
            )
            self._over.wait(pause)
