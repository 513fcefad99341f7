"""Workers on other machines over SSH: a real server on each of two hosts, and a key."""

import os
import pwd
import shutil
import stat
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from campaign.cluster.tls_certificates import make_certificates
from tests.deploy.campaigns import compiled_on_nodes, computed_here, planned, rows
from tests.deploy.hosts import inside, network
from tests.until import until

ROOT = Path(__file__).parents[2]
SSHD = shutil.which("sshd", path="/usr/sbin:/usr/local/sbin")
HAS_ALL = os.getuid() == 0 and SSHD and all(map(shutil.which, ("ssh", "ssh-keygen", "ip", "nsenter")))

pytestmark = [
    pytest.mark.processes,
    pytest.mark.slow,
    pytest.mark.skipif(not HAS_ALL, reason="needs root and SSH: apt-get install openssh-server iproute2"),
]
SERVER = """\
HostKey {folder}/host
AuthorizedKeysFile {folder}/user.pub
PermitRootLogin prohibit-password
StrictModes no
UsePAM no
PidFile none
AcceptEnv *
"""
CLIENT = """\
IdentityFile {folder}/user
UserKnownHostsFile {folder}/known
StrictHostKeyChecking accept-new
SendEnv PYTHONPATH TMPDIR
"""  # where the stand-in of the engine is, and a folder that goes with the test


@pytest.fixture
def hosts(tmp_path):
    """Start an SSH server on each of two hosts; yield the hosts."""
    Path("/run/sshd").mkdir(exist_ok=True)  # it refuses to start without
    for name, text in (("host", None), ("user", None), ("server", SERVER), ("client", CLIENT)):
        if text is None:
            subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", tmp_path / name], check=True)
        else:
            (tmp_path / name).write_text(text.format(folder=tmp_path))
    with ExitStack() as stack:
        hosts = stack.enter_context(network(["here", "one", "two"]))
        for name in ("one", "two"):
            command = [*inside(hosts[name][0]), SSHD, "-D", "-e", "-f", str(tmp_path / "server")]
            with (tmp_path / f"log-{name}").open("w") as log:
                server = stack.enter_context(subprocess.Popen(command, stderr=log))
            stack.callback(server.terminate)
        yield hosts


def test_a_campaign_over_ssh(hosts, tmp_path):
    """The same rows as here, by workers on both; nothing of it stays on any of the machines."""
    store, plan = planned(tmp_path, "shared")
    home, binaries = tmp_path / "home", tmp_path / "bin"
    make_certificates(home / ".clearcap/tls", 2)
    compiled_on_nodes(tmp_path)
    binaries.mkdir()
    for name, text in (
        ("clearcap", f'exec {sys.executable} -m tests.deploy.on_host run_as_told {plan.campaign_id} "$@"'),
        ("ssh", f'exec {shutil.which("ssh")} -F {tmp_path}/client "$@"'),
    ):
        (binaries / name).write_text(f"#!/bin/sh\n{text}\n")
        (binaries / name).chmod(stat.S_IRWXU)
    addresses = [hosts[name][1] for name in ("one", "two")]
    settings = {
        "CAMPAIGN": "demo",
        "STORE": store.url,
        "CLEARCAP_HOSTS": " ".join(addresses),
        "CLEARCAP_INTERFACE": "eth0",
        "HOME": str(home),
        "TMPDIR": str(tmp_path),
        "USER": pwd.getpwuid(os.getuid()).pw_name,
        "PYTHONPATH": str(ROOT),
        "SECONDS_A_RUN": "0.3",
        "PATH": f"{binaries}:{Path(sys.executable).parent}:{os.environ['PATH']}",
    }
    command = [*inside(hosts["here"][0]), "bash", str(ROOT / "deploy/batch/allocation.sh"), "ssh"]
    done = subprocess.run(command, env=os.environ | settings, cwd=tmp_path, capture_output=True, text=True)
    said = done.stdout + done.stderr + "".join((tmp_path / f"log-{name}").read_text() for name in ("one", "two"))
    assert done.returncode == 0, said
    assert rows(store, plan).equals(computed_here(tmp_path)), said
    for address in addresses:
        assert f"tls://{address}:" in said
    until(lambda: not any("dask" in processes_on(host) for host, _ in hosts.values()), "something stays")


def processes_on(host):
    """Return the command lines of all processes of a host."""
    pids = subprocess.run(["ip", "netns", "pids", host], capture_output=True, text=True, check=True).stdout.split()
    return "\n".join(line for pid in pids if (line := command_line(pid)))


def command_line(pid):
    """Return the command line of a process; nothing if it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")
    except (FileNotFoundError, ProcessLookupError):
        return ""
