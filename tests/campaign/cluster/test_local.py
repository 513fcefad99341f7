"""Local workers: bound to loopback, single-threaded, deaf to Ctrl-C, silent, and gone at the end."""

import os
import signal

import psutil
import pytest

from campaign.cluster.local import local_client


@pytest.fixture(scope="module")
def client():
    """Return a client of two workers."""
    with local_client(2) as client:
        yield client


def processes():
    """Return this process and all below it."""
    this = psutil.Process()
    return [this, *this.children(recursive=True)]


def listening():
    """Return the addresses on which this process and those below it listen."""
    sockets = [s for process in processes() for s in process.net_connections(kind="inet")]
    return {s.laddr.ip for s in sockets if s.status == psutil.CONN_LISTEN}


def test_binds_loopback_only(client):
    """Nobody outside this machine can reach the scheduler, a worker or a dashboard."""
    assert listening() == {"127.0.0.1"}


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
    assert client.submit(sum, [1, 2]).result(timeout=20) == 3
    assert {pid for pid, _ in client.run(environment).values()} == before


def test_a_restarted_worker_is_like_the_first(client):
    """A worker that was killed comes back with the same settings, as deaf to Ctrl-C."""
    before = {pid for pid, _ in client.run(environment).values()}
    os.kill(min(before), signal.SIGKILL)
    client.wait_for_workers(2, timeout=30)
    while min(before) in (after := dict(client.run(environment, on_error="ignore").values())) or len(after) < 2:
        client.wait_for_workers(2, timeout=30)
    assert all(threads == ["1", "1", "1"] for threads in after.values())
    for pid in after:
        os.kill(pid, signal.SIGINT)
    assert client.submit(sum, [1, 2]).result(timeout=20) == 3
    assert dict(client.run(environment).values()).keys() == after.keys()


def test_nothing_stays(capfd):
    """Workers are gone at the end, and neither they nor dask said a word."""
    with local_client(1) as client:
        (pid, _), *_ = client.run(environment).values()
        assert psutil.pid_exists(pid)
    assert not psutil.pid_exists(pid)
    assert capfd.readouterr() == ("", "")
