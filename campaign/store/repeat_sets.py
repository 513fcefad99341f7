"""The repeats of a campaign in its store: which are planned, which are done, and their rows."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from campaign.errors import StoreError
from campaign.plan_header import PlanHeader, RepeatPlan, plan_repeats
from campaign.store.layout import REPEATS
from campaign.store.parts import total
from campaign.store.store import Store

if TYPE_CHECKING:
    import pyarrow as pa

MOST_SETS = 20


@dataclass(frozen=True)
class RepeatSurvey:
    """The state of a campaign's repeats in a store."""

    missing: frozenset[int]  # batches of the campaign with a missing repeat; none beyond the end of its table
    bad: list[str]  # what is wrong with bad files
    statuses: dict[str, int]  # number of repeats by status
    planned: int
    done: int  # of the planned ones, those that the store holds


def repeated_shares(store: Store, plan: PlanHeader) -> tuple[float, ...]:
    """Return the shares of samples that are repeated, rising: the plan's, and those requested later."""
    document = store.read_json(plan.campaign_id, REPEATS) or {"shares": []}
    added = document.get("shares")
    shares = (plan.repeats, *(added if isinstance(added, list) else [None]))
    numbers = [share for share in shares if isinstance(share, float | int) and not isinstance(share, bool)]
    if len(numbers) < len(shares) or not all(a < b <= 1.0 for a, b in pairwise(numbers)):
        raise StoreError(
            f"store {store.url}: {plan.campaign_id}/{REPEATS} says shares = {added!r:.60}; allowed: rising numbers"
            f" above {plan.repeats:g}, up to 1; restore it, or remove it and repeat samples again with clearcap repeat"
        )
    return tuple(map(float, numbers))


def add_share(store: Store, plan: PlanHeader, share: float) -> None:
    """Make a campaign repeat a larger share of its samples; existing repeats count towards it."""
    shares = repeated_shares(store, plan)
    if share > shares[-1] and len(shares) <= MOST_SETS:
        store.write_json(plan.campaign_id, REPEATS, {"shares": [*shares[1:], share]})


def repeat_plans(store: Store, plan: PlanHeader) -> tuple[RepeatPlan, ...]:
    """Return the sets of repeats of a campaign."""
    return plan_repeats(plan, repeated_shares(store, plan))


def survey_repeats(
    store: Store, sets: Sequence[RepeatPlan], *, verify: bool = False, mend: bool = False
) -> RepeatSurvey:
    """Return the state of some sets of repeats; ``verify`` reads every file, ``mend`` quarantines bad ones."""
    missing, bad, statuses = set[int](), list[str](), list[dict[str, int]]()
    for repeats in sets:
        survey = store.survey(repeats, verify)
        missing.update(repeats.campaign_batches[batch] for batch in survey.missing)
        bad += dict.fromkeys(survey.bad.values())
        statuses.append(survey.statuses)
        if mend:
            store.quarantine(repeats, survey.bad)
            store.record(repeats, survey.parts.values())
    counts = total(statuses)
    planned = sum(store.end(repeats) for repeats in sets)
    return RepeatSurvey(frozenset(missing), bad, counts, planned, sum(counts.values()))


def read_repeats(store: Store, plan: PlanHeader, columns: Sequence[str] | None = None) -> "pa.Table | None":
    """Return the repeats of a campaign that the store holds, set by set; None if no repeats are planned."""
    import pyarrow as pa

    sets = repeat_plans(store, plan)
    if not sets:
        return None
    names = sets[0].schema.names if columns is None else list(columns)
    empty = sets[0].schema.empty_table().select(names)
    return pa.concat_tables([empty, *(table for repeats in sets for table in store.stream(repeats, names))])
