"""Campaigns of one plan with different seeds as one report: their samples are one larger sample.

Samples of different seeds are independent of each other. Where those of one seed are independent draws of one
distribution too, all together are, and every number of the report holds for them as for a campaign that had drawn them
all. They are numbered one campaign after the other; with production batches the next campaign begins at a common
multiple of the sizes of its batches, so that no batch has parts of two campaigns.
"""

import hashlib
import math
import shlex
import tempfile
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from campaign.errors import SpecError
from campaign.inputs.distributions import Continuous
from campaign.inputs.sampling import SAMPLERS, sampler_named
from campaign.plan import Plan
from campaign.row_build import UNKNOWN
from campaign.store import Store, open_store
from campaign.store.files.retry_policy import QUICK
from campaign.store.layout import POOLED
from clearcap.questions.plan_differences import plan_differences, shortened
from clearcap.questions.report import (
    BATCH,
    COMMAND,
    campaign_end,
    decisions,
    other_spreads,
    put_report,
    refusals_of,
    repeats_of,
    report_rows,
    report_spec,
    stopping_rule,
)
from clearcap.questions.report_source import OF_PLAN, OF_ROWS, report_source
from reporting import ReportSpec, write_report
from reporting.analysis import Analysis, analyse
from reporting.format_numbers import grouped
from reporting.samples import Repeats, read_samples
from reporting.write import USUAL

Member = tuple[Store, Plan]

FREE = ("seed", "samples")  # keys in which plans may differ
LONGEST = 150  # characters of the name of a folder
_LAST = 2**53  # sample number up to which reports count exactly


@dataclass(frozen=True)
class Pool:
    """Campaigns that differ only in seed and number of samples, and the number that the first sample of each gets."""

    members: tuple[Member, ...]
    firsts: tuple[int, ...]

    @property
    def ids(self) -> list[str]:
        """The ids of the campaigns, in order."""
        return [plan.campaign_id for _, plan in self.members]

    @property
    def text(self) -> str:
        """What is pooled, in words."""
        said = [
            f"{plan.campaign_id} (seed {plan.spec.seed}, {grouped(store.end(plan))} samples, from number {first})"
            for (store, plan), first in zip(self.members, self.firsts, strict=True)
        ]
        return f"{len(said)} campaigns that differ only in seed and number of samples: {', '.join(said)}"


def pooled(members: Sequence[Member]) -> Pool:
    """Return campaigns as a pool; SpecError, with the first difference and the remedy, unless they are one sample."""
    if len(members) < 2:
        raise SpecError("pool: one campaign alone is given; name another one of the same plan with another seed")
    (store, first), spec = members[0], members[0][1].spec
    _check_sampler(first)
    for there, other in members[1:]:
        _check_alike(store, first, there, other)
    for (_, one), (_, other) in combinations(members, 2):
        if one.spec.seed == other.spec.seed:
            raise SpecError(
                f"pool: {one.campaign_id} and {other.campaign_id} have seed = {one.spec.seed}, so the first rows of "
                "both are the same; compute one with another --seed"
            )
    lots = [v.batch.size for v in spec.variables.values() if isinstance(v, Continuous) and v.batch]
    step, firsts = math.lcm(*lots), [0]
    for there, plan in members[:-1]:
        firsts.append(firsts[-1] + -(-there.end(plan) // step) * step)
    if firsts[-1] > _LAST:
        raise SpecError(
            f"pool: batches of {', '.join(map(str, sorted(set(lots))))} parts have no common multiple below 2^53, at "
            "which the next campaign could begin; give all variables batches of one size"
        )
    return Pool(tuple(members), tuple(firsts))


def _check_sampler(plan: Plan) -> None:
    """Raise SpecError unless sets of samples with several seeds are one sample."""
    sampler = plan.spec.sampler
    if reason := sampler_named(sampler).not_poolable:
        allowed = ", ".join(each.name for each in SAMPLERS.values() if not each.not_poolable)
        raise SpecError(f'pool: {plan.campaign_id} has sampler = "{sampler}"; allowed: {allowed}: {reason}')


def _check_alike(store: Store, plan: Plan, there: Store, other: Plan) -> None:
    """Raise SpecError, with the first difference, unless two plans differ only in seed and number of samples."""
    ids = f"{plan.campaign_id} and {other.campaign_id}"
    if UNKNOWN in (plan.row_build, other.row_build):
        raise SpecError(f"pool: {ids}: an earlier version planned one, and its rows may differ; compute it again")
    if plan.row_build != other.row_build:
        here, elsewhere = plan.row_build.split(", "), other.row_build.split(", ")
        one, two = (next((x for x in a if x not in b), "less") for a, b in ((here, elsewhere), (elsewhere, here)))
        raise SpecError(
            f"pool: {ids} are of different builds of clearcap ({one}; {two}), whose rows may differ; compute both "
            "again with one of them"
        )
    for each in plan_differences(store, plan.campaign_id, there, other.campaign_id):
        if each.key not in FREE:
            raise SpecError(
                f"pool: {ids} differ in {each.key}: {shortened(each.here)} and {shortened(each.there)}; allowed to "
                "differ: seed and samples; compare them instead (--against)"
            )
    if list(plan.spec.variables) != list(other.spec.variables):
        raise SpecError(f"pool: {ids} differ in the order of their variables; compute one with the other's order")


def pooled_rows(pool: Pool) -> Iterator[pa.Table]:
    """Yield the columns that a report reads of all campaigns, one after the other, numbered as one sample."""
    batches = 0
    for (store, plan), first in zip(pool.members, pool.firsts, strict=True):
        last = batches
        for table in report_rows(store, plan):
            number = pa.array(table["sample"].to_numpy() + first)
            table = _replaced(table, "sample", number)
            if BATCH in table.column_names:
                batch = table[BATCH].to_numpy() + batches
                last = max(last, int(batch.max(initial=-1)) + 1)
                table = _replaced(table, BATCH, pa.array(batch))
            yield table
        batches = last


def _replaced(table: pa.Table, name: str, column: pa.Array) -> pa.Table:
    at = table.column_names.index(name)
    return table.set_column(at, table.schema.field(name), column)


def pooled_spec(pool: Pool) -> ReportSpec:
    """Return what `reporting` needs to know of a pool: that of its first campaign, and from what it is pooled."""
    (store, plan), *others = pool.members
    spec, text = report_spec(plan, store), pool.text
    provenance = {name: value for name, value in spec.provenance.items() if name not in (OF_PLAN, OF_ROWS, COMMAND)}
    provenance |= {
        "campaign": " + ".join(pool.ids),
        "samples": " + ".join(str(plan.spec.samples) for _, plan in pool.members),
        "seed": ", ".join(str(plan.spec.seed) for _, plan in pool.members),
    }
    if all(there.url == store.url for there, _ in others):  # the command reads one store
        provenance[COMMAND] = shlex.join(
            ["clearcap", "report", *store.files.option, plan.campaign_id]
            + [word for _, other in others for word in ("--pool", other.campaign_id)]
        )
    for there, each in pool.members:
        source = report_source(there, each)
        provenance |= {f"{name} of {each.campaign_id}": source[name] for name in (OF_PLAN, OF_ROWS)}
    rules = {each.campaign_id: stopping_rule(each, there) for there, each in pool.members}
    ends = [campaign_end(each, there) for there, each in pool.members]
    return replace(
        spec,
        title=f"{spec.title}, pooled",
        campaign=" + ".join(pool.ids),
        header={"Pooled from": text, **spec.header},
        provenance=provenance,
        requested=sum(there.end(each) for there, each in pool.members),
        replay="",  # of which campaign, and by which number, follows from the header
        stop=" ".join(f"{name}: {rule}" for name, rule in rules.items() if rule),
        ended=max(ends) if all(ends) else "",
    )


def pooled_analysis(members: Sequence[Member]) -> Analysis:
    """Return the content of the report of several campaigns as one; SpecError if they cannot be pooled."""
    pool = pooled(members)
    spec = pooled_spec(pool)
    with refusals_of(" + ".join(pool.ids)):
        return analyse(read_samples(pooled_rows(pool), spec), spec, **_beside_rows(pool))


def pooled_report(members: Sequence[Member], kinds: Collection[str] = USUAL) -> dict[str, str]:
    """Write the report of several campaigns as one into a folder of the first; return path or URL of each file."""
    pool = pooled(members)
    with tempfile.TemporaryDirectory(prefix="clearcap-report-") as temporary:
        with refusals_of(" + ".join(pool.ids)):
            written = write_report(
                pooled_rows(pool), pooled_spec(pool), Path(temporary), kinds=kinds, **_beside_rows(pool)
            )
        return put_report(members[0][0], pooled_folder(pool.ids), written)


def pooled_folder(ids: Sequence[str]) -> str:
    """Return the folder of the report of several campaigns, relative to the store."""
    own, *others = ids
    name = "+".join(others)
    if len(name) > LONGEST:
        name = f"{len(others)}-others-{hashlib.sha256(name.encode()).hexdigest()[:10]}"
    return f"{own}/{POOLED}/{name}"


def written_pool(store: str, campaigns: Sequence[str]) -> dict[str, str]:
    """Write the report of several campaigns as `pooled_report` does, as a job, which gets the address of the store."""
    opened = open_store(store, QUICK)
    return pooled_report([(opened, opened.plan(each)) for each in campaigns])


def possible_members(store: str, campaign: str, others: Sequence[str]) -> dict[str, Any]:
    """Return, as a job, ``seed`` of a campaign, why nothing is pooled with it (``refusal``), and ``others``.

    Of each there are ``campaign``, ``seed``, ``samples`` and ``refusal``.
    """
    opened = open_store(store, QUICK)
    own, found = (opened, opened.plan(campaign)), []
    seed = own[1].spec.seed
    try:
        _check_sampler(own[1])
    except SpecError as error:
        return {"seed": seed, "refusal": str(error).removeprefix("pool: "), "others": []}
    for other in others:
        plan = opened.plan(other)  # an error here is the answer: this one would be kept without the campaign
        told = {"campaign": other, "seed": plan.spec.seed, "samples": plan.spec.samples, "refusal": ""}
        try:
            pooled([own, (opened, plan)])
        except SpecError as error:
            told["refusal"] = str(error).removeprefix("pool: ")
        found.append(told)
    return {"seed": seed, "refusal": "", "others": found}


def _beside_rows(pool: Pool) -> dict[str, Any]:
    """Return how spreads change rows, the repeats of all, and the runs that decide what one of them left open."""
    # of one campaign alone: two that aim at the same limits would be shown as if one refined the other
    decided = next((found for found in (decisions(*each) for each in pool.members) if found), ())
    repeats = [repeats_of(*each) for each in pool.members]
    return {"spreads": other_spreads(pool.members[0][1]), "repeats": _joined(repeats, pool.firsts), "decided": decided}


def _joined(repeats: Iterable[Repeats], firsts: Sequence[int]) -> Repeats:
    """Return the repeats of all campaigns, numbered as one sample."""
    each = [replace(part, sample=part.sample + first) for part, first in zip(repeats, firsts, strict=True)]
    names = list(dict.fromkeys(name for part in each for name in part.values))
    none = np.zeros(0)
    return Repeats(
        np.concatenate([part.sample for part in each]),
        np.concatenate([part.ok for part in each]),
        {name: np.concatenate([part.values.get(name, none) for part in each]) for name in names},
        sum(part.planned for part in each),
    )
