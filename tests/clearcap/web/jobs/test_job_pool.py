"""A pool of processes: answers, errors, limits, replacement, cancellation, and what its processes do not get."""

import asyncio
import json
import os
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest

from campaign.errors import SpecError, StoreError
from clearcap.web.jobs.pool import Busy, JobPool, Quota
from clearcap.web.jobs.process import JobFailed, JobLimits, JobPostponed, JobTooLarge
from tests.clearcap.web.jobs import strange_jobs
from tests.clearcap.web.running import until_true
from tests.until import until

pytestmark = pytest.mark.processes

LIMITS = JobLimits(processor_s=200.0, wall_s=600.0, memory_gib=1.0, answer_mib=1.0)  # only a hang reaches its times


def in_pool(ask, processes=1, **settings):
    """Run a coroutine function with a pool."""

    async def run():
        async with JobPool(processes, limits=LIMITS, **settings) as pool:
            return await ask(pool)

    return asyncio.run(run())


def is_running(pid):
    """Return whether there is such a process that has not ended."""
    with suppress(FileNotFoundError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def test_a_process_serves_again_and_again():
    """Data come as JSON, bytes as they are, numbers that are not finite as null; the process stays the same."""

    async def ask(pool):
        first, second = await pool.data("u", strange_jobs.add, 1, 2), await pool.data("u", strange_jobs.add, 3, 4)
        assert (first["sum"], second["sum"]) == (3, 7)
        assert first["process"] == second["process"] != os.getpid()
        assert await pool.run("u", strange_jobs.raw, 1000) == b"\n\0" * 500
        assert await pool.data("u", strange_jobs.odd_numbers) == {"values": [None, None, 1.5]}
        assert await pool.data("u", strange_jobs.print_something) == "said"
        assert await pool.data("u", strange_jobs.shout, strange_jobs.Shouting("so")) == "SO"
        assert (await pool.data("u", strange_jobs.add, 0, 0))["process"] == first["process"]

    in_pool(ask)


def test_errors_of_the_input_come_as_what_they_are():
    """With message and faults, and the process goes on."""

    async def ask(pool):
        before = (await pool.data("u", strange_jobs.add, 1, 2))["process"]
        with pytest.raises(SpecError, match="must be above 0") as wrong:
            await pool.run("u", strange_jobs.wrong_input)
        assert wrong.value.faults == [{"key": "variables.J1.std", "value": "2026-01-02"}]
        with pytest.raises(StoreError, match="cannot be reached") as away:
            await pool.run("u", strange_jobs.store_away)
        assert away.value.faults is None
        assert (await pool.data("u", strange_jobs.add, 1, 2))["process"] == before

    in_pool(ask)


@pytest.mark.parametrize(
    ("job", "limits", "kind", "words"),
    [
        (partial(strange_jobs.sleep, 600), JobLimits(wall_s=0.5), JobPostponed, "longer than 0.5 s"),
        (strange_jobs.spin, JobLimits(processor_s=0.5, wall_s=600.0), JobTooLarge, "more than 0.5 s of processor time"),
        pytest.param(strange_jobs.eat, LIMITS, JobTooLarge, "more than 1 GiB of memory", marks=pytest.mark.slow),
        (partial(strange_jobs.raw, 3 << 20), LIMITS, JobTooLarge, "more than 1 MiB"),
        (strange_jobs.crash, LIMITS, JobFailed, "SIGSEGV"),
        (strange_jobs.is_killed, LIMITS, JobPostponed, "SIGKILL"),
        pytest.param(strange_jobs.leave, LIMITS, JobFailed, "exit status 7", marks=pytest.mark.slow),
        pytest.param(strange_jobs.bug, LIMITS, JobFailed, r"a bug in the program \(KeyError\)", marks=pytest.mark.slow),
    ],
)
def test_a_job_that_goes_wrong_is_one_clear_error_and_its_process_is_replaced(job, limits, kind, words, caplog):
    """Whatever it does, the next job is served, by another process; the error says whose fault it is, and no more."""

    async def ask(pool):
        before = (await pool.data("u", strange_jobs.add, 1, 2))["process"]
        with pytest.raises(JobFailed, match=words) as failed:
            await pool.run("u", _call, job, limits=limits)
        assert type(failed.value) is kind
        assert "secret detail" not in str(failed.value)
        assert str(failed.value) in caplog.text
        assert (await pool.data("u", strange_jobs.add, 1, 2))["process"] != before
        assert not is_running(before)

    in_pool(ask)


def _call(job):
    """Call a function with its arguments bound."""
    return job()


def test_a_cancelled_job_ends_with_all_it_has_started(tmp_path):
    """Its process and that process's children are gone, and the place is free for the next."""
    note = tmp_path / "pid"

    async def ask(pool):
        job = asyncio.create_task(pool.run("u", strange_jobs.start_child, str(note)))
        await until_true(lambda: note.exists() and note.read_text())
        child = int(note.read_text())
        assert is_running(child)
        job.cancel()
        with pytest.raises(asyncio.CancelledError):
            await job
        await until_true(lambda: not is_running(child))
        assert (await pool.data("u", strange_jobs.add, 1, 2))["sum"] == 3

    in_pool(ask, quota=Quota(at_once=1))


def test_a_job_cancelled_before_its_process_has_started_costs_none():
    """The process that was starting serves the next."""

    async def ask(pool):
        job = asyncio.create_task(pool.run("u", strange_jobs.sleep, 600))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        job.cancel()
        with pytest.raises(asyncio.CancelledError):
            await job
        assert (await pool.data("u", strange_jobs.add, 1, 2))["sum"] == 3
        assert (pool.turns.running, pool.turns.waiting) == (0, 0)

    in_pool(ask)


def test_a_process_that_died_idle_is_replaced_before_it_is_asked():
    """Whoever asks next notices nothing."""

    async def ask(pool):
        process = (await pool.data("u", strange_jobs.add, 1, 2))["process"]
        os.kill(process, 9)
        (started,) = pool._idle
        await until_true(lambda: not started.result().alive, "the event loop has heard of it")
        assert (await pool.data("u", strange_jobs.add, 1, 2))["sum"] == 3

    in_pool(ask)


def test_two_jobs_run_at_a_time_and_more_wait_or_are_refused(tmp_path):
    """As many as there are processes; a user's third waits, and one more is refused with a time."""

    async def ask(pool):
        two = [asyncio.create_task(pool.data("u", strange_jobs.hold, str(tmp_path))) for _ in range(2)]
        await until_true(lambda: pool.turns.running == 2)
        third = asyncio.create_task(pool.data("u", strange_jobs.add, 1, 2))
        await until_true(lambda: pool.turns.waiting == 1)
        with pytest.raises(Busy) as refused:
            await pool.run("u", strange_jobs.add, 1, 2)
        assert refused.value.retry_after_s >= 1
        assert (pool.turns.running, pool.turns.waiting) == (2, 1)
        (tmp_path / "go").touch()
        assert await asyncio.gather(*two) == ["held", "held"]
        assert (await third)["sum"] == 3

    in_pool(ask, processes=2, quota=Quota(at_once=2, waiting=1))


def test_a_process_gets_no_secret_of_the_service(monkeypatch):
    """Neither in its environment nor as an open file; it finds modules, and a store's keys, and not the folder."""
    monkeypatch.setenv("OIDC_CLIENT_SECRET", "hush")
    monkeypatch.setenv("CLEARCAP_SESSION_KEY", "hush")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "of the store")

    async def ask(pool):
        return await pool.data("u", strange_jobs.environment)

    found = in_pool(ask)
    assert "hush" not in found.values()
    assert found["AWS_ACCESS_KEY_ID"] == "of the store"
    assert found["PYTHONSAFEPATH"] == "1"
    assert found["OMP_NUM_THREADS"] == "1"


def test_processes_warm_up_before_they_serve(tmp_path):
    """Each once, and a warm-up that fails is an error of the job, not of the pool."""
    note = tmp_path / "calls"

    async def ask(pool):
        await pool.run("u", strange_jobs.add, 1, 2)
        await pool.run("u", strange_jobs.add, 1, 2)
        return note.read_bytes()

    assert in_pool(ask, warm_up=partial(strange_jobs.count_calls, str(note))) == b"x"

    async def ask_cold(pool):
        with pytest.raises(JobPostponed, match="no process could be started"):
            await pool.run("u", strange_jobs.add, 1, 2)

    in_pool(ask_cold, warm_up=strange_jobs.store_away)


def test_jobs_end_with_the_pool():
    """The one that runs and the one that waits each say why; neither hangs."""

    async def leave():
        async with JobPool(1, quota=Quota(at_once=1), limits=LIMITS) as pool:
            await pool.run("u", strange_jobs.add, 1, 2)  # its process has started
            jobs = [asyncio.create_task(pool.run("u", strange_jobs.sleep, 600)) for _ in range(2)]
            await until_true(lambda: (pool.turns.running, pool.turns.waiting) == (1, 1))
        return await asyncio.gather(*jobs, return_exceptions=True)

    running, waiting = asyncio.run(leave())
    assert isinstance(running, JobFailed)
    assert isinstance(waiting, JobPostponed)
    assert "the server is shutting down" in str(waiting)


def test_a_pool_that_ends_while_a_process_starts():
    """The job that waits for it says why it is not computed; it is not cancelled, as nobody has cancelled it."""

    async def leave():
        async with JobPool(1, limits=LIMITS, warm_up=partial(strange_jobs.sleep, 600)) as pool:
            job = asyncio.create_task(pool.run("u", strange_jobs.add, 1, 2))
            await until_true(lambda: pool.turns.running == 1)
            await asyncio.sleep(0)
        return (await asyncio.gather(job, return_exceptions=True))[0]

    failed = asyncio.run(leave())
    assert isinstance(failed, JobPostponed)
    assert "the server is shutting down" in str(failed)


def test_nothing_is_left_of_a_pool():
    """Processes end with it, amid a job too."""
    pids = []

    async def ask(pool):
        pids.append(json.loads(await pool.run("u", strange_jobs.add, 1, 2))["process"])
        job = asyncio.create_task(pool.run("u", strange_jobs.sleep, 600))
        await until_true(lambda: pool.turns.running == 1)
        job.cancel()

    in_pool(ask)
    until(lambda: not is_running(pids[0]), "the process has ended")
