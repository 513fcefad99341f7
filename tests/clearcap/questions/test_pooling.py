"""Campaigns that differ only in their seeds are one report: that of a campaign which had drawn all their samples."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pytest

from campaign.errors import SpecError
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import open_store, read_repeats
from campaign.store.store import repeat_plans
from clearcap.questions.pooling import _joined, pooled, pooled_analysis, pooled_folder, pooled_report, pooled_spec
from clearcap.questions.report import analysis
from reporting.render.data_files import render_json
from reporting.samples import Repeats
from tests.campaign import fake_engine
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed

TABLES = {**tomllib.loads(SPEC), "repeats": {"share": 1.0}}
STICKS = {
    "J1": {"target": "materials.block_slope.friction", "distribution": "uniform", "lower": 0.65, "upper": 0.8},
    "preload": {"target": "materials.block_slope.restitution", "distribution": "constant", "value": 0.0},
}
LOT = {"size": 4, "std": 0.01}


def member(folder, samples, seed, **other):
    """Return a computed campaign: its store and plan."""
    campaign = load_campaign({**TABLES, **other}, samples=samples, seed=seed)
    return computed(folder, campaign, 10, fake_engine.simulate)


def in_one(folder, members, firsts):
    """Return a campaign whose rows, and repeats, are those of several."""
    samples = sum(plan.spec.samples for _, plan in members)
    spec = members[0][1].spec.model_copy(update={"samples": samples})
    campaign = replace(load_campaign(TABLES), spec=spec)
    store, plan = open_store(str(folder)), make_plan(campaign, samples)
    store.create_plan(plan)

    def numbered(tables, schema):
        each = zip(tables, firsts, strict=False)
        moved = [t.set_column(0, t.schema.field("sample"), pc.add(t["sample"], first)) for t, first in each]
        return pa.concat_tables([t.replace_schema_metadata(schema.metadata) for t in moved])

    rows = numbered([store.table(plan.campaign_id) for store, plan in members], plan.schema)
    assert rows.column_names[0] == "sample"
    store.write_part(plan, 0, rows)
    for repeats in repeat_plans(store, plan):
        own = numbered([read_repeats(*each) for each in members], repeats.schema).sort_by("sample")
        for batch, (first, count) in enumerate(repeats.batches):
            part = own.filter(pc.field("sample").isin(repeats.numbers_of(first, first + count)))
            store.write_part(repeats, batch, part)
    return store, plan


@pytest.mark.parametrize("lots", [{}, {"batch": LOT}])
def test_equals_one_campaign_of_all_samples(tmp_path, lots):
    """Every number, text and check of the report; also with lots, where the first campaign ends with one."""
    variables = {**TABLES["variables"], "J1": {**TABLES["variables"]["J1"], **lots}}
    members = [member(tmp_path / str(seed), n, seed, variables=variables) for n, seed in ((24, 7), (31, 8), (16, 9))]
    pool = pooled(members)
    assert pool.firsts == ((0, 24, 56) if lots else (0, 24, 55))
    members = members[:2] if lots else members  # one campaign has no lot that is not full, but the last
    together = json.loads(render_json(pooled_analysis(members)))
    one = json.loads(render_json(analysis(*in_one(tmp_path / "one", members, pool.firsts))))
    of_the_writing = {"title", "campaign", "author", "header", "provenance", "replay", "ended", "written"}
    assert together["header"]["Pooled from"].startswith(f"{len(members)} campaigns")
    assert together["finished"] == sum(plan.spec.samples for _, plan in members)
    assert {k: v for k, v in together.items() if k not in of_the_writing and one[k] != v} == {}
    assert together.keys() == one.keys()


def test_lots_stay_whole(tmp_path):
    """A campaign that ends amid a lot: the next one begins with a lot, and no lot has parts of both."""
    variables = {**TABLES["variables"], "J1": {**TABLES["variables"]["J1"], "batch": LOT}}
    members = [member(tmp_path, 10, seed, variables=variables) for seed in (7, 8)]
    assert pooled(members).firsts == (0, 12)
    drawn = pooled_analysis(members)
    assert drawn.finished == drawn.spec.requested == 20


def test_repeats_that_are_planned_are_those_of_all():
    """Before any is computed, the report says how many are to come."""
    joined = _joined([Repeats(planned=3), Repeats(planned=4)], (0, 10))
    assert (joined.planned, joined.sample.size, joined.values) == (7, 0, {})


@pytest.mark.parametrize(
    ("other", "key"),
    [
        ({"mechanism": "incline", "variables": STICKS, "responses": {}}, r"variables\.J1"),
        ({"responses": {"FC-1": {"lsl": 9.5}}}, r"responses\.FC-1"),
        ({"title": "another"}, "title"),
        ({"simulation": {"horizon": 12.0}}, r"simulation\.horizon"),
        ({"sampler": "importance", "importance": {"components": [{"share": 0.5, "shift": {"J1": 2.0}}]}}, "sampler"),
        ({"variables": dict(reversed(TABLES["variables"].items()))}, "order of their variables"),
    ],
)
def test_plans_that_differ_are_refused(tmp_path, other, key):
    """The message names the first difference."""
    store = open_store(str(tmp_path))
    plans = [make_plan(load_campaign({**TABLES, **more}, seed=seed)) for more, seed in (({}, 7), (other, 8))]
    for plan in plans:
        store.create_plan(plan)
    with pytest.raises(SpecError, match=f"differ in (the )?{key}"):
        pooled([(store, plan) for plan in plans])


def test_same_rows_other_builds_and_one_alone_are_refused(tmp_path):
    """Rows must be independent, and of one build."""
    store = open_store(str(tmp_path))
    one, more, other = (make_plan(load_campaign(TABLES, seed=s, samples=n)) for s, n in ((7, 25), (7, 50), (8, 25)))
    numpy = next(word for word in other.row_build.split(", ") if word.startswith("numpy"))
    for plan in (one, more, other):
        store.create_plan(plan)
    for plans, message in (
        ([one], "alone"),
        ([one, more], "seed = 7"),
        ([one, other, one], "seed = 7"),
        ([one, replace(other, row_build=other.row_build.replace(numpy, "numpy 0.1"))], r"numpy 0\.1"),
        ([replace(one, row_build=""), other], "earlier version"),
    ):
        with pytest.raises(SpecError, match=message):
            pooled([(store, plan) for plan in plans])
    assert pooled([(store, one), (store, other)]).firsts == (0, 25)


@pytest.mark.parametrize("sampler", ["lhs", "sobol", "halton", "worst_case"])
def test_samplers_whose_sets_are_not_one_sample_are_refused(tmp_path, sampler):
    """Points spread evenly, and chosen ones; the message names the sampler."""
    store, tables = open_store(str(tmp_path)), {**TABLES, "sampler": sampler}
    tables |= {"samples": 5} if sampler == "worst_case" else {}
    plans = [make_plan(load_campaign(tables, seed=seed)) for seed in (7, 8)]
    for plan in plans:
        store.create_plan(plan)
    with pytest.raises(SpecError, match=f'sampler = "{sampler}"'):
        pooled([(store, plan) for plan in plans])


def test_files_in_the_first_campaign(tmp_path):
    """In a folder named after the others, beside its own report; they say from what they are."""
    members = [member(tmp_path, 10, seed) for seed in (7, 8)]
    first, second = (plan.campaign_id for _, plan in members)
    files = pooled_report(members, ["json", "html"])
    assert Path(files["json"]).parent == tmp_path / first / "pooled" / second
    content, page = json.loads(Path(files["json"]).read_text()), Path(files["html"]).read_text()
    assert content["provenance"]["seed"] == "7, 8"
    assert content["provenance"]["command of this report"].endswith(f"{first} --pool {second}")
    assert {f"rows digest of {first}", f"rows digest of {second}"} <= content["provenance"].keys()
    assert "Pooled from" in page
    assert f"{second} (seed 8, 10 samples, from number 10)" in page
    assert len(pooled_folder(["x-0123456789"] * 100)) < 255


def test_no_command_pools_two_stores(tmp_path):
    """So the report of campaigns in two stores names none."""
    members = [member(tmp_path / str(seed), 10, seed) for seed in (7, 8)]
    assert "command of this report" not in pooled_spec(pooled(members)).provenance
