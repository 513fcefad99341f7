"""A campaign of one user, attacked by another user of the same machine on every port, process and file it has."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from campaign.cluster.tls_certificates import make_certificates
from campaign.coordinator.submit import submit
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.store.store import repeated_shares
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from engine import simulate
from tests.campaign.cluster_processes import free_port, scheduler, tls_arguments
from tests.campaign.commands import ROOT, clearcap
from tests.campaign.driving import rows
from tests.security.attacker import PREPARED, UID
from tests.until import until

pytestmark = [
    pytest.mark.slow,
    pytest.mark.processes,
    pytest.mark.skipif(os.getuid() != 0, reason="needs root, to act as two users"),
]

WITHIN = 600.0  # s, which only a hang reaches
SAMPLES = 5000  # of a campaign that is cancelled when the attack is over: its end is no matter of speed
SECRET = "what only the first user may know"
EXECUTED = """\
import importlib, os, sys
open({!r}, "a").write(f"{{__name__}} as {{os.getuid()}}\\n")
sys.path[:] = [entry for entry in sys.path if entry != os.path.dirname(__file__)]
del sys.modules[__name__]
importlib.import_module(__name__)
"""


@pytest.fixture(scope="module")
def ground():
    """Return a folder that both users can enter: a 0600 file, a sticky folder for temporary files, certificates.

    The attacker was there before: in the folder for temporary files he made the one that dask uses by default, with
    modules that report when someone imports them, and then hand over to the true ones, so that nobody notices.
    """
    folder = Path(tempfile.mkdtemp(prefix="clearcap-two-users-", dir="/tmp"))
    folder.chmod(0o755)
    (folder / "secret").touch(mode=0o600)
    (folder / "secret").write_text(SECRET)
    for name, mode in (("temporary", 0o1777), ("planted", 0o777)):
        (folder / name).mkdir()
        (folder / name).chmod(mode)
    prepared = folder / "temporary" / PREPARED
    prepared.mkdir()
    prepared.chmod(0o777)
    for name in {*sys.stdlib_module_names, "bokeh", "crick", "gilknocker", "cupy", "pynvml", "setproctitle"} - {"os"}:
        (prepared / f"{name}.py").write_text(EXECUTED.format(str(folder / "planted" / "executed")))
    make_certificates(folder / "theirs", 2)
    for path in (folder / "theirs", *(folder / "theirs").iterdir(), prepared, *prepared.iterdir()):
        os.chown(path, UID, UID)
    yield folder
    shutil.rmtree(folder)


@pytest.fixture(scope="module")
def campaign_file(tmp_path_factory):
    """Return a campaign that does not end by itself."""
    from tests.campaign.conftest import SPEC

    path = tmp_path_factory.mktemp("spec") / "demo.toml"
    path.write_text(SPEC.replace("samples = 25", f"samples = {SAMPLES}"))
    return path


def quiet_rows(folder, campaign_file, samples):
    """Return the rows of some samples, as a quiet day has them."""
    store = open_store(str(folder))
    plan = submit(store, load_campaign(str(campaign_file)), 1)
    address = CampaignAddress.of(store, plan, simulate, repeated_shares(store, plan))
    for sample in samples:
        run_batch(address, BatchRequest(sample))
    return rows(store, plan)


def attack(ground, ports, pids):
    """Return what the other user obtained."""
    marker = str(ground / "temporary" / "marker")
    plan = {"ports": ports, "pids": pids, "secret": str(ground / "secret"), "marker": marker}
    plan |= {"theirs": str(ground / "theirs"), "temporary": str(ground / "temporary")}
    done = subprocess.run(
        [sys.executable, "-m", "tests.security.attacker"],
        input=json.dumps(plan),
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=WITHIN,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_attack_succeeds_where_nothing_is_closed(ground):
    """On schedulers as dask starts them by default, and with the attacker's own authority: else it proves nothing."""
    plain, own = free_port(), free_port()
    encrypted = ("--protocol=tls", *tls_arguments(ground / "theirs", "scheduler"))
    ways, found = (f"{plain} tcp run_function", f"{own} tls, own certificate run_function"), []

    def succeeds():
        found[:] = attack(ground, [("127.0.0.1", plain), ("127.0.0.1", own)], [])
        return all(any(way in text and SECRET in text for text in found) for way in ways)

    with scheduler(plain), scheduler(own, *encrypted):
        until(succeeds, lambda: str(found))
    assert (ground / "temporary" / "marker").read_text() == "uid 0"
    (ground / "temporary" / "marker").unlink()


@contextmanager
def started(*words, cwd, environment):
    """Run the command in the background; yield its process."""
    with (cwd / "log").open("wb") as log:
        process = subprocess.Popen([sys.executable, "-m", "clearcap", *words], cwd=cwd, env=environment, stderr=log)
    try:
        yield psutil.Process(process.pid)
        process.wait(WITHIN)
    finally:
        process.kill()
        process.wait()


@contextmanager
def by_run(campaign_file, cwd, environment):
    with started("run", str(campaign_file), *ALIKE, "--no-report", cwd=cwd, environment=environment) as process:
        yield process


@contextmanager
def by_submit(campaign_file, cwd, environment):
    command = [sys.executable, "-m", "clearcap", "submit", str(campaign_file), *ALIKE, "--json"]
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=WITHIN)
    assert done.returncode == 0, done.stderr
    process = psutil.Process(json.loads(done.stdout)["pid"])
    try:
        yield process
        process.wait(WITHIN)
    finally:
        for other in (process, *process.children(recursive=True)) if process.is_running() else ():
            other.kill()


@contextmanager
def by_coordinate(campaign_file, cwd, environment):
    done = clearcap("submit", campaign_file, "--store", "runs", "--batch-size", 1, "--queue-only", cwd=cwd)
    assert done.returncode == 0, done.stderr
    words = ("coordinate", "--store", "runs", "--workers", "1", "--once", "--no-report")
    with started(*words, cwd=cwd, environment=environment) as process:
        yield process


ALIKE = ("--store", "runs", "--workers", "1", "--batch-size", "1")


@pytest.mark.parametrize("way", [by_run, by_submit, by_coordinate])
def test_another_user_gets_nothing(way, ground, campaign_file, tmp_path):
    """No code is run, no file read or written, no page served; and the rows are those of a quiet day."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(ground / "temporary")}
    with way(campaign_file, tmp_path, environment) as process:
        until(lambda: list(tmp_path.glob("runs/*/parts/*.parquet")) or not process.is_running())
        tree = [process, *process.children(recursive=True)]
        sockets = [s for p in tree for s in p.net_connections("all")]
        listening = [s for s in sockets if s.status == psutil.CONN_LISTEN]
        assert {s.laddr.ip for s in listening} == {"127.0.0.1"}
        assert [s.laddr for s in sockets if isinstance(s.laddr, str) and s.laddr] == []  # unix sockets with a name
        found = attack(ground, sorted((s.laddr.ip, s.laddr.port) for s in listening), [p.pid for p in tree])
        assert process.is_running(), "the campaign ended before the attack"
        (campaign_id,) = open_store(str(tmp_path / "runs")).campaigns()
        cancelled = clearcap("cancel", campaign_id, "--store", "runs", cwd=tmp_path)
        assert cancelled.returncode == 0, cancelled.stderr
    assert found == []
    assert not (ground / "temporary" / "marker").exists()
    assert list((ground / "planted").iterdir()) == []
    assert [p.name for p in (ground / "temporary").iterdir()] == [PREPARED]
    store = open_store(str(tmp_path / "runs"))
    attacked = rows(store, store.plan(campaign_id))
    samples = attacked["sample"].to_pylist()
    assert 0 < len(samples) < SAMPLES
    assert attacked.equals(quiet_rows(tmp_path / "quiet", campaign_file, samples))
