"""What a server is started with."""

import os
from dataclasses import dataclass, field
from pathlib import Path

LOOPBACK = ("127.0.0.1", "::1", "localhost")
PORT = 8700


@dataclass(frozen=True)
class Limits:
    """Bounds of what one request, and one user, may take.

    Attributes
    ----------
    body : int
        Largest body of a request [bytes].
    body_seconds : float
        Time in which a body must have arrived [s].
    head_seconds : float
        Time in which the first line and the headers of a request must have arrived [s].
    read_seconds : float
        Time in which something of an answer must be taken, a KiB for each second [s].
    jobs, waiting : int
        Jobs that a user may have at work, and waiting, at the same time.
    job_seconds : float
        Longest time of one job [s].
    job_memory : int
        Largest memory of one job [bytes].
    streams : int
        Event streams that a user may have open at the same time.
    samples : int
        Most samples of a campaign that is submitted here.
    running : int
        Campaigns of a user that may be queued or running at the same time.
    failures : int
        Failed logins from one address, or for one name, within `failures_within` seconds.
    failures_within : float
        See `failures` [s].
    """

    body: int = 64 * 1024**2
    body_seconds: float = 60.0
    head_seconds: float = 20.0
    read_seconds: float = 60.0
    jobs: int = 2
    waiting: int = 32
    job_seconds: float = 300.0
    job_memory: int = 4 * 1024**3
    streams: int = 20
    samples: int = 10_000_000
    running: int = 20
    failures: int = 10
    failures_within: float = 300.0


@dataclass(frozen=True)
class Oidc:
    """A company's login service (OpenID Connect).

    Attributes
    ----------
    issuer : str
        Its address; ``/.well-known/openid-configuration`` is read below it.
    client_id, client_secret : str
        What the service knows this server by.
    roles_claim : str
        Claim of the identity token that lists the groups of a user.
    roles : dict of str to str
        Group -> role.
    """

    issuer: str
    client_id: str
    client_secret: str = field(repr=False)
    roles_claim: str = "groups"
    roles: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Settings:
    """What a server is started with.

    Attributes
    ----------
    store : str
        Folder or URL of the store.
    data : Path
        Folder of accounts, audit trail, sign-offs and index; it is this user's alone.
    host, port
        Where to listen.
    names : tuple of str
        Host names by which the server may be addressed, besides those of loopback.
    https : tuple of Path or None
        Files of its certificate and key.
    behind_proxy : bool
        A proxy in front of the server ends TLS, and says in ``X-Forwarded-For`` who asks.
    proxies : tuple of str
        Addresses and networks of that proxy: what others say in these headers counts for nothing.
    coordinate : tuple of str or None
        Options of the ``clearcap coordinate`` that the server starts and keeps alive; None: it starts none.
    processes : int
        Processes for what takes processor time: simulations, questions, reports.
    limits : Limits
    oidc : Oidc or None
    webhook_hosts : tuple of str
        Hosts in the server's own network to which webhooks may lead.
    """

    store: str
    data: Path
    host: str = "127.0.0.1"
    port: int = PORT
    names: tuple[str, ...] = ()
    https: tuple[Path, Path] | None = None
    behind_proxy: bool = False
    proxies: tuple[str, ...] = LOOPBACK[:2]
    coordinate: tuple[str, ...] | None = None
    processes: int = 2
    limits: Limits = Limits()
    oidc: Oidc | None = None
    webhook_hosts: tuple[str, ...] = ()

    @property
    def is_local(self) -> bool:
        """Whether only this machine can connect, without TLS."""
        return self.https is None and not self.behind_proxy

    @property
    def workers(self) -> int | None:
        """Number of workers that the server's coordinator starts; None if they are another's."""
        if self.coordinate is None or "--scheduler" in self.coordinate:
            return None
        if "--workers" in self.coordinate:
            return int(self.coordinate[self.coordinate.index("--workers") + 1])
        return None if "--cluster" in self.coordinate else len(os.sched_getaffinity(0))

    @property
    def address(self) -> str:
        """The address that a user types, without a path."""
        scheme = "http" if self.is_local else "https"
        host = f"[{self.host}]" if ":" in self.host else self.host
        if self.names:
            host = self.names[0]
        return f"{scheme}://{host}" if self.behind_proxy and self.names else f"{scheme}://{host}:{self.port}"
