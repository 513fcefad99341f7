"""A SLURM of one node, the real one, on a network of its own."""

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
CredType=cred/none
SlurmUser=root
SlurmdUser=root
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
SwitchType=switch/none
ReturnToService=2
KillWait=5
SlurmdParameters=config_overrides
NodeName=localhost NodeAddr={address} CPUs=32 RealMemory=64000 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""
UNFINISHED = ("PENDING", "CONFIGURING", "RUNNING", "COMPLETING")


def is_here():
    """Tell whether SLURM and what its network needs are here."""
    commands = ("slurmctld", "slurmd", "sbatch", "srun", "ip", "nsenter")
    return os.getuid() == 0 and all(map(shutil.which, commands))


@contextmanager
def slurm(folder):
    """Start SLURM's two daemons and yield what runs a command where they are; end them and their jobs."""
    for name in ("state", "spool"):
        (folder / name).mkdir()
    with network(["slurm"]) as hosts:
        host, address = hosts["slurm"]
        (folder / "slurm.conf").write_text(CONFIGURATION.format(address=address, folder=folder))
        (folder / "cgroup.conf").write_text("CgroupPlugin=cgroup/v1\n")  # loaded, not used
        environment = {**os.environ, "SLURM_CONF": str(folder / "slurm.conf")}

        def run(*words, **more):
            done = subprocess.run(
                [*inside(host), *map(str, words)],
                env=environment | more,
                capture_output=True,
                text=True,
            )
            assert done.returncode == 0, done.stderr
            return done.stdout + done.stderr

        daemons = []
        try:
            for words in (["slurmctld", "-D"], ["slurmd", "-D", "-N", "localhost"]):
                with (folder / f"{words[0]}.log").open("w") as log:
                    daemons.append(subprocess.Popen([*inside(host), *words], env=environment, stdout=log, stderr=log))
            _wait_until_idle(run)
            yield run
            run("scancel", "--user=root")
            _wait_until_idle(run)
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


def _wait_until_idle(run):
    """Wait for the node to be there and to have no job."""

    def is_idle():
        try:
            return "idle" in run("sinfo", "--noheader", "--format=%t").split()
        except AssertionError:  # the controller is starting
            return False

    until(is_idle, "SLURM has no idle node", pause=0.3)
