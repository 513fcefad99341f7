"""The plan: same campaign, same id; anything a row depends on, another id."""

import json
import re

import pytest
import tomli_w

from campaign.errors import StoreError
from campaign.plan import Plan, make_plan
from campaign.spec.load import load_campaign


def test_same_campaign_same_id(campaign, campaign_file):
    """The id depends on content alone: not on batches, comments or how numbers are written."""
    text = campaign_file.read_text()
    campaign_file.write_text("# a comment\n" + text.replace("0.07", "7e-2").replace("lower = 0.9", "lower = 0.90"))
    again = load_campaign(str(campaign_file))
    assert make_plan(again, 3).campaign_id == make_plan(campaign, 10).campaign_id


@pytest.mark.parametrize(
    ("old", "new"),
    [("samples = 25", "samples = 26"), ("seed = 7", "seed = 8"), ("0.0175", "0.0176"), ('"c60"', '"own.toml"')],
)
def test_another_campaign_another_id(campaign, campaign_file, old, new):
    """Samples, seed, distributions and the mechanism's content are part of the id."""
    own = campaign.mechanism.model_copy(update={"title": "own"})
    content = own.model_dump(mode="json", by_alias=True, exclude_none=True)
    (campaign_file.parent / "own.toml").write_text(tomli_w.dumps(content))
    before = make_plan(campaign).campaign_id
    campaign_file.write_text(campaign_file.read_text().replace(old, new))
    assert make_plan(load_campaign(str(campaign_file))).campaign_id != before


def test_another_content_of_the_mechanism_another_id(campaign, campaign_file):
    """A file of the same name with another number in it is another mechanism."""
    content = campaign.mechanism.model_dump(mode="json", by_alias=True, exclude_none=True)
    campaign_file.write_text(campaign_file.read_text().replace('"c60"', '"own.toml"'))
    ids = set()
    for step in (content["simulation"]["step"], 0.5 * content["simulation"]["step"]):
        content["simulation"]["step"] = step
        (campaign_file.parent / "own.toml").write_text(tomli_w.dumps(content))
        ids.add(make_plan(load_campaign(str(campaign_file))).campaign_id)
    assert len(ids) == 2


def test_another_build_another_id(campaign, monkeypatch):
    """Rows of two builds never meet in one campaign."""
    before = make_plan(campaign).campaign_id
    monkeypatch.setattr("campaign.plan.row_build", lambda: "another")
    assert make_plan(campaign).campaign_id != before


@pytest.mark.parametrize(("samples", "size", "expected"), [(1, None, 1), (500, None, 12), (30_850, None, 100)])
def test_default_batches(campaign_file, samples, size, expected):
    """A fortieth of the samples, at least 1, at most 100; every sample in exactly one batch."""
    plan = make_plan(load_campaign(str(campaign_file), samples=samples), size)
    assert plan.batches[0][1] == expected
    assert [s for first, count in plan.batches for s in range(first, first + count)] == list(range(samples))


@pytest.mark.parametrize(
    ("samples", "seconds", "expected"),
    [(30_850, 0.0073, 771), (1_000_000, 0.0073, 1369), (1_000_000, 20.0, 1), (1_000_000, 1e-9, 10_000)],
)
def test_a_batch_takes_about_ten_seconds(campaign_file, samples, seconds, expected):
    """And holds no more than a fortieth of the samples, nor more rows than a worker keeps in memory."""
    campaign = load_campaign(str(campaign_file), samples=samples)
    assert make_plan(campaign, seconds_per_run=seconds).batches[0] == (0, expected)


def test_json_holds_everything(plan):
    """A plan read back is the plan, mechanism included."""
    again = Plan.from_json(plan.to_json())
    assert again == plan
    assert again.schema.equals(plan.schema, check_metadata=True)


def test_schema_has_units(plan):
    """Every number has its unit in the field, and the table says whose it is."""
    units = {field.name: (field.metadata or {}).get(b"unit") for field in plan.schema}
    assert plan.schema.names[:4] == ["sample", "J1", "preload", "FC-1"]
    expected = {
        "J1": b"mm",
        "preload": b"rad",
        "FC-1": b"N",
        "FC-2": b"mm",
        "wall_s": b"s",
        "max_penetration": b"mm",
        "max_created_energy": b"mJ",
        "created_energy": b"mJ",
        "max_lost_energy": b"mJ",
        "lost_energy": b"mJ",
        "max_kinetic_energy": b"mJ",
        "max_turn": b"rad",
        "start_travel": b"mm",
    }
    assert expected.items() <= units.items()
    assert plan.schema.metadata[b"campaign"].decode() == plan.campaign_id


def test_changed_plan_is_refused(plan):
    """A plan whose content does not match its id was tampered with."""
    content = json.loads(plan.to_json())
    content["spec"]["seed"] = 8
    with pytest.raises(StoreError, match="changed after it was written"):
        Plan.from_json(json.dumps(content))


@pytest.mark.parametrize(
    "text", ["", "{}", "[]", *(f'{{"format": {n}}}' for n in (2, 3, 4)), '{"format": 1, "spec": {}}']
)
def test_unreadable_plan_is_refused(text):
    """What is no plan is said to be none."""
    with pytest.raises(StoreError, match=r"plan\.json"):
        Plan.from_json(text)


@pytest.mark.parametrize(("sampler", "same"), [("random", True), ("sobol", False), ("halton", False)])
def test_order_of_variables_counts_where_samples_depend_on_it(campaign_file, sampler, same):
    """Dimensions of evenly spread samplers are numbered; random streams are named."""
    text = campaign_file.read_text().replace("seed = 7", f'seed = 7\nsampler = "{sampler}"')
    head, *variables = re.split(r"(?=^\[)", text, flags=re.MULTILINE)
    ids = set()
    for ordered in (variables, [variables[1], variables[0], *variables[2:]]):
        campaign_file.write_text("".join([head, *ordered]))
        ids.add(make_plan(load_campaign(str(campaign_file))).campaign_id)
    assert len(ids) == (1 if same else 2)
