"""What must hold of a store when a campaign is over, whatever happened to it."""

import signal

import pyarrow as pa

from campaign.plan_header import repeated_samples
from campaign.store import layout
from campaign.store.files.files import TEMPORARY
from campaign.store.manifest import load_manifest
from campaign.store.store import read_repeats, repeat_plans, survey_repeats

VARIES = ["wall_s", "attempts"]
OF_DASK = "scheduler", "worker"  # their statuses and words are dask's
STOPPED = {signal.SIGTERM, signal.SIGKILL}  # by which a supervisor ends what still runs
FAILED_AT = "store ", "scheduler", "worker", "engine could not be", "cannot be used now"  # in messages of status 4
BEFORE_PYTHON = (
    "Fatal Python error: init"  # an interrupt before the interpreter is up ends it with 1 and its own traceback
)
UNSHARE = "unshare: sigprocmask unblock failed"  # how ``unshare`` ends, with 1, when its child was killed by SIGKILL
NO_PLAN = ("no campaign ", "holds no campaign")  # said by whoever starts while a storm has taken the plan away
LEASE_WORDS = (
    "was taken over by another process",
    "is computed by process",
    "was taken by another process",
    "same time",
)


def bits(store, plan):
    """Return the rows, then the repeats, without what may differ between two computations."""
    rows = store.table(plan.campaign_id).drop_columns(VARIES)
    repeats = read_repeats(store, plan)
    if repeats is None:
        return rows
    more = repeats.select(rows.column_names).replace_schema_metadata(rows.schema.metadata)
    return pa.concat_tables([rows, more]).combine_chunks()


def check_whole(store, plan, reference):
    """Check that the store has every row and repeat once, with the bits of the fault-free ones, and nothing else."""
    table = bits(store, plan)
    repeated = repeated_samples(plan.spec.samples, 0.0, plan.repeats).tolist()
    assert len(repeated) > 2
    assert table["sample"].to_pylist() == [*range(plan.spec.samples), *repeated]
    assert table.equals(reference)
    of_repeats = survey_repeats(store, repeat_plans(store, plan), verify=True)
    assert (of_repeats.missing, of_repeats.bad, of_repeats.done) == (set(), [], len(repeated))
    survey = store.survey(plan, verify=True)
    assert (survey.missing, survey.bad, survey.rows) == ([], {}, plan.spec.samples)
    known = load_manifest(store.files, plan)
    assert {part.batch: part for parts in known.values() for part in parts} == survey.parts
    root = plan.campaign_id
    names = set(store.files.names(root)) - {layout.REPORT, layout.LOG, layout.SUBMISSION, layout.labels_name(1)}
    kept = {"plan.json", "campaign.toml", "state.json", "heartbeat.json", "parts", "manifest.json"}
    kept |= {"repeats-1", "repeats-1.json"}
    assert names == kept, names ^ kept  # no lease, no marker, nothing temporary
    for folder in ("parts", "repeats-1"):
        assert [name for name in store.files.names(f"{root}/{folder}") if name.endswith(TEMPORARY)] == []
    assert store.read_json(root, "state.json")["state"] == "completed"


def check_endings(supervisor, signals):
    """Check that every process of the command that has ended did so as the documentation says, without a traceback.

    Parameters
    ----------
    supervisor : Supervisor
        That kept them.
    signals : dict of int to set of Signals
        What each process was sent.
    """
    for life in supervisor.lives:
        if life.process.returncode is not None and not life.name.startswith(OF_DASK):
            pid, code, said = life.process.pid, life.process.returncode, life.text()
            sent = signals.get(pid, set()) | (STOPPED if pid in supervisor.stopped else set())
            allowed = {0} | {status for number in sent for status in (128 + number, -number)}
            allowed |= {1} if any(words in said for words in LEASE_WORDS) else set()
            allowed |= {1} if signal.SIGKILL in sent and UNSHARE in said else set()
            started = not (signal.SIGINT in sent and said.startswith(BEFORE_PYTHON))
            allowed |= set() if started else {1}
            allowed |= {4} if "error: " in said and any(words in said for words in FAILED_AT) else set()
            allowed |= {2} if any(words in said for words in NO_PLAN) else set()
            assert code in allowed, f"{life.name} {pid} ended with {code}:\n{said[-3000:]}"
            from_there = said[max(said.find("Traceback") - 1000, 0) :][:6000]
            assert not started or "Traceback" not in said, f"{life.name} {pid} ended with {code}:\n{from_there}"
