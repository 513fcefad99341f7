"""The header of a plan: read quickly, it agrees with the plan, and every reader refuses a file that was changed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from campaign.batches import Batches
from campaign.errors import StoreError
from campaign.plan import Plan, make_plan
from campaign.plan_header import parse_plan, plan_repeats, repeated_samples, seal_plan, usual_share
from campaign.spec.load import load_campaign
from campaign.spec.result_columns import results_schema
from tests.campaign.conftest import SPEC
from tests.campaign.store.test_store import fill
from tests.each import each

EARLIER = (Path(__file__).parent / "earlier_plans" / "old-b2ff31c7a0" / "plan.json").read_text()
LISTED = (Path(__file__).parent / "earlier_plans" / "format_2.json").read_text()  # the same plan
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
@each("text", [EARLIER, LISTED])
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


def test_earlier_plans_are_the_same_plan():
    """Listed batches are read as their rule, with a digest or without, and are written by it from then on."""
    first, second = Plan.from_json(EARLIER), Plan.from_json(LISTED)
    assert first == second == Plan.from_json(first.to_json())
    assert first.batches == Batches(12, 5)
    assert ('"batch_size": 5,' in first.to_json(), '"batches"' in first.to_json()) == (True, False)


def test_batches_without_a_rule():
    """A list that no version has written is held and written as it is."""
    plan = replace(Plan.from_json(LISTED), batches=((0, 3), (3, 9)))
    for read in READERS:
        again = read(plan.to_json())
        assert (again[0] if isinstance(again, tuple) else again).batches == ((0, 3), (3, 9))
    assert [plan.batches_before(end) for end in (0, 1, 3, 4, 12)] == [0, 1, 1, 2, 2]
    assert plan.batch_numbers(np.arange(5)).tolist() == [0, 0, 0, 1, 1]


@each("size", [0, -5, 13, 5.0, True, None, "5", [5], 10**30])
def test_a_batch_size_that_is_none(size):
    """Refused though its digest fits, as is another size under the digest of this one."""
    document = json.loads(Plan.from_json(LISTED).to_json()) | {"batch_size": size}
    for read in READERS:
        with pytest.raises(StoreError, match=r"plan\.json cannot be read: (its batches|a number of samples)"):
            read(seal_plan({key: document[key] for key in document if key not in ("format", "sha256")}))
        with pytest.raises(StoreError, match="changed after it was written"):
            read(as_text(document))


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


@given(st.integers(1, 60_000), st.floats(0.0, 1.0), st.floats(2.0**-52, 2e-3))
@example(60_000, 0.0, 2.0**-52)
@example(60_000, 0.9995, 0.0005)
def test_repeats_are_those_of_their_places(samples, low, share):
    """Whether they are found one after the other or all samples are looked at."""
    high = min(low + share, 1.0)
    places = [((s * 0x9E3779B97F4A7C15 + 0x4F1BBCDCBFA53E0A) % 2**64 >> 11) / 2**53 for s in range(samples)]
    expected = [s for s, place in enumerate(places) if low <= place < high]
    assert repeated_samples(samples, low, high).tolist() == expected


def test_every_beginning_has_its_share():
    """However early a campaign stops, about the share of its samples is repeated."""
    for share in (0.03, 0.05, 0.2, 0.9):
        chosen = repeated_samples(10_000, 0.0, share)
        for stopped in (100, 333, 1000, 5000, 10_000):
            assert abs(np.count_nonzero(chosen < stopped) - share * stopped) < 2.5
    assert repeated_samples(10_000, 0.0, 1.0).tolist() == list(range(10_000))
    assert repeated_samples(10_000, 0.0, 0.0).size == 0


def test_more_keep_what_there_is():
    """A larger share and more samples add repeats and drop none; shares beyond the first take the others."""
    few, many = repeated_samples(3_000_000, 0.0, 0.001), repeated_samples(3_000_000, 0.0, 0.0013)
    assert set(few.tolist()) < set(many.tolist())
    assert np.array_equal(few[few < 1000], repeated_samples(1000, 0.0, 0.001))
    added = repeated_samples(3_000_000, 0.001, 0.0013)
    assert sorted([*few.tolist(), *added.tolist()]) == many.tolist()


def test_no_design_is_in_step_with_it():
    """Samplers repeat a pattern every so many samples; the repeats meet all its places alike."""
    chosen = repeated_samples(100_000, 0.0, 0.05)
    for width in (2, 3, 8, 9, 13, 16, 21, 34, 64):
        counts = np.bincount(chosen % width, minlength=width)
        assert counts.min() > 0.9 * chosen.size / width


@each(("samples", "repeats"), [(1, 0), (20, 1), (60, 3), (100, 5), (400, 20), (500, 20), (1000, 30), (5000, 150)])
def test_usual_share(samples, repeats):
    """3 %, but up to 5 % to get twenty: with twice the steps a tenth of the campaign's time."""
    assert usual_share(samples) <= 0.05
    assert abs(repeated_samples(samples, 0.0, usual_share(samples)).size - repeats) <= 1


def test_usual_share_of_many_samples():
    """300 repeats are enough, however long the campaign is."""
    assert abs(repeated_samples(1_000_000, 0.0, usual_share(1_000_000)).size - 300) <= 2


def test_batches_follow_those_of_the_campaign(plan):
    """Each batch of repeats belongs to one batch of the campaign, and the sets hold each repeat once."""
    sets = plan_repeats(plan, (0.1, 0.1, 0.5))
    assert [repeats.folder for repeats in sets] == ["repeats-1", "repeats-3"]
    numbers = sorted(number for repeats in sets for number in repeats.numbers)
    assert numbers == repeated_samples(25, 0.0, 0.5).tolist()
    for repeats in sets:
        for (first, count), batch in zip(repeats.batches, repeats.campaign_batches, strict=True):
            begin, size = plan.batches[batch]
            assert all(begin <= number < begin + size for number in repeats.numbers_of(first, first + count))
            assert repeats.batches[repeats.batch_of(batch)] == (first, count)
        assert sum(count for _, count in repeats.batches) == len(repeats.numbers)


def test_share_of_a_plan(tmp_path):
    """The file's share, the usual one without it, none with weights; a plan of an earlier version has none."""
    path = tmp_path / "demo.toml"
    shares = []
    for added in ("", "[repeats]\nshare = 0.4\n", "[repeats]\nshare = 0\n"):
        path.write_text(SPEC.replace("[variables.J1]", f"{added}[variables.J1]", 1))
        plan = make_plan(load_campaign(str(path)), 10)
        assert type(plan).from_json(plan.to_json()).repeats == plan.repeats
        shares.append(plan.repeats)
    assert shares == [0.05, 0.4, 0.0]
    aimed = 'sampler = "importance"\n[[importance.components]]\nshare = 0.5\nscale = 2.0\n[variables.J1]'
    path.write_text(SPEC.replace("[variables.J1]", aimed, 1))
    assert make_plan(load_campaign(str(path)), 10).repeats == 0.0
