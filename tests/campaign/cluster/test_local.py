"""Local workers: bound to loopback, single-threaded, deaf to Ctrl-C, silent, and gone at the end."""

import asyncio
import os
import re
import signal
import sys
from contextlib import contextmanager, suppress
from multiprocessing.popen_spawn_posix import Popen
from pathlib import Path

import psutil
import pytest
from distributed.comm.core import connect as open_comm

from campaign.cluster import local
from campaign.cluster.local import PREFIX, interrupts_held, local_client
from campaign.cluster.tls_certificates import passing_security
from campaign.errors import UnreachableError

pytestmark = pytest.mark.processes


@pytest.fixture(scope="module")
def others():
    """Return the ports on which this process listens for reasons of its own, as a plugin of pytest does."""
    return {(s.laddr.ip, s.laddr.port) for s in listening()}


@pytest.fixture(scope="module")
def client(others):
    """Return a client of two workers, started where nobody says how many threads a library may have."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
            patch.delenv(name, raising=False)
        with local_client(2) as client:
            yield client


def processes():
    """Return this process and all below it."""
    this = psutil.Process()
    return [this, *this.children(recursive=True)]


def listening():
    """Return the sockets on which this process and those below it listen."""
    sockets = [s for process in processes() for s in process.net_connections(kind="all")]
    return [s for s in sockets if s.status == psutil.CONN_LISTEN]


def test_binds_loopback_only(client, others):
    """Nobody outside this machine can reach the scheduler, a worker or a dashboard."""
    assert {s.laddr.ip for s in listening() if (s.laddr.ip, s.laddr.port) not in others} == {"127.0.0.1"}


def test_only_scheduler_workers_and_their_nannies_listen(client, others):
    """Dask's HTTP servers, which answer everybody, are closed."""
    ports = {s.laddr.port for s in listening()} - {port for _, port in others}
    info = client.scheduler_info(n_workers=-1)
    known = [info["address"], *info["workers"], *(worker["nanny"] for worker in info["workers"].values())]
    assert all(address.startswith("tls://127.0.0.1:") for address in known)
    assert ports == {int(address.rsplit(":", 1)[1]) for address in known}


def test_nobody_without_the_certificates_of_the_run_is_heard(client):
    """Neither in the clear nor with other certificates, by scheduler, workers and nannies."""
    theirs = passing_security().get_connection_args("client")
    info = client.scheduler_info(n_workers=-1)
    known = [info["address"], *info["workers"], *(worker["nanny"] for worker in info["workers"].values())]
    for address in known:
        for protocol, arguments in (("tcp", {}), ("tls", theirs)):
            other = f"{protocol}://{address.split('://')[1]}"
            with pytest.raises(OSError):  # noqa: PT011  # each way of being refused
                asyncio.run(open_comm(other, timeout=2, **arguments))


def test_files_of_the_run_are_private(client):
    """No key lies in a file, an environment or a command line; the scratch folder is the run's own."""
    (folder,) = {os.path.dirname(os.path.dirname(path)) for path in client.run(scratch).values()}
    assert os.path.basename(folder).startswith(PREFIX)
    assert os.stat(folder).st_mode & 0o077 == 0
    for process in processes():
        for text in (*process.cmdline(), *process.environ().values()):
            assert "PRIVATE KEY" not in text
    keys = [path for path in Path(folder).rglob("*") if path.is_file() and "PRIVATE" in path.read_text("latin-1")]
    assert keys == []


def scratch(dask_worker):
    """Return the scratch folder of a worker."""
    return dask_worker.local_directory


def test_single_threaded_processes(client):
    """Each worker is a process of its own with one thread for tasks and one for every library."""
    assert list(client.nthreads().values()) == [1, 1]
    environments = client.run(environment).values()
    pids = {pid for pid, _ in environments}
    assert len(pids | {os.getpid()}) == 3
    assert all(threads == ["1", "1", "1"] for _, threads in environments)


def environment():
    """Return the process and its thread limits."""
    names = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    return os.getpid(), [os.environ.get(name) for name in names]


def test_ctrl_c_does_not_reach_workers(client):
    """A terminal sends Ctrl-C to all processes; workers leave it to the one that talks to the user."""
    before = {pid for pid, _ in client.run(environment).values()}
    for pid in before:
        os.kill(pid, signal.SIGINT)
    assert client.submit(sum, [1, 2]).result(timeout=600) == 3
    assert {pid for pid, _ in client.run(environment).values()} == before


@pytest.mark.slow
def test_a_restarted_worker_is_like_the_first(client):
    """A worker that was killed comes back with the same settings, as deaf to Ctrl-C."""
    before = {pid for pid, _ in client.run(environment).values()}
    os.kill(min(before), signal.SIGKILL)
    client.wait_for_workers(2, timeout=600)
    while min(before) in (after := dict(client.run(environment, on_error="ignore").values())) or len(after) < 2:
        client.wait_for_workers(2, timeout=600)
    assert all(threads == ["1", "1", "1"] for threads in after.values())
    for pid in after:
        os.kill(pid, signal.SIGINT)
    assert client.submit(sum, [1, 2]).result(timeout=600) == 3
    assert dict(client.run(environment).values()).keys() == after.keys()


def test_nothing_stays(capfd):
    """Workers are gone at the end, and neither they nor dask said a word."""
    path = list(sys.path)
    with local_client(1) as client:
        (pid, _), *_ = client.run(environment).values()
        assert psutil.pid_exists(pid)
    assert not psutil.pid_exists(pid)
    assert sys.path == path
    assert capfd.readouterr() == ("", "")


def workers():
    """Return the processes of workers, those that are being started too."""
    children = set()
    for child in psutil.Process().children():
        with suppress(psutil.Error):
            children |= {child} if "spawn_main" in " ".join(child.cmdline()) else set()
    return children


@contextmanager
def struck(signal_number, times, within=600.0):
    """Send a signal to the first workers of the block, as many as said, as they start; yield those there before."""
    launch, before, hit = Popen._launch, workers(), []

    def launch_and_strike(self, process):
        launch(self, process)
        if len(hit) < times:
            hit.append(self.pid)
            os.kill(self.pid, signal_number)
            local.STARTS_WITHIN = 600.0  # the next ones have time

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(local, "STARTS_WITHIN", within)
        patch.setattr(Popen, "_launch", launch_and_strike)
        yield before


@pytest.mark.slow
@pytest.mark.parametrize(("signal_number", "within"), [(signal.SIGKILL, 600.0), (signal.SIGSTOP, 20.0)])
def test_a_worker_that_ends_or_hangs_while_it_starts(signal_number, within, monkeypatch):
    """Workers are started once more; nothing stays of the first ones."""
    said = []  # dask mutes the handlers of pytest
    monkeypatch.setattr("campaign.cluster.local.logger.warning", lambda text, *values: said.append(text % values))
    with struck(signal_number, 1, within) as before:
        with local_client(1) as client:
            assert client.submit(sum, [1, 2]).result(timeout=600) == 3
            assert len(workers() - before) == 1
        assert workers() == before
    assert ["did not start" in text for text in said] == [True]


@pytest.mark.slow
def test_workers_that_never_start(tmp_path, monkeypatch):
    """A few attempts, then one message, and no process and no folder stays."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with struck(signal.SIGKILL, 99) as before:
        with pytest.raises(UnreachableError, match="--workers N") as raised, local_client(2):
            pass
        assert raised.value.exit_code == 4
        assert workers() == before
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_termination_waits_until_the_workers_run():
    """SIGTERM while workers start is handled as soon as they can be stopped in order."""
    seen = []
    before = signal.signal(signal.SIGTERM, lambda *_: seen.append("handled"))
    try:
        with interrupts_held():
            os.kill(os.getpid(), signal.SIGTERM)
            seen.append("held")
        assert seen == ["held", "handled"]
        with local_client(1) as client:
            (pid, _), *_ = client.run(environment).values()
            masked = int(re.search(r"SigBlk:\s*(\w+)", Path(f"/proc/{pid}/status").read_text())[1], 16)
        assert [bool(masked & 1 << (s - 1)) for s in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM)] == [1, 1, 0]
    finally:
        signal.signal(signal.SIGTERM, before)
