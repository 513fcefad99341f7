"""What answers requests: the store, and what only the server keeps."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from campaign.store import Store, open_store
from campaign.web.access.audit import AuditTrail
from campaign.web.access.database import Database
from campaign.web.access.sessions import Sessions
from campaign.web.access.throttle import Throttle
from campaign.web.access.tokens import Tokens
from campaign.web.access.users import Users
from campaign.web.coordinator_child import CoordinatorChild
from campaign.web.settings import Settings


@dataclass
class Service:
    """What answers requests.

    Attributes
    ----------
    settings : Settings
    store : Store
        Campaigns, rows and reports: the truth.
    database : Database
        What only the server keeps.
    users, sessions, tokens, audit
        Parts of the database.
    throttle : Throttle
        Failed logins.
    ending : asyncio.Event
        Set when the server ends: event streams end with it.
    """

    settings: Settings
    store: Store
    database: Database
    users: Users = field(init=False)
    sessions: Sessions = field(init=False)
    tokens: Tokens = field(init=False)
    audit: AuditTrail = field(init=False)
    throttle: Throttle = field(init=False)
    ending: asyncio.Event = field(init=False)

    def __post_init__(self) -> None:
        self.users, self.sessions = Users(self.database), Sessions(self.database)
        self.tokens, self.audit = Tokens(self.database), AuditTrail(self.database)
        self.ending = asyncio.Event()
        self.throttle = Throttle(self.settings.limits.failures, self.settings.limits.failures_within)

    @asynccontextmanager
    async def working(self) -> AsyncIterator[None]:
        """Keep at work in the block what works beside the requests, such as the coordinator."""
        child = None
        if self.settings.coordinate is not None:
            child = CoordinatorChild(self.store, self.settings.coordinate)
            child.start()
        try:
            yield
        finally:
            if child is not None:
                await asyncio.to_thread(child.stop)
            self.database.close()

    def end_streams(self) -> None:
        """End all event streams, because the server ends."""
        self.ending.set()


def open_service(settings: Settings) -> Service:
    """Open the store and the files of a server.

    Raises
    ------
    FolderError
        If others could have changed the server's folder.
    SpecError
        If the store's URL or the database is wrong.
    """
    from engine.private_folder import private_folder

    folder = private_folder(settings.data.parent, settings.data.name)
    return Service(settings, open_store(settings.store), Database(folder / "service.sqlite"))
