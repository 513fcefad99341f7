"""Options that say where to compute, and ``clearcap certificates``."""

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from campaign.cluster.cluster import Cluster, Tls
from campaign.errors import SpecError
from clearcap.cli import app, main
from clearcap.cli.options import cluster_from, on_cluster
from clearcap.cli.output import Json

verb = typer.Typer()


@verb.command()
@on_cluster
def shows(where: Cluster, json: Json = False) -> None:
    """Print the cluster."""
    print(where)


def printed(*words):
    """Return what the verb prints."""
    result = CliRunner().invoke(verb, list(map(str, words)), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output.strip()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Make certificates by the command and stand beside them."""
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["certificates", "tls", "--days", "3", "--host", "10.0.0.1", "--json"])
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert told["days"] == 3
    assert set(told["files"]) == {path.name for path in (tmp_path / "tls").iterdir()}
    return tmp_path / "tls"


def test_options(folder):
    """Options make a cluster; paths hold wherever a coordinator is started."""
    assert printed() == repr(Cluster())
    assert printed("--cluster", "slurm", "--workers", 32) == repr(Cluster(kind="slurm", workers=32))
    both = Cluster(kind="slurm", workers=(2, 64))
    assert printed("--cluster", "slurm", "--workers", "2:64") == repr(both)
    assert both.options() == ["--cluster", "slurm", "--workers", "2:64"]
    assert printed("--scheduler", "tcp://10.0.0.1:1", "--insecure") == repr(Cluster("tcp://10.0.0.1:1", insecure=True))
    files = ["ca.pem", "client.pem", "client.key"]
    words = [w for o, f in zip(("ca", "cert", "key"), files, strict=True) for w in (f"--tls-{o}", f"tls/{f}")]
    tls = Tls(*(str(folder / file) for file in files))
    assert printed("--scheduler", "tls://10.0.0.1:1", *words) == repr(Cluster("tls://10.0.0.1:1", tls=tls))


def test_wrong_options(folder):
    """Half of TLS, files that are not there, traffic in the clear: refused before anything is reached."""
    with pytest.raises(SpecError, match="--tls-cert, --tls-key"):
        cluster_from(tls_ca=folder / "ca.pem")
    with pytest.raises(SpecError, match=r"--tls-key .*nothing\.key"):
        cluster_from(None, "local", None, folder / "ca.pem", folder / "client.pem", Path("nothing.key"))
    with pytest.raises(SpecError, match="--insecure"):
        cluster_from("tcp://10.0.0.1:8786")
    with pytest.raises(SpecError, match="--cluster cloud"):
        cluster_from(cluster="cloud")
    for number in ("0", "5:2", "0:3", "2:", "x", "1:2:3", "²"):
        with pytest.raises(SpecError, match=f"--workers {number}"):
            cluster_from(cluster="slurm", workers=number)
    with pytest.raises(SpecError, match="--workers 2:3: only jobs of a batch system"):
        cluster_from(workers="2:3")


def test_certificates_are_not_replaced(folder, capsys, monkeypatch):
    """The second time is an error of the input."""
    monkeypatch.setattr("sys.argv", ["clearcap", "certificates", "tls"])
    with pytest.raises(SystemExit) as ending:
        main()
    assert ending.value.code == 2
    assert "never replaced" in capsys.readouterr().err
