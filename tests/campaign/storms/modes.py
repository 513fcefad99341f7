"""The ways in which a campaign is computed in a storm; the supervisor repeats what ends too early, as people do."""

import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from campaign.cluster.tls_certificates import make_certificates
from engine import simulate
from engine.platform.private_folder import private_folder
from tests.campaign import fake_engine
from tests.campaign.cluster_processes import free_port
from tests.campaign.storms.cluster import start_cluster
from tests.campaign.storms.server import new_session, signable_campaign
from tests.campaign.storms.visitors import Visitors

STAND_IN, ENGINE = "tests.campaign.storms.command", "clearcap"
ANOTHER_MACHINE = ("unshare", "--pid", "--fork", "--kill-child", "--mount-proc")  # by all that a process can see
BATCH = 6
AGAIN = 3.0  # s, after which a campaign is submitted again that nobody computes any more


@dataclass(frozen=True)
class Mode:
    """A way to compute a campaign.

    Attributes
    ----------
    start : callable
        Has the processes of a storm started, for a campaign file.
    command : str
        Module that is the command: with the engine, or with the stand-in.
    clustered : bool
        Whether scheduler and workers have processes of their own.
    splits : bool
        Whether a second coordinator waits for the first one's silence.
    serves : bool
        Whether the coordinator goes on when the campaign is over.
    has_server : bool
        Whether the campaign is posted to a server, which has it computed.
    """

    start: Callable
    command: str = STAND_IN
    clustered: bool = False
    splits: bool = False
    serves: bool = False
    has_server: bool = False

    @property
    def simulate(self):
        """The physics."""
        return simulate if self.command == ENGINE else fake_engine.simulate

    def is_over(self, storm):
        """Return whether the campaign is complete, and those who computed it have ended as far as they will."""
        if self.serves:
            state = storm.document("state.json")
            return state.get("state") == "completed" and not state.get("open")
        return any(storm.supervisor.finished(name) for name in ("coordinator", "second"))


def start_run(storm, file, command):
    """Start ``clearcap run`` on this machine, until it ends with 0."""
    words = ("run", file, "--store", storm.store.url, "--workers", 2, "--batch-size", BATCH)
    storm.supervisor.add("coordinator", command, *words, once=True)


def start_submit(storm, file, command):
    """Start ``clearcap submit``, which starts a coordinator; and again, in case that has died."""
    words = ("submit", file, "--store", storm.store.url, "--workers", 2, "--batch-size", BATCH)
    storm.supervisor.add("submit", command, *words, after=AGAIN)


def start_service(storm, file, command):
    """Start a coordinator that serves the store, on a cluster with mutual TLS."""
    words = ("coordinate", "--store", storm.store.url)
    storm.supervisor.add("coordinator", command, *words, *_cluster(storm))


def start_two(storm, file, command):
    """Start two coordinators of one campaign, the second one as if on another machine."""
    words = ("coordinate", storm.campaign, "--store", storm.store.url, "--no-report", *_cluster(storm))
    storm.supervisor.add("coordinator", command, *words, once=True)
    storm.supervisor.add("second", command, *words, once=True, prefix=ANOTHER_MACHINE)


def start_server(storm, file, command, data=None):
    """Start ``clearcap serve`` with workers of its own, and those who use it; one of them posts the campaign.

    Its accounts lie in a folder that is never disturbed, unless another one is given.
    """
    data, port = private_folder(storm.supervisor.folder if data is None else data, "data"), free_port()
    storm.accounts = data
    session, earlier = new_session(data), signable_campaign(storm.store, storm.supervisor.folder)
    words = ("serve", "--store", storm.store.url, "--data", data, "--port", port, "--workers", 2, "--json")
    storm.supervisor.add("server", command, *words)
    text = Path(file).read_text()
    storm.visitors = Visitors(f"http://127.0.0.1:{port}", session, text, storm.campaign, earlier)
    storm.visitors.arrive()


def start_server_on_the_disk(storm, file, command):
    """Start it with its accounts on the disk of the store, which becomes full and read-only."""
    start_server(storm, file, command, storm.disk)


def _cluster(storm):
    """Have a scheduler and two workers started; return the options that reach them."""
    folder = storm.supervisor.folder
    certificates = folder / "certificates"
    make_certificates(certificates, 90)
    address = start_cluster(storm.supervisor, folder, tls=certificates)
    keys = [f"--tls-ca={certificates}/ca.pem", f"--tls-cert={certificates}/client.pem"]
    return ("--scheduler", address, *keys, f"--tls-key={certificates}/client.key")


MODES = {
    "run": Mode(start_run),
    "submit": Mode(start_submit, serves=True),
    "service, TLS": Mode(start_service, clustered=True, serves=True),
    "two coordinators, TLS": Mode(start_two, clustered=True, splits=True),
    "server": Mode(start_server, serves=True, has_server=True),
    "server, one disk": Mode(start_server_on_the_disk, serves=True, has_server=True),
    "run, engine": Mode(start_run, ENGINE),
    "submit, engine": Mode(start_submit, ENGINE, serves=True),
    "server, engine": Mode(start_server, ENGINE, serves=True, has_server=True),
}
TURNS = [*list(MODES)[:6] * 2, *list(MODES)[6:]]  # of fifteen storms three with the engine, which takes longer to start
STORMS, SHARE = 100, 6


def mode_of(seed):
    """Return the name of the mode of a storm."""
    return TURNS[seed % len(TURNS)]


def chosen(commit):
    """Return the numbers of the storms that are run for a commit: six of the hundred, one or more with a server."""
    chance = random.Random(commit)
    while True:
        seeds = sorted(chance.sample(range(STORMS), SHARE))
        if any(MODES[mode_of(seed)].has_server for seed in seeds):
            return seeds
