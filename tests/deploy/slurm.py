"""A SLURM of one node or two, the real one, on a network of its own."""

import os
import re
import shutil
import subprocess
from contextlib import contextmanager, suppress

from tests.deploy.hosts import inside, network
from tests.until import until

CONFIGURATION = """\
ClusterName=test
SlurmctldHost=localhost({address})
AuthType=auth/none
AuthInfo=cred_expire=5
CredType=cred/none
SlurmUser=root
SlurmdUser=root
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core,CR_LLN
MpiDefault=none
SwitchType=switch/none
ReturnToService=2
KillWait=5
MinJobAge=3600
SlurmdParameters=config_overrides
{nodes}
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""
NODE = "NodeName={name} NodeAddr={address} CPUs=32 RealMemory=64000 State=UNKNOWN"
UNFINISHED = ("PENDING", "CONFIGURING", "RUNNING", "SIGNALING", "COMPLETING")


def is_here():
    """Tell whether SLURM and what its network needs are here."""
    commands = ("slurmctld", "slurmd", "sbatch", "srun", "ip", "nsenter")
    return os.getuid() == 0 and all(map(shutil.which, commands))


@contextmanager
def slurm(folder, nodes=("n1",)):
    """Start SLURM's daemons, each node on a host of its own, and yield what runs a command on the first of them.

    At the end they and their jobs are ended.
    """
    for name in ("state", *(f"spool-{node}" for node in nodes)):
        (folder / name).mkdir()
    with network(nodes) as hosts:
        host, address = hosts[nodes[0]]
        lines = "\n".join(NODE.format(name=node, address=hosts[node][1]) for node in nodes)
        (folder / "slurm.conf").write_text(CONFIGURATION.format(address=address, folder=folder, nodes=lines))
        (folder / "cgroup.conf").write_text("CgroupPlugin=cgroup/v1\n")  # loaded, not used
        environment = {**os.environ, "SLURM_CONF": str(folder / "slurm.conf")}

        def run(*words, **more):
            done = subprocess.run(
                [*inside(host), *map(str, words)], env=environment | more, capture_output=True, text=True
            )
            assert done.returncode == 0, done.stderr
            return done.stdout + done.stderr

        daemons = []
        try:
            places = [(host, ["slurmctld", "-D"])]
            places += [(hosts[node][0], ["slurmd", "-D", "-N", node]) for node in nodes]
            for place, words in places:
                with (folder / f"{words[0]}-{words[-1]}.log").open("w") as log:
                    daemons.append(subprocess.Popen([*inside(place), *words], env=environment, stdout=log, stderr=log))
            _wait_until_idle(run, len(nodes))
            run.host = host
            yield run
            run("scancel", "--user=root")
            _wait_until_idle(run, len(nodes))
        finally:
            for daemon in reversed(daemons):
                daemon.terminate()
                with suppress(subprocess.TimeoutExpired):
                    daemon.wait(20)
                daemon.kill()
                daemon.wait()


def wait_for_end(run, job):
    """Wait until a job has ended and return its last state; ``sbatch --wait`` looks only every 32 s."""

    def last_state():
        state = re.search(r"JobState=(\w+)", run("scontrol", "show", "job", job))[1]
        return None if state in UNFINISHED else state

    return until(last_state, f"job {job} does not end", pause=0.3)


def _wait_until_idle(run, nodes):
    """Wait for all nodes to be there and to have no job."""

    def are_idle():
        try:
            return run("sinfo", "--noheader", "--Node", "--format=%t").split() == ["idle"] * nodes
        except AssertionError:  # the controller is starting
            return False

    until(are_idle, "SLURM's nodes are not idle", pause=0.3)
