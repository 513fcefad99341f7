"""The user's choice of the workers that compute a campaign."""

from dataclasses import dataclass
from typing import Literal, get_args

from campaign.cluster.tls import Tls

Kind = Literal["local", "slurm", "oar", "pbs", "kubernetes"]
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True)
class Cluster:
    """The workers that compute a campaign, as the user specifies them.

    Attributes
    ----------
    scheduler : str or None
        Address (``tcp://host:port``, ``tls://host:port``) or scheduler file (``.json``) of a running dask scheduler;
        None to start workers.
    kind : str
        How workers are started: as processes on this machine, as jobs of a batch system, or in Kubernetes.
    workers : int or None
        Number of workers to start; None for one on each core of this machine.
    tls : Tls or None
        Certificates; None for those of dask's configuration.
    insecure : bool
        Whether to allow traffic beyond this machine that is neither encrypted nor authenticated.
    """

    scheduler: str | None = None
    kind: Kind = "local"
    workers: int | None = None
    tls: Tls | None = None
    insecure: bool = False

    @property
    def starts_here(self) -> bool:
        """Whether the workers are started as processes on this machine."""
        return self.scheduler is None and self.kind == "local"

    def options(self) -> list[str]:
        """Return the equivalent options of the command."""
        words: list[str] = []
        tls = self.tls
        for option, value in (
            ("--scheduler", self.scheduler),
            ("--cluster", self.kind if self.kind != "local" else None),
            ("--workers", self.workers),
            ("--tls-ca", tls and tls.ca),
            ("--tls-cert", tls and tls.cert),
            ("--tls-key", tls and tls.key),
        ):
            words += [] if value is None else [option, str(value)]
        return [*words, "--insecure"] if self.insecure else words
