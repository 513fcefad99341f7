"""Jobs that end are replaced; what a batch system says of its queue; when it is given up."""

import asyncio
import json
import logging
import threading
import time
from itertools import pairwise
from types import SimpleNamespace

import pytest
from distributed import Status

from campaign.cluster.cluster import Cluster
from campaign.cluster.job_replacement import (
    _QUEUES,
    MOST_IN_VAIN,
    PENDING_AFTER,
    VISIBLE_WITHIN,
    JobReplacement,
    QueuedJob,
    jobs_replaced,
    number,
)
from campaign.errors import UnreachableError

RUNNING = QueuedJob("RUNNING")


class Jobs:
    """A cluster of dask-jobqueue, and the queue of its batch system; ``processes`` workers a job."""

    def __init__(self, count, processes=1):
        group = {"group": [f"-{i}" for i in range(processes)]} if processes > 1 else {}
        self.new_spec = group
        self.worker_spec = {f"SLURMCluster-{i}": dict(group) for i in range(count)}
        self.scheduler = SimpleNamespace(workers={}, retire_workers=self.retire_workers, add_plugin=lambda _: None)
        self.retired = []
        self.workers, self.queue = {}, {}
        self.submitted, self.processes, self.refuses = 0, processes, None
        asyncio.run(self._correct_state())

    def sync(self, function, *arguments):
        """Call what dask would call in its event loop."""
        return asyncio.run(function(*arguments))

    def new_worker_spec(self):
        """Return one more."""
        return {f"SLURMCluster-{len(self.worker_spec)}": dict(self.new_spec)}

    async def retire_workers(self, names, close_workers):
        """Keep the names of the workers that are to end."""
        self.retired += names

    async def _correct_state(self):
        """Cancel what is too much, and submit what is missing."""
        for name in self.workers.keys() - self.worker_spec.keys():
            self.queue.pop(self.workers.pop(name).job_id, None)
        for name in [name for name in self.worker_spec if name not in self.workers]:
            self.workers[name] = job = SimpleNamespace(job_id=None, status=Status.running)
            if self.refuses:
                raise RuntimeError(self.refuses)
            self.submitted += 1
            job.job_id = str(self.submitted)
            self.queue[job.job_id] = RUNNING

    def join(self, kept, name):
        """Let the workers of a job join."""
        for i in range(self.processes):
            kept.worker_joined(name if self.processes == 1 else f"{name}-{i}")


class Clock:
    """Seconds that a test moves."""

    now = 1000.0

    def __call__(self):
        """Return the time."""
        return self.now


@pytest.fixture
def clock():
    """Return a clock."""
    return Clock()


def replacement(jobs, clock, queue=None, limits=None):
    """Return what replaces jobs of this queue."""
    workers = limits or len(jobs.worker_spec) * jobs.processes
    return JobReplacement(jobs, Cluster(kind="slurm", workers=workers), queue or (lambda _: dict(jobs.queue)), clock)


@pytest.mark.parametrize("processes", [1, 4])
def test_jobs_whose_workers_had_joined_are_replaced_at_once(clock, processes):
    """A walltime, a lifetime, scancel, a lost node: as often as it happens."""
    jobs = Jobs(3, processes)
    kept = replacement(jobs, clock)
    for round_ in range(20):
        for name in jobs.workers:
            jobs.join(kept, name)
        clock.now += VISIBLE_WITHIN + 1
        kept.check()
        assert jobs.submitted == 3 * (round_ + 1)
        ended = list(jobs.workers.values())
        jobs.queue.clear()
        kept.check()
        assert len(jobs.queue) == 3
        assert {job.status for job in ended} == {Status.closed}
    assert kept.failure is None


def test_jobs_too_short_for_a_batch_are_named(clock, caplog):
    """Once, and they go on: a batch may be long, and jobs preempted. A batch that is finished ends the count."""
    jobs = Jobs(1)
    kept = replacement(jobs, clock)
    for calls, said in ((9, 0), (8, 0), (7, 1)):
        for _ in range(MOST_IN_VAIN + 2 if said else MOST_IN_VAIN - 1):
            kept.expect(calls)
            jobs.join(kept, "SLURMCluster-0")
            clock.now += VISIBLE_WITHIN + 1
            kept.check()
            jobs.queue.clear()
            kept.check()
        assert (caplog.text.count("no batch was finished"), kept.failure) == (said, None)


def test_a_job_that_dask_has_forgotten_is_submitted_again(clock):
    """Dask forgets a job some seconds after its worker is gone."""
    jobs = Jobs(2)
    kept = replacement(jobs, clock)
    jobs.join(kept, "SLURMCluster-0")
    kept.check()
    del jobs.workers["SLURMCluster-0"], jobs.queue["1"]
    kept.check()
    assert (jobs.submitted, kept.failure) == (3, None)


def test_a_new_job_need_not_be_in_the_queue_at_once(clock):
    """Batch systems answer from a cache."""
    jobs = Jobs(1)
    kept = replacement(jobs, clock, lambda _: {})
    kept.check()
    clock.now += VISIBLE_WITHIN - 1
    kept.check()
    assert jobs.submitted == 1
    clock.now += 2
    kept.check()
    assert jobs.submitted == 1  # it ended in vain: after a pause
    clock.now += 1000
    kept.check()
    assert jobs.submitted == 2


def test_a_batch_system_that_does_not_answer_proves_nothing(clock):
    """Not one job more is submitted, however long."""
    jobs = Jobs(2)
    kept = replacement(jobs, clock, lambda _: None)
    for _ in range(10):
        clock.now += 1000
        kept.check()
    assert jobs.submitted == 2


def test_jobs_that_end_in_vain_are_given_up(clock, caplog):
    """Later and later, and after five in a row the campaign ends with the reason; rows are kept."""
    jobs = Jobs(1)
    kept = replacement(jobs, clock)
    times = []
    for _ in range(10_000):
        jobs.queue.clear()
        before = jobs.submitted
        kept.check()
        times += [clock.now] * (jobs.submitted - before)
        clock.now += 10
        if kept.failure:
            break
    assert jobs.submitted == MOST_IN_VAIN
    pauses = [b - a for a, b in pairwise(times)]
    assert pauses == sorted(pauses)
    assert f"{MOST_IN_VAIN} times in a row" in str(kept.failure)
    assert caplog.text.count("ended before a worker had joined") == MOST_IN_VAIN


def test_many_jobs_that_are_cancelled_at_once_are_submitted_again(clock):
    """As by an admin, before they began: that happened once, not as often as there were jobs."""
    jobs = Jobs(2 * MOST_IN_VAIN)
    kept = replacement(jobs, clock)
    kept.check()
    jobs.queue.clear()
    kept.check()
    clock.now += 1000
    kept.check()
    assert (len(jobs.queue), kept.failure) == (2 * MOST_IN_VAIN, None)


def test_the_cluster_is_closed_when_jobs_are_given_up(monkeypatch):
    """So that nobody waits for workers; the block ends with the reason, whatever it raises itself."""
    jobs, failure, closed, plugins, joined = Jobs(1), UnreachableError("no more"), threading.Event(), [], []
    jobs.scheduler, jobs.close = SimpleNamespace(add_plugin=plugins.append), closed.set
    monkeypatch.setattr(JobReplacement, "check", lambda self: setattr(self, "failure", failure))
    monkeypatch.setattr(JobReplacement, "worker_joined", lambda _, name: joined.append(name))

    def compute():
        with jobs_replaced(jobs, Cluster(kind="slurm", workers=1), interval=0.001):
            plugins[0].add_worker(SimpleNamespace(workers={"tls://x": SimpleNamespace(name="a-0")}), "tls://x")
            assert closed.wait(600)
            raise OSError("the connection is lost")

    with pytest.raises(UnreachableError, match="no more"):
        compute()
    assert joined == ["a-0"]


def test_one_that_works_ends_the_count(clock):
    """Four in vain, one with a worker, four in vain: nobody gives up."""
    jobs = Jobs(1)
    kept = replacement(jobs, clock)
    for _ in range(3):
        for in_vain in [True] * (MOST_IN_VAIN - 1) + [False]:
            if not in_vain:
                jobs.join(kept, "SLURMCluster-0")
            clock.now += 1000
            kept.check()
            jobs.queue.clear()
            kept.check()
            clock.now += 1000
            kept.check()
    assert kept.failure is None


def test_a_refused_job_ends_it(clock):
    """As at the first submission: the words of the batch system."""
    jobs = Jobs(1)
    kept = replacement(jobs, clock)
    jobs.join(kept, "SLURMCluster-0")
    clock.now += 100
    kept.check()
    jobs.queue.clear()
    jobs.refuses = "QOSMaxSubmitJobPerUserLimit"
    kept.check()
    assert "QOSMaxSubmitJobPerUserLimit" in str(kept.failure)
    assert {job.status for job in jobs.workers.values()} == {Status.failed}


def test_why_a_job_waits_is_said_once(clock, caplog):
    """And again when the reason changes; not of one that has only just been submitted."""
    caplog.set_level(logging.WARNING)
    jobs = Jobs(1)
    kept = replacement(jobs, clock)
    for reason in ("Priority", "Priority", "Resources"):
        jobs.queue["1"] = QueuedJob("PENDING", reason)
        kept.check()
        clock.now += PENDING_AFTER + 1
        kept.check()
    assert [record.getMessage() for record in caplog.records] == [
        "1 job waiting in the queue: job 1: Priority",
        "1 job waiting in the queue: job 1: Resources",
    ]


def test_jobs_that_wait_are_facts_for_the_heartbeat(clock, monkeypatch):
    """Ids and reasons, those with the same reason together; nothing once they run."""
    jobs = Jobs(9)
    kept = replacement(jobs, clock)
    jobs.queue |= {str(i): QueuedJob("PENDING", "Resources") for i in range(1, 9)}
    jobs.queue["9"] = QueuedJob("PENDING", "")
    clock.now += 40
    kept.check()
    monkeypatch.setattr(time, "time", lambda: 1e9)
    [wait] = kept.waits()
    assert wait.what == "jobs"
    assert wait.detail == "jobs 1, 2, 3, 4, 5, 6 and 2 more: Resources; job 9: PENDING"
    assert wait.since == 1e9 - 40
    jobs.queue = dict.fromkeys(jobs.queue, RUNNING)
    kept.check()
    assert kept.waits() == []


@pytest.mark.parametrize(("least", "most", "calls", "expected"), [(4, 32, 1000, 32), (4, 32, 9, 12), (4, 32, 0, 4)])
def test_as_many_workers_as_there_is_work_for(clock, least, most, calls, expected):
    """Between two limits, in whole jobs of four workers."""
    jobs = Jobs(1, processes=4)
    kept = replacement(jobs, clock, limits=(least, most))
    kept.expect(calls)
    kept.check()
    assert len(jobs.queue) * 4 == expected


def test_jobs_that_are_not_needed_end_those_that_wait_first(clock, caplog):
    """Then those whose workers have nothing to do; one that computes is left alone, as is the least number."""
    jobs = Jobs(4)
    kept = replacement(jobs, clock, limits=(1, 4))
    kept.expect(4)
    jobs.queue["3"] = QueuedJob("PENDING", "Resources")
    jobs.scheduler.workers = {
        address: SimpleNamespace(name=f"SLURMCluster-{address}", processing={"batch"} if address in (0, 3) else set())
        for address in (0, 1, 3)
    }
    for calls, left in ((3, "124"), (2, "14"), (1, "14"), (0, "14")):
        kept.expect(calls)
        kept.check()
        assert "".join(sorted(jobs.queue)) == left, calls
    jobs.scheduler.workers[3].processing.clear()
    kept.check()
    assert list(jobs.queue) == ["1"]
    assert kept.released == set(jobs.retired) == {f"SLURMCluster-{i}" for i in (1, 2, 3)}
    assert (kept.failure, jobs.submitted) == (None, 4)
    assert "ended before" not in caplog.text


OF_OAR = {
    "owner": "ada",
    "queue": "default",
    "jobType": "PASSIVE",
    "reservation": "None",
    "array_index": 1,
    "types": [],
}
ANSWERS = {
    "slurm": "17|PENDING|Resources\n18|RUNNING|None\n19_3|COMPLETING|None\n",
    # what OAR 2.5.9 wrote of jobs of two cores, without their commands, times and folders
    "oar": json.dumps(
        {
            "37": {"state": "Running", "message": "R=1,W=0:2:0,J=B,N=probe (Karma=0.000,quota_ok)", **OF_OAR},
            "39": {"state": "Hold", "message": "R=1,W=2:0:0,J=B,N=probe", **OF_OAR},
            "38": {"state": "Waiting", "message": "R=2,W=0:2:0,J=B,N=probe (Karma=0.000,quota_ok)", **OF_OAR},
            "40": {"state": "toError", "message": "the node is gone", **OF_OAR},
            "41": {"state": "Terminated", "message": "", **OF_OAR},
        }
    ),
    "pbs": """
server:
                                                                 Req'd  Req'd   Elap
Job ID               Username Queue    Jobname    SessID NDS TSK Memory Time  S Time
-------------------- -------- -------- ---------- ------ --- --- ------ ----- - -----
101.server           me       workq    dask-worke    --    1  16   32gb 01:00 Q   --
   Not Running: Insufficient amount of resource: ncpus (R: 16 A: 0 T: 64)
102.server           me       workq    dask-worke  12345   1  16   32gb 01:00 R 00:10
   Job run at Fri Nov 27 at 12:00 on (n1:ncpus=16:mem=33554432kb)
103.server           me       workq    dask-worke  12346   1  16   32gb 01:00 C 00:59
   --
104[].server         me       workq    dask-worke    --    1  16   32gb 01:00 H   --
    --
""",
}
MEANT = {
    "slurm": {"17": (True, "Resources"), "18": (False, ""), "19": (False, "")},
    "oar": {
        "37": (False, ""),
        "38": (True, ""),
        "39": (True, ""),
        "40": (False, "the node is gone"),
    },
    "pbs": {
        "101": (True, "Not Running: Insufficient amount of resource: ncpus (R: 16 A: 0 T: 64)"),
        "102": (False, ""),
        "104": (True, ""),
    },
}


@pytest.mark.parametrize("kind", ANSWERS)
def test_what_the_batch_systems_say(kind):
    """Jobs that have ended are left out; nothing at all is an empty queue."""
    read = _QUEUES[kind][1]
    assert {number(job): (entry.waits, entry.reason) for job, entry in read(ANSWERS[kind]).items()} == MEANT[kind]
    assert read("") == {}
