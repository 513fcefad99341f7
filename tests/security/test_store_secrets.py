"""The password in a store's URL: a whole campaign on an FTP server, then everything that it left is searched for it."""

import io
import json
import os
import subprocess
import sys
import zipfile
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import psutil
import pytest

from campaign.coordinator import coordinate as coordinating
from campaign.coordinator import submit as submission
from campaign.coordinator.submit import start_coordinator
from campaign.plan import make_plan
from campaign.processes import STORE
from campaign.store import open_store
from tests.campaign import fake_engine
from tests.campaign.commands import ROOT, clearcap_here
from tests.campaign.conftest import SPEC
from tests.until import until

PASSWORD = "S3cretPassw0rd"


@contextmanager
def ftp_server(folder):
    """Yield the URL of a store on an FTP server, with its password."""
    folder.mkdir()
    command = [sys.executable, "-m", "tests.campaign.ftp_server", str(folder), "alice", PASSWORD]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT) as server:
        try:
            yield f"ftp://alice:{PASSWORD}@127.0.0.1:{int(server.stdout.readline())}/runs"
        finally:
            server.kill()


def contents(folder):
    """Yield the name and the content of every file below a folder, and of the files in those that are archives."""
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        yield str(path), path.read_bytes()
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(io.BytesIO(path.read_bytes())) as archive:
                yield from ((f"{path}/{name}", archive.read(name)) for name in archive.namelist())


@pytest.mark.processes
def test_whole_campaign_leaves_no_password(tmp_path, campaign_file, workers, monkeypatch, capsys):
    """Plan, rows, report, status, list, messages: the URL is shown in all of them, the password in none."""
    monkeypatch.chdir(tmp_path)
    for module, verb in ((coordinating, "coordinate"), (submission, "submit")):
        monkeypatch.setattr(module, verb, partial(getattr(module, verb), simulate=fake_engine.simulate))
    here = partial(clearcap_here, capsys, monkeypatch)
    said = []
    with ftp_server(tmp_path / "served") as url:
        plan = make_plan(submission_of(campaign_file))
        for words in (
            ("run", campaign_file, "--store", url, "--batch-size", 5, "--json"),
            ("run", campaign_file, "--store", url),
            ("status", "--store", url, "--json"),
            ("list", "--store", url),
            ("compact", "--store", url, "--json"),
            ("report", "--store", url),
            ("cancel", plan.campaign_id, "--store", url),
            ("whatif", plan.campaign_id, "--set", "preload.upper=2", "--store", url),
            ("status", "nothing", "--store", url),
            ("run", campaign_file, "--store", url.replace("ftp", "nosuch")),
            ("run", campaign_file, "--store", url.replace("alice", "mallory")),
        ):
            code, out, err = here(*words)
            said.append((words[0], code, out + err))
    assert [code for _, code, _ in said[:7]] == [0] * 7, said
    shown = url.replace(PASSWORD, "***")
    served = list(contents(tmp_path / "served"))
    assert len(served) > 8
    for name, content in served:
        assert PASSWORD.encode() not in content, name
    for verb, _, text in said:
        assert PASSWORD not in text, verb
    assert sum(shown.encode() in content for _, content in served) >= 2  # report.html and capability.json name it
    assert all(text.count("any user of this machine can read the password") == 1 for _, _, text in said)
    assert "report: " + shown in said[1][2]


def submission_of(path):
    """Return the campaign of a file."""
    from campaign.spec.load import load_campaign

    return load_campaign(str(path))


def test_without_the_command_line_there_is_no_warning(tmp_path, monkeypatch, capsys):
    """The URL in the environment is not in the list of processes."""
    monkeypatch.setenv(STORE, f"memory://alice:{PASSWORD}@host/runs")
    code, out, err = clearcap_here(capsys, monkeypatch, "list")
    assert (code, "warning" in err, PASSWORD in out + err) == (0, False, False)


def test_detached_coordinator_is_not_told_on_its_command_line(tmp_path, campaign, monkeypatch):
    """Its environment, which only its owner reads, has the URL."""
    started = []

    def popen(words, **how):
        started.append((words, how["env"]))
        return subprocess.CompletedProcess(words, 0)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(subprocess, "Popen", popen)
    monkeypatch.setattr(subprocess.CompletedProcess, "pid", 1, raising=False)
    url = f"memory://alice:{PASSWORD}@host/detached"
    start_coordinator(open_store(url), make_plan(campaign), [])
    ((words, environment),) = started
    assert PASSWORD not in " ".join(words)
    assert environment[STORE] == url


@pytest.mark.processes
@pytest.mark.slow
def test_no_process_shows_the_password(tmp_path):
    """``submit`` with the URL in the environment: no command line of coordinator or workers has the password."""
    (tmp_path / "demo.toml").write_text(SPEC.replace("samples = 25", "samples = 4"))
    with ftp_server(tmp_path / "served") as url:
        environment = {**os.environ, STORE: url, "PYTHONPATH": str(ROOT)}
        run = partial(subprocess.run, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600)
        command = [sys.executable, "-m", "clearcap"]
        submitted = run([*command, "submit", "demo.toml", "--workers", "1", "--json"])
        assert submitted.returncode == 0, submitted.stderr
        pid = json.loads(submitted.stdout)["pid"]
        lines = set()
        until(
            lambda: lines.update(map(" ".join, command_lines(pid))) or ended(pid), "the end of the campaign", pause=0.2
        )
        status = run([*command, "status", "--json"])
    assert json.loads(status.stdout)["state"] == "completed"
    assert any("coordinate" in line for line in lines)
    logs = "".join(path.read_text() for path in tmp_path.glob("*.log"))
    for text in (*lines, submitted.stdout, submitted.stderr, status.stdout, status.stderr, logs):
        assert PASSWORD not in text
    for name, content in contents(tmp_path / "served"):
        assert PASSWORD.encode() not in content, name


def ended(pid):
    """Return whether a process is gone, or waits only for its parent."""
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def command_lines(pid):
    """Yield the command lines of a process and all below it."""
    try:
        family = [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]
    except psutil.NoSuchProcess:
        return
    for process in family:
        try:
            yield process.cmdline()
        except psutil.Error:
            continue


def test_contents_are_searched(tmp_path):
    """The search above finds a password, also in an archive."""
    with zipfile.ZipFile(tmp_path / "a.xlsx", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("sheet", PASSWORD * 100)
    assert any(PASSWORD.encode() in content for _, content in contents(Path(tmp_path)))
