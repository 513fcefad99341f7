"""The processes of a campaign on a dask cluster of this machine, under a supervisor."""

import psutil

from campaign.cluster.local import SETTINGS
from tests.campaign.cluster_processes import free_port, tls_arguments
from tests.campaign.storms.supervisor import kill, processes, words

# The settings of campaigns' own local clusters, in the environment; deploy/dask.yaml has the same but for the failures.
DASK = {f"DASK_{key.upper().replace('.', '__').replace('-', '_')}": str(value) for key, value in SETTINGS.items()}


def start_cluster(supervisor, folder, workers=2, tls=None):
    """Have a scheduler and its workers started; return the scheduler's address."""
    port = free_port()
    quiet = ("--no-dashboard", "--dashboard-address=127.0.0.1:0")
    protocol = "tls" if tls else "tcp"
    certificates = {role: tls_arguments(tls, role) if tls else [] for role in ("scheduler", "worker")}
    address = f"{protocol}://127.0.0.1:{port}"
    here = ("--host=127.0.0.1", f"--port={port}", f"--protocol={protocol}")
    supervisor.add("scheduler", "distributed.cli.dask_scheduler", *here, *quiet, *certificates["scheduler"])
    for number in range(workers):
        options = ("--nthreads=1", *quiet, f"--local-directory={folder / f'scratch-{number}'}", *certificates["worker"])
        supervisor.add(f"worker-{number}", "distributed.cli.dask_worker", address, *options)
    return address


def drive(supervisor, store, plan, address, seconds, *options, name="coordinator"):
    """Have a coordinator with the stand-in's runs started, until the campaign is complete."""
    arguments = (store.url, plan.campaign_id, "--scheduler", address, "--seconds", seconds, *options)
    supervisor.add(name, "tests.campaign.storms.driver", *arguments, once=True)


def victims(supervisor, kind, chance):
    """Return the process numbers that a kill of this kind hits; none if there is no such process now."""
    if kind == "all":
        return [process.pid for process in processes(supervisor.mark)]
    if kind == "child":
        children = [p.pid for p in processes(supervisor.mark) if "campaign.worker.batch:compute" in words(p)]
        return chance.sample(children, min(1, len(children)))
    if kind in ("worker", "nanny"):
        nanny = supervisor.pid(f"worker-{chance.randrange(2)}")
        pids = [nanny] if kind == "nanny" else _children(nanny)
    else:
        pids = [supervisor.pid(kind)]
    return [pid for pid in pids if pid is not None]


def strike(supervisor, kind, chance):
    """Kill -9; return how many processes were hit."""
    pids = victims(supervisor, kind, chance)
    for pid in pids:
        kill(pid)
    return len(pids)


def _children(nanny):
    """Return the workers of a nanny: its children but the one that tracks resources."""
    try:
        children = [] if nanny is None else psutil.Process(nanny).children()
        return [p.pid for p in children if "spawn_main" in " ".join(words(p))]
    except psutil.Error:
        return []
