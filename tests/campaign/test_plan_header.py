"""The header of a plan: read quickly, it agrees with the plan, and every reader refuses a file that was changed."""

import json
from pathlib import Path

import pytest

from campaign.errors import StoreError
from campaign.plan import Plan
from campaign.plan_header import parse_plan
from campaign.spec.result_columns import results_schema
from tests.campaign.store.test_store import fill
from tests.each import each

EARLIER = (Path(__file__).parent / "earlier_plans" / "old-b2ff31c7a0" / "plan.json").read_text()
READERS = (parse_plan, Plan.from_json)


def test_header_is_the_plan(store, plan):
    """The quick reading of a plan agrees with the plan."""
    header = store.plan_header(plan.campaign_id)
    assert header.schema.equals(plan.schema, check_metadata=True)
    assert plan.schema.equals(results_schema(plan.mechanism, plan.targets, plan.campaign_id), check_metadata=True)
    assert (header.batches, header.columns, header.samples) == (plan.batches, plan.columns, 25)
    fill(store, plan)
    assert store.survey(header) == store.survey(plan)


def changes(value):
    """Yield other values in the place of one: changed, cut, doubled, reordered, removed from or renamed inside."""
    if isinstance(value, dict):
        for key, entry in value.items():
            rest = {k: v for k, v in value.items() if k != key}
            yield rest
            yield rest | {f"{key}2": entry}
            if rest:
                yield rest | {key: entry} if list(value)[-1] != key else {key: entry} | rest  # reordered
            yield from (value | {key: other} for other in changes(entry))
    elif isinstance(value, list):
        yield [*value, *value[-1:], 0]
        yield value[: len(value) // 2] if value else [0]
        if value[::-1] != value:
            yield value[::-1]
        for place in {0, len(value) // 2, len(value) - 1} if value else ():
            yield from ([*value[:place], other, *value[place + 1 :]] for other in changes(value[place]))
    else:
        yield None if value is not None else 0
        yield {bool: lambda: not value, str: lambda: f"{value}x", type(None): lambda: ""}.get(
            type(value), lambda: value + 1
        )()


def test_every_change_of_a_plan_is_refused():
    """At every key of the document, however deep: by what reads the header as by what reads all of it."""
    document = json.loads(Plan.from_json(EARLIER).to_json())
    assert parse_plan(as_text(document))[1] == document
    count = 0
    for changed in changes(document):
        count += 1
        for read in READERS:
            with pytest.raises(
                StoreError, match=r"^plan\.json .*(restore it, or run in a new store|this version reads)"
            ):
                read(as_text(changed))
    assert count > 500


def as_text(document):
    """Return a document as plan.json has it."""
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


@each("change", [lambda b: b[: len(b) // 2], lambda b: [*b, b[-1]], lambda b: b[::-1], lambda b: []])
@each("text", [EARLIER, Plan.from_json(EARLIER).to_json()])
def test_batches_are_all_samples_once(text, change):
    """Cut to half, doubled, reordered, none: refused, also where there is no digest."""
    document = json.loads(text)
    document["batches"] = change(document["batches"])
    for read in READERS:
        with pytest.raises(StoreError, match="restore it, or run in a new store"):
            read(as_text(document))


def test_a_plan_is_not_made_an_earlier_one(plan):
    """A plan that has lost its digest does not pass as one that never had one."""
    document = json.loads(plan.to_json()) | {"format": 1}
    for lost in (), ("sha256",), ("row_build",):
        changed = {key: value for key, value in document.items() if key not in lost}
        for read in READERS:
            with pytest.raises(StoreError, match="changed after it was written"):
                read(as_text(changed))
    both = {key: value for key, value in document.items() if key not in ("sha256", "row_build")}
    with pytest.raises(StoreError, match="changed after it was written"):
        Plan.from_json(as_text(both))  # its id is none of an earlier version


@pytest.mark.parametrize("key", ["batches", "spec", "schema", "campaign"])
def test_an_earlier_plan_that_is_damaged(key):
    """A plan of format 1 that lacks something, or whose batches have a hole, is refused."""
    content = json.loads(EARLIER)
    del content[key]
    with pytest.raises(StoreError, match=r"plan\.json cannot be read"):
        parse_plan(json.dumps(content))
    with pytest.raises(StoreError, match=r"sample 10\b.*\b5\b"):
        parse_plan(EARLIER.replace("[\n   5,\n   5\n  ],", ""))


def test_an_earlier_plan_with_other_columns():
    """The table of a plan without a digest is that of its mechanism and variables."""
    with pytest.raises(StoreError, match="changed after it was written"):
        Plan.from_json(EARLIER.replace('"unit": "m"', '"unit": "mm"', 1))


@each("number", ["1e999", "NaN", "true", "5.0", '"5"', "null", "[5]", "9" * 5000, "[" * 2000])
def test_numbers_of_an_earlier_plan(number):
    """What is no whole number of samples is refused."""
    with pytest.raises(StoreError, match=r"plan\.json cannot be read"):
        parse_plan(EARLIER.replace("[\n   5,\n   5\n  ]", f"[5, {number}]"))
