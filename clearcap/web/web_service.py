"""The service behind the HTTP calls: the store, the server's own database, its coordinator and background tasks."""

import asyncio
import logging
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress

from campaign.errors import StoreError
from campaign.processes import STORE
from campaign.store import Store
from campaign.store.files.files import Files
from campaign.store.files.retry_policy import HASTY, CircuitBreaker
from clearcap.questions.mechanisms import engine_is_compiled, warm_up_try_out
from clearcap.web.access.audit import AuditTrail
from clearcap.web.access.company_login import CompanyLogin
from clearcap.web.access.database import DATABASE, Database
from clearcap.web.access.throttle import LoginThrottle, Throttle
from clearcap.web.access.users import Sessions, Tokens, Users
from clearcap.web.index import CampaignIndex, CountedStatuses
from clearcap.web.jobs.column_cache import columns_folder
from clearcap.web.jobs.pool import JobPool, Quota
from clearcap.web.jobs.process import JobLimits
from clearcap.web.jobs.queries import QueryService
from clearcap.web.settings import Settings
from clearcap.web.signing_service import SigningService
from clearcap.web.watcher import Watcher, Workload, look_at_work
from clearcap.web.webhooks import CampaignEvent, WebhookRepository, WebhookSender, campaign_events
from engine.platform.child import python_environment
from engine.platform.private_folder import private_folder

logger = logging.getLogger(__name__)
FIRST_PAUSE, LONGEST_PAUSE = 1.0, 60.0  # s between the end of a coordinator and the start of the next
SOUND_AFTER = 60.0  # s of run time after which the end of a coordinator no longer counts as a failed start
END_WITHIN = 30.0  # s
WORK_IS_FRESH = 5.0  # s


class Service:
    """All that the handlers of requests share; each operation on `store` is tried only once, so that none waits."""

    def __init__(self, settings: Settings, store: Store, database: Database) -> None:
        self.settings, self.store, self.database = settings, store, database
        self.users, self.sessions, self.tokens = Users(database), Sessions(database), Tokens(database)
        self.audit, self.webhooks = AuditTrail(database), WebhookRepository(database)
        self.signing_service = SigningService(database, store)
        self.streams: Counter[str] = Counter()  # open streams by user
        self.submitting: Counter[str] = Counter()  # running submissions by user
        limits = settings.limits
        # a job may also wait for the store or for a busy machine, so its wall-clock time is three times its processor
        # time
        taken = JobLimits(limits.job_seconds, 3.0 * limits.job_seconds, limits.job_memory / 2**30)
        quota = Quota(limits.jobs, limits.waiting)
        self.pool = JobPool(settings.processes, quota, taken, warm_up_try_out, engine_is_compiled)
        self.answers = QueryService(self.pool, store, columns_folder())
        index = CampaignIndex(database.path.with_name("index.sqlite"))
        self.watcher = Watcher(store, index, is_served=settings.coordinate is not None)
        self.statuses = CountedStatuses(store)
        self.logins = LoginThrottle(limits.failures, limits.failures_within)
        self.throttle = Throttle(limits.failures, limits.failures_within)  # of tokens, and of company logins
        self.company = CompanyLogin(settings.oidc, settings.address) if settings.oidc else None
        self.workload: Workload | None = None  # what was seen of the work in the store last
        self._look_again = 0.0  # time of the next look at it

    @asynccontextmanager
    async def working(self) -> AsyncIterator[None]:
        """Run the job pool, the watcher, the webhook sender and the coordinator in the block; then close the files."""
        sender = WebhookSender(self.webhooks, self.events, self.settings.webhook_hosts)
        async with self.pool:
            background = (self.watcher.run(), sender.run(), asyncio.to_thread(self.signing_service.protect_signed))
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
        self.close()

    def close(self) -> None:
        """Close the index and the database."""
        self.watcher.index.close()
        self.database.close()

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

    def events(self) -> list[CampaignEvent]:
        """Return the events of all campaigns that follow from their states."""
        entries = self.watcher.index.entries()
        return [event for entry, _ in entries for event in campaign_events(entry, self.settings.address)]


def open_service(settings: Settings) -> Service:
    """Open the store and the files of a server; raise StoreError or FolderError if its data folder is unfit."""
    try:
        folder = private_folder(settings.data.parent, settings.data.name)
    except OSError as error:
        words = f"{settings.data}: the folder of the server's data cannot be used now ({error.strerror})"
        raise StoreError(f"{words}; make it writable, or name another with --data") from error
    files = Files(settings.store, HASTY, CircuitBreaker())
    database = Database(folder / DATABASE)
    try:
        return Service(settings, Store(files), database)
    except BaseException:
        database.close()
        raise


class CoordinatorChild:
    """Keep ``clearcap coordinate`` running, which computes every campaign queued in the store, of other users too.

    If another coordinator serves the store, this one waits until it ends. It ends with its server, even a killed one.
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
