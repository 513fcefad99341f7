"""Each row of the table of what dies, on the page about clusters, has tests of what happens then."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
TESTS = {
    "a worker process": "campaign/coordinator/test_coordinate.py::test_killed_worker_costs_nothing"
    " campaign/cluster/test_roster.py::test_who_comes_back_at_once_restarted",
    "every worker that takes a particular batch": "campaign/coordinator/test_coordinate.py::"
    "test_runs_that_end_their_process_are_rows",
    "a worker process hangs": "campaign/cluster/test_dask_workers.py::"
    "test_a_worker_that_hangs_is_replaced_within_the_time_that_the_docs_promise",
    "a worker's machine, or the network to it": "deploy/test_partitions.py::test_a_partition"
    " deploy/test_batch_scripts.py::test_workers_that_lost_their_scheduler_come_back",
    "a job of `--cluster slurm`": "deploy/test_slurm.py::test_jobs_that_end_are_replaced"
    " campaign/cluster/test_job_replacement.py::test_jobs_whose_workers_had_joined_are_replaced_at_once",
    "jobs that end before they have finished a batch": "campaign/cluster/test_job_replacement.py::"
    "test_jobs_too_short_for_a_batch_are_named",
    "jobs that end before a worker has joined": "campaign/cluster/test_job_replacement.py::"
    "test_jobs_that_end_in_vain_are_given_up",
    "jobs that wait in the queue": "campaign/cluster/test_job_replacement.py::"
    "test_jobs_that_wait_are_facts_for_the_heartbeat",
    "the scheduler, or the network to it": "deploy/test_partitions.py::test_a_partition"
    " campaign/coordinator/test_lost_scheduler.py::test_one_that_accepts_and_is_lost_at_once_is_given_up",
    "all workers": "campaign/coordinator/test_dispatch.py::test_that_there_are_no_workers_is_said",
    "the coordinator": "campaign/storms/test_storms.py::test_storm"
    " campaign/coordinator/test_heartbeat.py::test_a_running_campaign_that_goes_on"
    " campaign/coordinator/test_state.py::test_status_of_a_coordinator_elsewhere_that_has_ended",
    "the coordinator or `clearcap run`, by SIGTERM or SIGHUP": "campaign/storms/test_failures.py::"
    "test_terminated_coordinator_leaves_it_open",
    "the machine you submitted from": "campaign/storms/test_service.py::test_service_in_a_storm",
    "a part file in the store is damaged": "campaign/storms/test_failures.py::test_part_damaged_while_it_runs",
    "the store is full or unreachable": "campaign/storms/test_outages.py::test_outage_of_the_store"
    " deploy/test_partitions.py::test_a_partition_from_the_store"
    " campaign/coordinator/test_lost_scheduler.py::test_a_store_that_refuses_is_named_at_once",
    "the certificates have expired": "campaign/cluster/test_connect.py::test_expired_certificates_are_named",
}


def test_each_row_has_a_test():
    """The table and this list name the same events, and the tests are there."""
    page = (ROOT / "docs/clusters.md").read_text(encoding="utf-8")
    table = page.partition("## What happens when a part dies")[2].partition("\n## ")[0]
    events = [line.split(" | ")[0].removeprefix("| ") for line in table.splitlines() if line.startswith("| ")][2:]
    assert [event for event, key in zip(events, TESTS, strict=True) if not event.startswith(key)] == []
    for names in TESTS.values():
        for name in names.split():
            file, _, test = name.partition("::")
            assert f"\ndef {test}(" in (ROOT / "tests" / file).read_text(encoding="utf-8"), name
