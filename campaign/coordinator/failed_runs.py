"""Campaigns with too few ok runs: when they stop, and the messages about how many failed, how, and what to do.

Nothing here loads dask, which a report does not need.
"""

from collections import Counter
from collections.abc import Mapping

import pyarrow.compute as pc

from campaign.coordinator.heartbeat import Progress
from campaign.coordinator.state import resume_command
from campaign.errors import CampaignError, FailedStatus
from campaign.plan import Plan
from campaign.store import Store
from reporting.samples import judged_counts, statuses_in_words, too_few_ok


class TooManyFailed(CampaignError):
    """More runs failed than the campaign allows, or all of its first runs."""


def check_failures(store: Store, plan: Plan, progress: Progress) -> None:
    """Raise TooManyFailed, with the message of one failed run and what to do, if too many runs have failed."""
    # Without ``failures.max_failed`` that is the case if all of the first runs of a coordinator fail and no run at all
    # is ok. So a campaign that is resumed nevertheless computes as many runs again.
    policy, end = plan.spec.failures, progress.samples
    most = policy.most_failed(plan.spec.samples)
    if progress.failed > most:
        why = f"{progress.failed} of {progress.done} runs failed, and failures.max_failed allows {most:g}"
        on = "raise failures.max_failed and run the campaign again"
    elif progress.done < end and policy.is_hopeless(
        progress.statuses.get("ok", 0), min(progress.computed, progress.failed)
    ):
        why = f"{lack_of_ok(plan, progress.statuses)}, so the campaign of {end} samples stops here"
        resume = resume_command(store, plan.campaign_id)
        on = f"{resume}; with failures.max_failed = {end} in the campaign file it never stops"
    else:
        return
    raise TooManyFailed(f"{why}; the rows are kept\n{what_to_do(store, plan)}\nto continue anyway: {on}")


def lack_of_ok(plan: Plan, statuses: Mapping[str, int]) -> str:
    """Return the message that fewer stored runs are ok than ``failures.min_ok`` requires; empty if enough are."""
    statuses = judged_counts(statuses, plan.spec.failures.max_not_assemblable)
    done, ok, least = sum(statuses.values()), statuses.get("ok", 0), plan.spec.failures.min_ok
    if done and not ok:
        return f"none of {done} runs succeeded ({statuses_in_words(statuses)})"
    if too_few_ok(ok, done, least):
        return (
            f"{done - ok} of {done} runs failed ({statuses_in_words(statuses)}); failures.min_ok requires"
            f" {100 * least:g} % ok runs, so no response gets a verdict"
        )
    return ""


def what_to_do(store: Store, plan: Plan) -> str:
    """Return the message of one run with the most frequent failed status, how to inspect it, and what may help."""
    counts: Counter[str] = Counter()
    first: dict[str, tuple[int, str]] = {}
    for table in store.stream(plan, ["sample", "status", "message"]):
        failed = [row for row in table.filter(pc.field("status") != "ok").to_pylist() if plan.is_failed(row["status"])]
        counts.update(row["status"] for row in failed)
        for row in failed:
            first.setdefault(row["status"], (row["sample"], row["message"] or "no message"))
    if not counts:  # the parts were damaged in the meantime
        return "their messages cannot be read"
    (status, _), *_ = counts.most_common(1)
    sample, message = first[status]
    look = store.command("replay", plan.campaign_id, str(sample))
    other = "give such runs other settings in failures.retry, or state in failures.min_ok how many may fail"
    if status == FailedStatus.NOT_ASSEMBLABLE:
        other = "or make their share a result with a limit of its own, failures.max_not_assemblable"
    return (
        f"sample {sample}, {status}: {message}\nlook at it: {look}\nthen remove the cause in the mechanism or in the"
        f" inputs, {other}"
    )
