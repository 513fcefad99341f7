"""Clusters: reached over TLS or loopback or not at all, and never in the clear by mistake."""

import datetime
import json
import logging
import os
import threading
from types import SimpleNamespace

import dask
import psutil
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import serialization

import campaign.cluster.connect
from campaign.cluster.cluster import Cluster, Tls, security
from campaign.cluster.connect import check_cluster, connect
from campaign.cluster.tls_certificates import make_certificates
from campaign.errors import SpecError, UnreachableError
from tests.campaign.cluster_processes import free_port, scheduler, tls_arguments, worker
from tests.each import each


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with certificates."""
    folder = tmp_path_factory.mktemp("tls") / "ours"
    make_certificates(folder, 2)
    return folder


def client_tls(folder):
    """Return a client's certificates."""
    return Tls(*(str(folder / name) for name in ("ca.pem", "client.pem", "client.key")))


@pytest.fixture(scope="module")
def tls_scheduler(folder, tmp_path_factory):
    """Return the address of a scheduler that wants certificates, with one worker."""
    scratch = tmp_path_factory.mktemp("scratch")
    address = f"tls://127.0.0.1:{free_port()}"
    file = scratch / "scheduler.json"
    secured = tls_arguments(folder, "scheduler")
    with (
        scheduler(address.rpartition(":")[2], "--protocol=tls", f"--scheduler-file={file}", *secured),
        worker(address, scratch, "--protocol=tls", *tls_arguments(folder, "worker")),
    ):
        with connect(Cluster(address, tls=client_tls(folder))) as (client, _):
            client.wait_for_workers(1, timeout=600)
        yield address, file


@pytest.fixture
def patient(monkeypatch):
    """Wait for minutes for what is there."""
    monkeypatch.setattr(campaign.cluster.connect, "REACHED_WITHIN", 600.0)


@pytest.fixture
def soon(monkeypatch):
    """Wait a second at most for what is not there."""
    monkeypatch.setattr(campaign.cluster.connect, "REACHED_WITHIN", 1.0)


@pytest.mark.processes
def test_computes_over_tls(tls_scheduler, folder):
    """With certificates of the same authority, by address and by scheduler file."""
    for where in map(str, tls_scheduler):
        with connect(Cluster(where, tls=client_tls(folder))) as (client, _):
            assert client.submit(sum, [1, 2]).result(timeout=600) == 3
            assert client.scheduler.address == tls_scheduler[0]


@pytest.mark.processes
def test_dask_configuration_gives_certificates(tls_scheduler, folder):
    """Who has dask configured need not repeat it."""
    ours = {"distributed.comm.tls.ca-file": str(folder / "ca.pem")}
    ours |= {
        f"distributed.comm.tls.client.{k}": str(folder / f"client.{e}") for k, e in (("cert", "pem"), ("key", "key"))
    }
    with pytest.raises(SpecError, match="needs certificates"):
        check_cluster(Cluster(tls_scheduler[0]))
    with dask.config.set(ours), connect(Cluster(tls_scheduler[0])) as (client, _):
        assert client.submit(sum, [1, 2]).result(timeout=600) == 3


@pytest.mark.processes
def test_another_authority_is_refused(tls_scheduler, tmp_path, patient):
    """A certificate of an authority that is not the cluster's opens nothing, and the message says so."""
    make_certificates(tmp_path / "theirs", 2)
    with (
        pytest.raises(UnreachableError, match="certificate verify failed"),
        connect(Cluster(tls_scheduler[0], tls=client_tls(tmp_path / "theirs"))),
    ):
        pass


@pytest.mark.processes
def test_the_scheduler_refuses_a_certificate_of_another_authority(tls_scheduler, folder, tmp_path, soon):
    """Also who trusts the scheduler must be trusted by it: the authentication is mutual."""
    make_certificates(tmp_path / "theirs", 2)
    mixed = Tls(str(folder / "ca.pem"), str(tmp_path / "theirs/client.pem"), str(tmp_path / "theirs/client.key"))
    with pytest.raises(UnreachableError, match="not reached"), connect(Cluster(tls_scheduler[0], tls=mixed)):
        pass


class LastWeek(datetime.datetime):
    """The time of a week ago."""

    @classmethod
    def now(cls, tz=None):
        """Return the time."""
        return super().now(tz) - datetime.timedelta(days=7)


@pytest.mark.processes
def test_expired_certificates_are_named(tmp_path, monkeypatch, patient):
    """The message says what is wrong with them."""
    with monkeypatch.context() as patch:
        patch.setattr(datetime, "datetime", LastWeek)
        make_certificates(tmp_path / "old", 2)
    port = free_port()
    with (
        scheduler(port, "--protocol=tls", *tls_arguments(tmp_path / "old", "scheduler")),
        pytest.raises(UnreachableError, match="certificate has expired"),
        connect(Cluster(f"tls://127.0.0.1:{port}", tls=client_tls(tmp_path / "old"))),
    ):
        pass


@pytest.mark.processes
def test_no_plain_connection_to_a_tls_scheduler(tls_scheduler, soon):
    """Without TLS the scheduler does not answer."""
    plain = tls_scheduler[0].replace("tls://", "tcp://")
    with pytest.raises(UnreachableError, match="not reached"), connect(Cluster(plain)):
        pass


@pytest.mark.processes
@pytest.mark.slow
def test_a_lost_scheduler_is_reached_anew(tmp_path, monkeypatch):
    """The block ends when the scheduler is lost, a new one fails in time, and works when the scheduler is back."""
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    with scheduler(port) as first, connect(Cluster(address)) as (client, _):
        future = client.submit(sum, [1, 2])
        first.kill()
        first.wait()
        with pytest.raises(Exception, match=r"(?i)lost|cancel|closed"):
            future.result(timeout=600)
    threads = {*threading.enumerate()}
    with monkeypatch.context() as patch:
        patch.setattr(campaign.cluster.connect, "REACHED_WITHIN", 1.0)
        for _ in range(3):
            with pytest.raises(UnreachableError, match="not reached"), connect(Cluster(address)):
                pass
    assert not {*threading.enumerate()} - threads
    with scheduler(port), worker(address, tmp_path), connect(Cluster(address)) as (client, _):
        assert client.submit(sum, [1, 2]).result(timeout=600) == 3


@pytest.mark.processes
def test_local_workers_over_tls(folder, caplog):
    """Workers started here speak TLS when told to."""
    with connect(Cluster(workers=1, tls=client_tls(folder))) as (client, _):
        assert client.scheduler.address.startswith("tls://127.0.0.1:")
        assert all(address.startswith("tls://127.0.0.1:") for address in client.nthreads())
        assert client.submit(sum, [1, 2]).result(timeout=600) == 3
    assert not [r for r in caplog.records if r.levelno >= logging.CRITICAL]


@pytest.mark.slow
@pytest.mark.processes
def test_memory_is_shared_out():
    """Local workers together cannot take all of the machine's memory."""
    with connect(Cluster(workers=2)) as (client, _):
        limits = [w["memory_limit"] for w in client.scheduler_info(n_workers=-1)["workers"].values()]
    assert 0 < sum(limits) < psutil.virtual_memory().total


@pytest.mark.processes
def test_a_scheduler_file_is_waited_for(tls_scheduler, folder, tmp_path, patient, monkeypatch):
    """It is read when it comes; one that never comes, or is something else, ends in a message."""
    late, now = tmp_path / "late.json", [1000.0]

    def sleep(_):
        now[0] += 60.0
        if not late.exists():
            os.link(tls_scheduler[1], late)

    clock = SimpleNamespace(monotonic=lambda: now[0], sleep=sleep)
    monkeypatch.setattr(campaign.cluster.connect, "time", clock)
    with connect(Cluster(str(late), tls=client_tls(folder))) as (client, _):
        assert client.submit(sum, [1, 2]).result(timeout=600) == 3
    with pytest.raises(UnreachableError, match="no such file"), connect(Cluster(str(tmp_path / "none.json"))):
        pass
    wrong = tmp_path / "wrong.json"
    wrong.write_text("[]")
    with pytest.raises(UnreachableError, match="not a file written by dask"), connect(Cluster(str(wrong))):
        pass
    wrong.write_text(json.dumps({"address": "tcp://192.0.2.1:8786"}))
    with pytest.raises(SpecError, match="--insecure"), connect(Cluster(str(wrong))):
        pass


@each(
    ("cluster", "words"),
    [
        (Cluster("tcp://192.0.2.1:8786"), "--insecure"),
        (Cluster("tcp://example.org:8786"), "--insecure"),
        (Cluster("tls://192.0.2.1:8786"), "--tls-ca"),
        (Cluster("tcp://192.0.2.1:8786", tls=Tls("a", "b", "c")), "write tls://"),
        (Cluster("192.0.2.1:8786"), "not an address"),
        (Cluster("tls://192.0.2.1"), "not an address"),
        (Cluster("tls://192.0.2.1:x"), "not an address"),
        (Cluster("tcp://127.0.0.1:8786", kind="slurm"), "--cluster slurm"),
        (Cluster("tcp://127.0.0.1:8786", workers=3), "--workers 3"),
        (Cluster(kind="cloud"), "local, slurm, oar, pbs, kubernetes"),
    ],
)
def test_refused(cluster, words):
    """What contradicts itself or would speak in the clear is refused before anything is started."""
    with pytest.raises(SpecError, match=words):
        check_cluster(cluster)


def test_allowed():
    """Loopback needs no TLS, and who insists gets a cluster without."""
    for address in ("tcp://127.0.0.1:1", "tcp://[::1]:1", "tcp://localhost:1"):
        check_cluster(Cluster(address))
    check_cluster(Cluster("tcp://192.0.2.1:8786", insecure=True))


def test_files_are_checked(folder, tmp_path):
    """A file that is missing, no PEM, of another pair, or a key that others can read."""
    make_certificates(tmp_path / "theirs", 2)
    ours, theirs = client_tls(folder), client_tls(tmp_path / "theirs")
    assert security(ours).tls_client_cert == ours.cert
    wrong = {
        "--tls-ca .*cannot be read": Tls("/nowhere/ca.pem", ours.cert, ours.key),
        "--tls-ca .*not a PEM": Tls(ours.key, ours.cert, ours.key),
        "the key that belongs": Tls(ours.ca, ours.cert, theirs.key),
    }
    for words, tls in wrong.items():
        with pytest.raises(SpecError, match=words):
            security(tls)
    os.chmod(theirs.key, 0o640)
    with pytest.raises(SpecError, match=r"mode 0640.*chmod 600"):
        security(theirs)


def test_a_key_with_a_password_is_refused(folder, tmp_path):
    """The message says so, and nobody is asked for the password."""
    ours = client_tls(folder)
    key = serialization.load_pem_private_key((folder / "client.key").read_bytes(), None)
    kind = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    locked = tmp_path / "locked.key"
    locked.write_bytes(key.private_bytes(*kind, serialization.BestAvailableEncryption(b"secret")))
    locked.chmod(0o600)
    with pytest.raises(SpecError, match="the key has a password"):
        security(Tls(ours.ca, ours.cert, str(locked)))


def test_certificates(tmp_path):
    """Keys are private, the authority's is not kept, all is valid as long as asked, and nothing is replaced."""
    paths = make_certificates(tmp_path / "new", 30, ["scheduler.example", "192.0.2.7"])
    assert {p.name for p in (tmp_path / "new").iterdir()} == set(paths)
    assert (tmp_path / "new").stat().st_mode & 0o777 == 0o700
    authority = x509.load_pem_x509_certificate(paths["ca.pem"].read_bytes())
    keys = [path for name, path in paths.items() if name.endswith(".key")]
    assert len({path.read_bytes() for path in keys}) == 3
    assert all(path.stat().st_mode & 0o777 == 0o600 for path in keys)
    for role in ("scheduler", "worker", "client"):
        certificate = x509.load_pem_x509_certificate(paths[f"{role}.pem"].read_bytes())
        certificate.verify_directly_issued_by(authority)
        assert (certificate.not_valid_after_utc - certificate.not_valid_before_utc).days == 30
    names = x509.load_pem_x509_certificate(paths["scheduler.pem"].read_bytes())
    hosts = names.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert hosts.get_values_for_type(x509.DNSName) == ["scheduler.example"]
    before = {path: path.read_bytes() for path in paths.values()}
    with pytest.raises(SpecError, match="never replaced"):
        make_certificates(tmp_path / "new", 30)
    assert {path: path.read_bytes() for path in paths.values()} == before
    with pytest.raises(SpecError, match="--days 0"):
        make_certificates(tmp_path / "other", 0)
    with pytest.raises(SpecError, match="--host ü"):
        make_certificates(tmp_path / "other", 1, ["ü"])
