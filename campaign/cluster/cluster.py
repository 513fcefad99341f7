"""The user's choice of the workers that compute a campaign, and its files for mutual TLS, checked before use."""

import os
import ssl
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import dask
from distributed import Client, Security

from campaign.errors import SpecError

FROM_CONFIGURATION = "distributed.comm.tls"  # of dask: ca-file, client.cert, client.key
NEEDED = (
    "needs certificates (clearcap certificates makes them); give --tls-ca, --tls-cert and --tls-key, or set"
    f" {FROM_CONFIGURATION}.ca-file, .client.cert and .client.key in dask's configuration"
)
_ROLES = ("client", "scheduler", "worker")

Kind = Literal["local", "slurm", "oar", "pbs", "kubernetes"]
KINDS: tuple[Kind, ...] = get_args(Kind)
BATCH_SYSTEMS = ("slurm", "oar", "pbs")


@dataclass(frozen=True)
class Tls:
    """Files for mutual TLS, in PEM; `clearcap certificates` makes them.

    Attributes
    ----------
    ca : str
        Certificate of the authority whose certificates are accepted.
    cert, key : str
        Certificate of this side and its private key.
    """

    ca: str
    cert: str
    key: str


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
    workers : int, tuple of two int, or None
        Number of workers to start; None for one on each core of this machine. Of a batch system, also the least and the
        largest number: jobs then come and go with the work that is left.
    tls : Tls or None
        Certificates; None for those of dask's configuration.
    insecure : bool
        Whether to allow traffic beyond this machine that is neither encrypted nor authenticated.
    """

    scheduler: str | None = None
    kind: Kind = "local"
    workers: int | tuple[int, int] | None = None
    tls: Tls | None = None
    insecure: bool = False

    @classmethod
    def of(cls, where: "Cluster | Client | None", workers: int | None = None) -> "Cluster":
        """Return a cluster as it is, that of a dask client of one's own, or None's: ``workers`` on this machine.

        The scheduler of a client is reached by its address, with the certificate files of the client. Raises SpecError
        for a scheduler that other processes cannot reach, and for certificates that are no files.
        """
        if not isinstance(where, Client):
            return where or cls(workers=workers)
        address = str(getattr(where.scheduler, "address", where))
        if not address.startswith(("tcp://", "tls://")):
            raise SpecError(
                f"client of {address:.80}: another process cannot reach this scheduler; allowed: tcp:// and tls://;"
                " make it with LocalCluster(processes=True), or connect the client to a running scheduler"
            )
        given = [getattr(where.security, name) for name in ("tls_ca_file", "tls_client_cert", "tls_client_key")]
        if not address.startswith("tls://"):
            return cls(scheduler=address)
        if any(not isinstance(name, str) or "\n" in name for name in given):
            raise SpecError(
                f"client of {address:.80}: its certificates are no files; allowed: Security(tls_ca_file, "
                "tls_client_cert, tls_client_key) with names of files, as clearcap certificates makes them"
            )
        return cls(scheduler=address, tls=Tls(*given))

    @property
    def starts_here(self) -> bool:
        """Whether the workers are started as processes on this machine."""
        return self.scheduler is None and self.kind == "local"

    @property
    def follows_work(self) -> bool:
        """Whether the number of workers follows the work, between two limits."""
        return isinstance(self.workers, tuple)

    @property
    def least(self) -> int | None:
        """The least number of workers; None for one on each core of this machine."""
        return self.workers[0] if isinstance(self.workers, tuple) else self.workers

    @property
    def most(self) -> int | None:
        """The largest number of workers; None for one on each core of this machine."""
        return self.workers[1] if isinstance(self.workers, tuple) else self.workers

    @property
    def workers_text(self) -> str | None:
        """The number of workers as the option ``--workers`` has it; None without one."""
        if self.workers is None:
            return None
        return ":".join(map(str, self.workers)) if isinstance(self.workers, tuple) else str(self.workers)

    def options(self) -> list[str]:
        """Return the equivalent options of the command."""
        words: list[str] = []
        tls = self.tls
        for option, value in (
            ("--scheduler", self.scheduler),
            ("--cluster", self.kind if self.kind != "local" else None),
            ("--workers", self.workers_text),
            ("--tls-ca", tls and tls.ca),
            ("--tls-cert", tls and tls.cert),
            ("--tls-key", tls and tls.key),
        ):
            words += [] if value is None else [option, str(value)]
        return [*words, "--insecure"] if self.insecure else words


def workers_in(text: str) -> int | tuple[int, int]:
    """Return the number of workers that a text says, ``8``, or the two limits of it, ``2:64``; SpecError otherwise."""
    numbers = [int(word) if word.isascii() and word.isdigit() else 0 for word in text.split(":")]
    if len(numbers) == 1 and numbers[0] > 0:
        return numbers[0]
    if len(numbers) == 2 and 0 < numbers[0] <= numbers[1]:
        return numbers[0], numbers[1]
    raise SpecError(f"--workers {text}: neither a number nor two with a colon, MIN:MAX; allowed: 8, or 2:64")


def security(tls: Tls | None) -> Security | None:
    """Return checked certificates for dask: the given ones, or those of dask's configuration; None without either."""
    tls = tls or configured()
    if tls is None:
        return None
    for option, name in (("--tls-ca", tls.ca), ("--tls-cert", tls.cert), ("--tls-key", tls.key)):
        _check_file(option, Path(name))
    _check_private(Path(tls.key))
    try:
        ssl.create_default_context(cafile=tls.ca).load_cert_chain(tls.cert, tls.key, password=_no_password)
    except (ssl.SSLError, ValueError) as error:
        raise SpecError(
            f"--tls-ca {tls.ca}, --tls-cert {tls.cert}, --tls-key {tls.key}: not a PEM certificate of an authority, a"
            f" PEM certificate and the key that belongs to it, without a password ({error}); clearcap certificates"
            " makes such files"
        ) from error
    roles = {f"tls_{role}_{part}": getattr(tls, part) for role in _ROLES for part in ("cert", "key")}
    return Security(tls_ca_file=tls.ca, require_encryption=True, **roles)  # type: ignore[no-untyped-call]


def _no_password() -> str:
    """Raise ValueError; otherwise OpenSSL would ask for the key's password at the terminal."""
    raise ValueError("the key has a password")


def configured() -> Tls | None:
    """Return the client's certificates from dask's configuration (``DASK_CONFIG``, ``~/.config/dask``), if any."""
    names = [dask.config.get(f"{FROM_CONFIGURATION}.{key}", None) for key in ("ca-file", "client.cert", "client.key")]
    return Tls(*names) if all(names) else None


def _check_file(option: str, path: Path) -> None:
    try:
        with path.open("rb"):
            pass
    except OSError as error:
        raise SpecError(f"{option} {path}: cannot be read ({error.strerror}); name a readable PEM file") from error


def _check_private(path: Path) -> None:
    """Refuse a private key of this user that other users can read, as ssh does."""
    status = path.stat()
    if status.st_uid == os.getuid() and status.st_mode & 0o077:
        raise SpecError(
            f"--tls-key {path}: other users can read it (mode {stat.S_IMODE(status.st_mode):04o}), and whoever has it"
            f" can run code on the cluster; chmod 600 {path}, and make new certificates if someone read it"
        )
