"""Write the plan of a campaign into a store: check it, time a run, reuse rows, and assign a coordinator to it."""

import getpass
import json
import logging
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.compute as pc

from campaign.compiling import announced_compilation
from campaign.coordinator.lease import is_alive, is_coordinated
from campaign.coordinator.requests import finish_deletion
from campaign.coordinator.state import state_of, write_state
from campaign.errors import SpecError, StoreError, unwritable
from campaign.inputs.sampling import sampler_named
from campaign.plan import Plan, batch_size_is_fixed, make_plan
from campaign.processes import STORE
from campaign.spec.load import Campaign, Source, load_campaign
from campaign.store import BadPart, Store, open_store
from campaign.store.files.files import LARGEST
from campaign.store.labels import LabelChange, claim, is_owner
from campaign.store.layout import CANCEL, LEASE, LOG, PLAN, SERVICE, SUBMISSION
from campaign.store.parts import batches_of, folder, read_file
from campaign.store.store import read_repeats, repeat_plans
from campaign.worker.batch import rows_in_subprocess
from campaign.worker.messages import CampaignAddress, Simulate
from engine import missing_kernels, simulate
from engine import simulate as engine_simulate
from engine.platform.child import python_environment

# keys that no row depends on
IRRELEVANT = ("name", "title", "header", "samples", "responses", "requirements", "stop", "decide", "repeats", "format")
# whatever the machine
DETERMINED = ("ok", "not_at_rest", "not_converged", "jammed", "diverged", "invalid", "not_assemblable")

logger = logging.getLogger(__name__)

T = TypeVar("T")
RUNS = 4  # number of trial runs
ENOUGH = 5.0  # s; if the first run takes longer, no other is tried


def plan_campaign(
    campaign: Source | Campaign,
    url: str,
    samples: int | None = None,
    seed: int | None = None,
    batch_size: int | None = None,
    labels: LabelChange | None = None,
    *,
    when_new: Callable[[], None] = lambda: None,
) -> tuple[Store, Plan]:
    """Open the store, load the campaign and plan it; if the store already has its plan, return that one."""
    # For a new campaign, ``when_new`` is called before any run, and its cautions and open questions (lines that begin
    # with ``#?``) are logged as warnings.
    # loads all of reporting, which a server does not need
    from campaign.spec.campaign_cautions import campaign_cautions, campaign_questions

    opened = open_store(url)
    if not opened.files.shared:
        raise SpecError(
            f"store {opened.url}: the workers cannot reach the memory of this process; name a folder or a URL"
        )
    loaded = campaign if isinstance(campaign, Campaign) else load_campaign(campaign, samples=samples, seed=seed)
    # before the trial runs of `submit`, which may take minutes
    opened.files.check_writable()
    if make_plan(loaded, batch_size).campaign_id not in opened.campaigns():
        when_new()
        for question in campaign_questions(campaign):
            logger.warning("%s", question)
        for caution in campaign_cautions(loaded):
            logger.warning("warning: %s", caution)
    return opened, submit(opened, loaded, batch_size, labels=labels)


def submit(
    store: Store,
    campaign: Campaign,
    batch_size: int | None = None,
    simulate: Simulate = simulate,
    *,
    labels: LabelChange | None = None,
    tries_runs: bool = True,
    by: str | None = None,
) -> Plan:
    """Write the plan of a campaign into a store, or return the plan that the store already has."""
    # ``batch_size`` None makes a batch take about ten seconds, by the time of a few runs in a separate process
    # (minutes), or, without ``tries_runs``, of stored runs of this mechanism; without any, batches are small. ``by``
    # None is the user of this process, who owns a new campaign unless ``labels`` names an owner; one that is there
    # keeps its owner.
    new, user = make_plan(campaign, batch_size), user_name() if by is None else by
    is_new = new.campaign_id not in store.campaigns()
    if not is_new:
        plan = store.plan(new.campaign_id)
    else:
        # or its files, of an earlier campaign with this id, would be among those of the new one
        finish_deletion(store, new.campaign_id)
        seconds = None
        if batch_size is None and not batch_size_is_fixed(campaign.spec.samples):
            seconds = seconds_per_run(new, simulate) if tries_runs else known_seconds_per_run(store, new)
        plan = store.create_plan(make_plan(campaign, batch_size, seconds))
        store.create_json(plan.campaign_id, SUBMISSION, {"user": user, "time": time.time()})
    _label(store, plan, labels or LabelChange(), user, is_new=is_new)
    if is_new:
        # before the campaign is queued: from then on a service may compute the same rows
        if reused := reuse_rows(store, plan):
            logger.info(
                "%d rows are reused from a campaign that differs only in its number of samples or its limits", reused
            )
        write_state(store, plan.campaign_id, "queued")
    if batch_size is not None and plan.batches != new.batches:
        logger.warning("the campaign is planned already: its batches of %d samples are kept", plan.batches[0][1])
    return plan


def _label(store: Store, plan: Plan, wanted: LabelChange, user: str, *, is_new: bool) -> None:
    """Give a campaign the owner and the tags that it is submitted with; log if it already has another owner."""
    if wanted.owner is None and is_new and is_owner(user):
        wanted = replace(wanted, owner=user)
    labels = claim(store, plan.campaign_id, wanted, user)
    submitter = user if wanted.owner is None else wanted.owner
    if labels.owner and labels.owner != submitter:
        logger.info("campaign %s was submitted before: its owner is and stays %s", plan.campaign_id, labels.owner)


def user_name() -> str:
    """Return the name of this process's user; empty if the system has no name for the user, as in some containers."""
    try:
        return getpass.getuser()
    except (OSError, KeyError):
        return ""


@dataclass(frozen=True)
class Assignment:
    """The coordinator that computes a campaign."""

    kind: str  # ``service`` (it serves the store), ``coordinator`` (of this campaign alone), or ``none`` (it waits)
    pid: int | None = None  # of a coordinator that was started for it
    log: str | None = None  # path of that coordinator's log

    def text(self, store: Store) -> str:
        """Return the assignment in words."""
        if self.kind == "service":
            return "the coordinator that serves the store computes it"
        if self.kind == "none":
            return f"queued; compute the queued campaigns of the store with: {store.command('coordinate')}"
        if self.pid is None:
            return "a coordinator computes it already"
        return f"started a coordinator (process {self.pid}, log {self.log})"

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {"driver": self.kind, "pid": self.pid, "log": self.log}


def assign_coordinator(store: Store, plan: Plan, options: list[str], *, queue_only: bool = False) -> Assignment:
    """Assign a coordinator to a campaign; start one if needed, with these options, unless ``queue_only``."""
    store.remove(plan.campaign_id, CANCEL)  # of an earlier cancellation
    if is_coordinated(store, plan.campaign_id):
        return Assignment("coordinator")
    if state_of(store, plan.campaign_id)["state"] != "completed" or store.survey(plan).missing:
        write_state(store, plan.campaign_id, "queued")
    if queue_only:
        return Assignment("none")
    lease = store.read_json(SERVICE, LEASE)
    if lease is not None and is_alive(store, SERVICE, lease):
        return Assignment("service")
    return Assignment("coordinator", *start_coordinator(store, plan, options))


def start_coordinator(store: Store, plan: Plan, options: list[str]) -> tuple[int, str]:
    """Start ``clearcap coordinate`` in a process that outlives this one; return its id and the path of its log."""
    folder = Path(store.files.path(plan.campaign_id)) if store.files.local else Path.cwd()
    log = folder / (LOG if store.files.local else f"{plan.campaign_id}.log")
    words = [sys.executable, "-P", "-m", "clearcap", "coordinate", plan.campaign_id, *options]
    try:
        file = log.open("ab")
    except OSError as error:
        message = f"log {log}: cannot be written ({error.strerror}); free the disk, or start in another folder"
        raise unwritable(message, error) from error
    with file:
        process = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=file,
            cwd="/",
            env={**python_environment(), STORE: store.files.full_url},  # other users cannot read it there
            start_new_session=True,  # neither Ctrl-C nor the end of the terminal reaches it
        )
    process.returncode = 0  # nobody waits for it, and the interpreter shall not warn of that
    return process.pid, str(log)


# -- reused rows -------------------------------------------------------------------------------------------------------
#
# A new campaign reuses the rows of another one if it differs only in its number of samples or its limits. A row depends
# on the variables, on what is simulated, and on the number of its sample. It does not depend on the number of samples,
# the limits, or the name of the campaign.


def reuse_rows(store: Store, plan: Plan) -> int:
    """Copy rows of a new plan, and repeats, from other campaigns of the store; return the number of rows."""
    reused = 0
    for other in _alike(store, plan, _what_rows_depend_on, store.plan):
        if reason := sampler_named(plan.spec.sampler).not_extendable:
            logger.info("the rows of %s cannot be reused: %s", other.campaign_id, reason)
            return 0
        reused += _copy(store, other, plan)
        _copy_repeats(store, other, plan)
    return reused


def _alike(
    store: Store, plan: Plan, matter: Callable[[Mapping[str, Any]], Any], get: Callable[[str], T]
) -> Iterator[T]:
    """Yield what can be got of the store's other campaigns whose plans, as documents, agree in what matters."""
    wanted = matter(json.loads(plan.to_json()))
    for campaign_id in store.campaigns():
        with suppress(StoreError):  # the plan is damaged or of another version
            if campaign_id != plan.campaign_id and matter(store.read_json(campaign_id, PLAN, LARGEST) or {}) == wanted:
                yield get(campaign_id)


def _what_rows_depend_on(content: Mapping[str, Any]) -> list[Any]:
    """Return everything in a plan's document that a row depends on, besides the number of its sample."""
    document = content.get("spec", {})
    spec = {key: value for key, value in document.items() if key not in IRRELEVANT}
    # of this table only further attempts change a row; the other keys say when to stop and what a verdict needs
    spec["failures"] = document.get("failures", {}).get("retry", [])
    order = list(document.get("variables", {}))  # of columns, and of the dimensions of a sampler
    return [spec, order, *(content.get(key) for key in ("row_build", "mechanism_digest"))]


def _copy(store: Store, other: Plan, plan: Plan) -> int:
    """Write the parts of a plan that the rows of another campaign fill completely; return the number of rows."""
    there = store.survey(plan).parts
    waiting = (batch for batch in range(len(plan.batches)) if batch not in there)
    batch, copied, kept = next(waiting, None), 0, plan.schema.empty_table()
    for rows in store.stream(other):
        kept = pa.concat_tables([kept, rows.replace_schema_metadata(plan.schema.metadata)])
        while batch is not None and kept.num_rows and sum(plan.batches[batch]) <= kept["sample"][-1].as_py() + 1:
            first, count = plan.batches[batch]
            part = kept.filter((pc.field("sample") >= first) & (pc.field("sample") < first + count))
            if part.num_rows == count and set(part["status"].to_pylist()) <= set(DETERMINED):
                store.write_part(plan, batch, part)
                copied += count
            kept = kept.filter(pc.field("sample") >= first + count)
            batch = next(waiting, None)
    return copied


def _copy_repeats(store: Store, other: Plan, plan: Plan) -> None:
    """Write the parts of a plan's repeats that the repeats of another campaign fill completely."""
    rows, sets = read_repeats(store, other), repeat_plans(store, plan)
    if rows is None or not sets:
        return
    usable = rows.filter(pc.field("status").isin(DETERMINED)).sort_by("sample")
    for repeats in sets:
        for batch in store.survey(repeats).missing:
            first, count = repeats.batches[batch]
            part = usable.filter(pc.field("sample").isin(repeats.numbers_of(first, first + count)))
            if part.num_rows == count:
                store.write_part(repeats, batch, part.replace_schema_metadata(repeats.schema.metadata))


# -- how long a run takes, before a campaign is divided into batches ---------------------------------------------------


def seconds_per_run(plan: Plan, simulate: Simulate, clock: Callable[[], float] = time.perf_counter) -> float | None:
    """Return how long a run takes here [s], from a few in a subprocess; None if one of them kills its process."""
    runs = min(RUNS, plan.spec.samples)
    with tempfile.TemporaryDirectory(prefix="clearcap-probe-") as folder:
        store = open_store(folder)
        store.create_plan(plan)
        address = CampaignAddress.of(store, plan, simulate)
        with announced_compilation(missing_kernels() if simulate is engine_simulate else ()):
            rows = rows_in_subprocess(address, range(runs), 1)
            first = next(rows)  # includes the start of the process, and perhaps compilation
        if first["wall_s"] is None or first["wall_s"] > ENOUGH or runs == 1:
            return first["wall_s"] if first["wall_s"] is None else float(first["wall_s"])
        start = clock()
        statuses = [row["status"] for row in rows]
        return None if "crashed" in statuses else (clock() - start) / len(statuses)


def known_seconds_per_run(store: Store, plan: Plan) -> float | None:
    """Return how long runs of the same mechanism and settings took in another campaign of a store [s]; None without."""
    times = _alike(store, plan, _what_time_depends_on, lambda campaign_id: _mean_time(store, campaign_id))
    return next((seconds for seconds in times if seconds is not None), None)


def _what_time_depends_on(document: Mapping[str, Any]) -> list[Any]:
    """Return the parts of a plan's document that have the most influence on how long a run takes."""
    spec = document.get("spec", {})
    return [document.get("mechanism_digest"), *(spec.get(key) for key in ("simulation", "bench", "preset"))]


def _mean_time(store: Store, campaign_id: str) -> float | None:
    """Return the mean time of the runs in the first sound file of rows of a campaign [s]; None without one."""
    header = store.plan_header(campaign_id)
    for name in store.files.names(folder(header)):
        if batches_of(name, header):
            try:
                times = read_file(store.files, header, name, ["wall_s"])["wall_s"].drop_null().to_pylist()
            except (BadPart, FileNotFoundError):
                continue
            if times:
                return float(sum(times) / len(times))
    return None
