"""The settings of a server."""

import os
from dataclasses import dataclass, field
from pathlib import Path

LOOPBACK = ("127.0.0.1", "::1", "localhost")
PORT = 8700


@dataclass(frozen=True)
class Limits:
    """Limits on the resources of one request and of one user.

    Attributes
    ----------
    body : int
        Largest body of a request [bytes].
    body_seconds : float
        Time in which a body must have arrived [s].
    head_seconds : float
        Time in which the first line and the headers of a request must have arrived [s].
    read_seconds : float
        Interval between checks of a client that reads an answer: it must have read 1 KiB for each second [s].
    jobs, waiting : int
        Jobs of a user that may be running, and waiting, at the same time.
    job_seconds : float
        Longest time of one job [s].
    job_memory : int
        Largest memory of one job [bytes].
    streams : int
        Event streams that a user may have open at the same time.
    samples : int
        Largest number of samples of a campaign submitted to this server.
    running : int
        Campaigns of a user that may be queued or running at the same time.
    failures : int
        Failed logins from one address, or for one name, that are allowed within `failures_within`.
    failures_within : float
        Time span of `failures` [s].
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
        Address of the login service; ``/.well-known/openid-configuration`` is read below it.
    client_id, client_secret : str
        Credentials of this server at the login service.
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
    """The settings that a server is started with.

    Attributes
    ----------
    store : str
        Folder or URL of the store.
    data : Path
        Folder of accounts, audit trail, sign-offs and index; only the user who runs the server may access it.
    host, port
        Where to listen.
    names : tuple of str
        Host names by which the server may be addressed, besides those of loopback.
    https : tuple of Path or None
        Files of the server's certificate and key.
    behind_proxy : bool
        Whether a proxy in front of the server ends TLS and passes the client's address in ``X-Forwarded-For``.
    proxies : tuple of str
        Addresses and networks of that proxy; the header is ignored if it comes from another address.
    coordinate : tuple of str or None
        Options of the ``clearcap coordinate`` that the server starts and keeps alive; None if it starts no coordinator.
    processes : int
        Number of processes for simulations, questions and reports, which need much processor time.
    limits : Limits
    oidc : Oidc or None
    webhook_hosts : tuple of str
        Hosts in the server's own network that webhooks may address.
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
        """Whether the server has neither TLS nor a proxy, so that only this machine may connect."""
        return self.https is None and not self.behind_proxy

    @property
    def workers(self) -> int | None:
        """Number of local workers that the server's coordinator starts; None if it starts none on this machine."""
        if self.coordinate is None or "--scheduler" in self.coordinate:
            return None
        if "--workers" in self.coordinate:
            return int(self.coordinate[self.coordinate.index("--workers") + 1])
        return None if "--cluster" in self.coordinate else len(os.sched_getaffinity(0))

    @property
    def address(self) -> str:
        """The URL under which users reach the server, without a path."""
        scheme = "http" if self.is_local else "https"
        host = f"[{self.host}]" if ":" in self.host else self.host
        if self.names:
            host = self.names[0]
        return f"{scheme}://{host}" if self.behind_proxy and self.names else f"{scheme}://{host}:{self.port}"
