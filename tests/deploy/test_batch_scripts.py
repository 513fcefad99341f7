"""The scripts of batch systems are accepted by the tools that read them, and keep what is promised of them."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import distributed
import pytest

from campaign.cluster.tls_certificates import make_certificates
from tests.campaign.cluster_processes import free_port, scheduler
from tests.deploy.descriptors import DEPLOY, check_dask, documents, needs, output
from tests.each import each

SCRIPTS = [*sorted((DEPLOY / "batch").iterdir()), *sorted(DEPLOY.glob("*.sh")), *sorted(DEPLOY.glob("kubernetes/*.sh"))]
OAR_OPTIONS = {
    "-n": str,
    "-l": str,
    "-t": str,
    "-O": str,
    "-E": str,
    "--checkpoint": int,
    "--signal": int,
    "--array": int,
}
PBS_OPTIONS = {"-N": str, "-l": str, "-j": str}


@pytest.mark.processes
@needs("shellcheck", "shellcheck")
@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_scripts(path):
    """Shellcheck finds nothing, and the file can be run."""
    assert not output("shellcheck", path)
    assert path.stat().st_mode & 0o111


@pytest.mark.parametrize(
    ("name", "mark", "options"),
    [
        ("campaign.oar", "#OAR", OAR_OPTIONS),
        ("workers.oar", "#OAR", OAR_OPTIONS),
        ("campaign.pbs", "#PBS", PBS_OPTIONS),
    ],
)
def test_directives(name, mark, options):
    """Directives stand at line's start before the first command, and have options oarsub or qsub knows."""
    lines = (DEPLOY / "batch" / name).read_text().splitlines()
    first_command = next(number for number, line in enumerate(lines) if line and not line.startswith("#"))
    found = [number for number, line in enumerate(lines) if mark in line and line.startswith(mark)]
    assert len(found) >= 4
    assert max(found) < first_command
    for number in found:
        option, value = lines[number].removeprefix(mark).split(maxsplit=1)
        options[option](value)
        if option == "-l" and "walltime" in value:
            assert re.search(r"walltime=\d\d:\d\d:\d\d$", value)


@pytest.mark.parametrize("name", ["workers.slurm", "workers.oar"])
def test_worker_commands(name):
    """The workers' commands are right for dask."""
    text = (DEPLOY / "batch" / name).read_text()
    command = re.search(r"^exec .*/on_node.sh\" \\\n +(dask worker (?:.*\\\n)*.*)", text, re.M)[1].replace("\\\n", " ")
    command = re.sub(r"\$\{SLURM_CPUS\w+:-1\}", "16", command)
    files = ("--tls-ca-file=", "--tls-cert=", "--tls-key=")
    words = [word for word in shlex.split(command) if not word.startswith(files)]
    check_dask(words)


def node_folder(commands, temporary):
    """Run what prepares a worker's folder on its node; return the folder of compiled code, and the other."""
    show = 'echo "$NUMBA_CACHE_DIR"'
    if commands == "on_node.sh":
        words = [DEPLOY / "batch/on_node.sh", "sh", "-c", f'{show}; echo "$2"', "worker"]
    else:
        [settings] = documents(DEPLOY / "jobqueue.yaml")
        prologue = "\n".join(settings["jobqueue"][commands]["job-script-prologue"])
        words = ["bash", "-euc", f"{prologue}\n{show}; echo {settings['jobqueue'][commands]['local-directory']}"]
    printed = output(*words, env={"PATH": "/usr/bin:/bin", "TMPDIR": str(temporary)})
    return [Path(line) for line in printed.splitlines()]


@pytest.mark.processes
@pytest.mark.parametrize("commands", ["on_node.sh", "slurm", "oar", "pbs"])
def test_node_folder(tmp_path, commands):
    """Workers' folder on a node is their user's alone, has no name that can be foreseen, and is found again."""
    open_to_all, link = tmp_path / "clearcap.open", tmp_path / "clearcap.link"
    open_to_all.mkdir()
    open_to_all.chmod(0o777)
    link.symlink_to(tmp_path)
    if os.getuid() == 0:
        theirs = tmp_path / "clearcap.theirs"
        theirs.mkdir(mode=0o700)
        os.chown(theirs, 20002, 20002)
    compiled, folder = node_folder(commands, tmp_path)
    assert compiled.parent == folder
    assert folder.parent == tmp_path
    assert re.fullmatch(r"clearcap\.\w{6}", folder.name)
    assert (folder.stat().st_uid, folder.stat().st_mode & 0o7777) == (os.getuid(), 0o700)
    assert node_folder(commands, tmp_path) == [compiled, folder]
    shutil.rmtree(folder)
    assert node_folder(commands, tmp_path)[1].name != folder.name


@pytest.mark.processes
@pytest.mark.slow
def test_workers_that_lost_their_scheduler_come_back(tmp_path):
    """As after a cut of the network: another worker takes the place of one that ended, and ends with the scheduler."""
    file, port = tmp_path / "scheduler.json", free_port()
    words = ["dask", "worker", "--scheduler-file", file, "--nworkers", "1", "--nthreads", "1", "--no-dashboard"]
    closed = ["--dashboard-address", "127.0.0.1:0", "--death-timeout", "600"]
    path = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "TMPDIR": str(tmp_path)}
    command = [DEPLOY / "batch/on_node.sh", *map(str, words), *closed]
    with (tmp_path / "log").open("w") as log:
        node = subprocess.Popen(command, env=path, stdout=log, stderr=log)
        try:
            pids = set()
            for _ in range(2):
                with scheduler(port, "--scheduler-file", str(file)) as process:
                    client = distributed.Client(f"tcp://127.0.0.1:{port}", set_as_default=False)
                    client.wait_for_workers(1, timeout=600)
                    pids |= set(client.run(os.getpid).values())
                    process.kill()  # its file stays
                    client.close()
            assert len(pids) == 2
            file.unlink()
            node.terminate()
            assert node.wait(600) == 143
            assert (tmp_path / "log").read_text().count("starting them again") >= 1
        finally:
            node.kill()


@pytest.mark.processes
def test_workers_end_with_their_scheduler_and_at_their_time(tmp_path):
    """A scheduler that ended properly has removed its file, in a folder that may be gone; a lifetime may be over."""
    binaries, folder = tmp_path / "bin", tmp_path / "job"
    binaries.mkdir()
    folder.mkdir()
    (binaries / "dask").write_text(f'#!/bin/sh\necho "$*" >> {tmp_path}/calls\nrm -r {folder}\n')
    (binaries / "dask").chmod(0o755)
    file = folder / "scheduler.json"
    file.touch()
    path = {"PATH": f"{binaries}:/usr/bin:/bin", "TMPDIR": str(tmp_path)}
    command = [DEPLOY / "batch/on_node.sh", "dask", "worker", "--scheduler-file", str(file)]
    output(*command, env=path | {"CLEARCAP_LIFETIME": "1000"})
    [call] = (tmp_path / "calls").read_text().splitlines()
    left, stagger = map(int, re.search(r"--lifetime (\d+)s --lifetime-stagger (\d+)s$", call).groups())
    assert 0 < left <= 1000  # less what has passed until then
    assert stagger == left // 50
    output(*command, env=path | {"CLEARCAP_LIFETIME": "0"})
    assert len((tmp_path / "calls").read_text().splitlines()) == 1


@each("path", sorted(path for path in DEPLOY.rglob("*.*") if path.suffix != ".pyc"))
def test_no_name_can_be_foreseen(path):
    """No descriptor names a file in a folder that users of a machine share, unless mktemp makes the name."""
    for line in path.read_text().splitlines():
        for name in re.findall(r"(?:TMPDIR|/tmp|local)\}?\"?/([^\s\"']+)", line):
            assert name.endswith(".XXXXXX"), line


def allocation(tmp_path, system, **environment):
    """Run allocation.sh with recorders in place of all commands; return what each was called with."""
    binaries = tmp_path / "bin"
    binaries.mkdir()
    for name in ("dask", "clearcap", "srun", "oarsh", "pbs_tmrsh", "ssh"):
        recorder = binaries / name
        record = f"printf '%s\\n' \"{name} $*\" >> '{tmp_path}/calls'"
        lasts = {"clearcap": "sleep 1\n", "dask": "exec sleep 600\n"}  # a scheduler outlives its campaign
        recorder.write_text(f"#!/bin/sh\n{record}\n{lasts.get(name, '')}")
        recorder.chmod(0o755)
    nodes = tmp_path / "nodes"
    nodes.write_text("b\na\nb\na\n")
    files = {
        "OAR_NODEFILE": str(nodes),
        "PBS_NODEFILE": str(nodes),
        "CLEARCAP_HOSTS": "a b",
        "HOME": str(tmp_path),
        "USER": "me",
    }
    given = {"PATH": f"{binaries}:/usr/bin:/bin", "CAMPAIGN": "c60", "STORE": "/runs", **files, **environment}
    output("bash", DEPLOY / "batch/allocation.sh", system, env=given)
    assert not list(tmp_path.glob(".clearcap-job*"))
    return sorted((tmp_path / "calls").read_text().splitlines())


@pytest.mark.processes
@pytest.mark.parametrize(
    ("system", "launchers"),
    [("slurm", ["srun"]), ("oar", ["oarsh"] * 2), ("pbs", ["pbs_tmrsh"] * 2), ("ssh", ["ssh"] * 2)],
)
def test_allocation(tmp_path, system, launchers):
    """One scheduler, one campaign, and workers launched once on each node, all with certificates."""
    calls = allocation(tmp_path, system)
    assert sorted(call.split()[0] for call in calls) == sorted(["clearcap", "dask", *launchers])
    for call in calls:
        if call.startswith("clearcap"):
            assert call.startswith("clearcap run c60 --store /runs --scheduler ")
            assert f"--tls-key {tmp_path}/.clearcap/tls/client.key" in call
            continue
        role = "scheduler" if call.startswith("dask") else "worker"
        assert f"--tls-key={tmp_path}/.clearcap/tls/{role}.key" in call
        assert (f" {DEPLOY}/batch/on_node.sh dask worker " in call) == (role == "worker")
        assert "--protocol tls " in call
        assert "--no-dashboard --dashboard-address 127.0.0.1:0 --preload campaign.cluster.disable_dashboard" in call
    if system != "slurm":
        started = [call.removeprefix("ssh -o BatchMode=yes ").split() for call in calls if call.split()[0] in launchers]
        assert [words[1 - (system == "ssh")] for words in started] == ["a", "b"]


SEES_IT = """\
#!/bin/sh
# clearcap run CAMPAIGN --store STORE --scheduler FILE ...
until [ -s "$6" ]; do sleep 0.1; done
cp "$6" '{seen}'
"""


def scheduled(tmp_path, **environment):
    """Run allocation.sh with the real ``dask``; return how it ends, and the address that the campaign was given."""
    binaries, seen = tmp_path / "bin", tmp_path / "seen.json"
    binaries.mkdir()
    (binaries / "clearcap").write_text(SEES_IT.format(seen=seen))
    (binaries / "srun").write_text("#!/bin/sh\nexec sleep 5\n")
    for command in binaries.iterdir():
        command.chmod(0o755)
    path = f"{binaries}:{Path(sys.executable).parent}:/usr/bin:/bin"
    given = {"PATH": path, "HOME": str(tmp_path), "USER": "me", "CAMPAIGN": "c60", "STORE": "/runs"}
    command = ["bash", DEPLOY / "batch/allocation.sh", "slurm"]
    done = subprocess.run(command, env=given | environment, capture_output=True, text=True)
    return done, json.loads(seen.read_text())["address"] if seen.exists() else None


@pytest.mark.processes
def test_the_scheduler_listens_where_it_is_told(tmp_path):
    """On the address of the interface, by TLS, as the installed dask understands it."""
    make_certificates(tmp_path / ".clearcap/tls", 2)
    done, address = scheduled(tmp_path, CLEARCAP_INTERFACE="lo")
    assert done.returncode == 0, done.stderr
    assert address.startswith("tls://127.0.0.1:")


@pytest.mark.processes
def test_an_interface_that_is_not_there(tmp_path):
    """Nothing is started; the message names those that are."""
    done, address = scheduled(tmp_path, CLEARCAP_INTERFACE="none0")
    assert (done.returncode, address) == (1, None)
    assert "CLEARCAP_INTERFACE" in done.stderr
    assert "'lo'" in done.stderr


@pytest.mark.processes
def test_a_scheduler_that_cannot_start_ends_the_job(tmp_path):
    """At once, with its own message: without certificates the campaign would wait for it in vain."""
    done, address = scheduled(tmp_path)
    assert (done.returncode, address) == (1, None)
    assert "dask scheduler has ended" in done.stderr


@pytest.mark.parametrize("system", ["slurm", "oar", "pbs", "ssh"])
def test_nodes_compute_as_the_job_does(tmp_path, system):
    """Workers of other nodes get what chooses the kernels of the linear algebra, and no number of threads."""
    calls = allocation(tmp_path, system, OPENBLAS_CORETYPE="Haswell", OMP_NUM_THREADS="16", NUMBA_CPU_FEATURES="+avx2")
    for call in calls:
        if "on_node.sh" in call:
            assert "OPENBLAS_CORETYPE=Haswell" in call
            assert "NUMBA_CPU_FEATURES=+avx2" in call
            assert "OMP_NUM_THREADS" not in call
