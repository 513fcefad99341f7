"""The settings of a server."""

from dataclasses import dataclass, field
from pathlib import Path

from campaign.processes import cores

LOOPBACK = ("127.0.0.1", "::1", "localhost")
PORT = 8700
PREFIX = "/api/v1"  # of the paths of the API


@dataclass(frozen=True)
class Limits:
    """Limits on the resources of one request and of one user."""

    body: int = 64 * 1024**2  # largest body of a request that brings files [bytes]
    bodies: int = 256 * 1024**2  # of all bodies at work; one address may have a quarter, or one largest body [bytes]
    connections: int = 200  # open ones of one address
    body_seconds: float = 60.0  # a body must have arrived within this time
    head_seconds: float = 20.0  # as must the first line and the headers of a request
    # Interval between checks of a client that reads an answer: it must have read 1 KiB for each second.
    read_seconds: float = 60.0
    jobs: int = 2  # running jobs of a user
    waiting: int = 32  # waiting jobs of a user
    job_seconds: float = 300.0
    job_memory: int = 4 * 1024**3  # of one job [bytes]
    streams: int = 20  # of events or rows, that a user may have open
    samples: int = 10_000_000  # largest number of samples of a campaign submitted to this server
    running: int = 20  # campaigns of a user, queued or running
    failures: int = 10  # failed logins from one address, or for one name, within `failures_within`
    failures_within: float = 300.0  # [s]


@dataclass(frozen=True)
class Oidc:
    """A company's login service (OpenID Connect)."""

    issuer: str  # URL; ``/.well-known/openid-configuration`` is read below it
    client_id: str  # of this server at the login service, as is the secret
    client_secret: str = field(repr=False)
    roles_claim: str = "groups"  # of the identity token; lists the groups of a user
    roles: dict[str, str] = field(default_factory=dict)  # group -> role


@dataclass(frozen=True)
class Settings:
    """The settings that a server is started with."""

    store: str  # folder or URL
    data: Path  # accounts, audit trail, sign-offs and index; only the user who runs the server may access it
    host: str = "127.0.0.1"
    port: int = PORT
    names: tuple[str, ...] = ()  # host names of the server, besides those of loopback
    https: tuple[Path, Path] | None = None  # files of certificate and key
    behind_proxy: bool = False  # a proxy ends TLS and passes the client's address in ``X-Forwarded-For``
    proxies: tuple[str, ...] = LOOPBACK[:2]  # addresses and networks of that proxy; from others the header is ignored
    # Options of the ``clearcap coordinate`` that the server keeps alive; None: it starts none.
    coordinate: tuple[str, ...] | None = None
    processes: int = 2  # that compute simulations, questions and reports
    limits: Limits = Limits()
    oidc: Oidc | None = None
    four_eyes: bool = False  # nobody signs a campaign that he has submitted himself
    webhook_hosts: tuple[str, ...] = ()  # hosts in the server's own network that webhooks may address

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
            from campaign.cluster.cluster import workers_in  # loads dask, which the server does not need

            number = workers_in(self.coordinate[self.coordinate.index("--workers") + 1])
            return number if isinstance(number, int) else number[1]
        return None if "--cluster" in self.coordinate else cores()

    @property
    def address(self) -> str:
        """The URL under which users reach the server, without a path."""
        scheme = "http" if self.is_local else "https"
        host = f"[{self.host}]" if ":" in self.host else self.host
        if self.names:
            host = self.names[0]
        return f"{scheme}://{host}" if self.behind_proxy and self.names else f"{scheme}://{host}:{self.port}"
