"""Questions to a store: the command's numbers to the bit, kept, computed once, refused as data."""

import asyncio
import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from campaign.errors import CampaignError, SpecError, StoreError
from campaign.plan import make_plan
from campaign.samples import independent_samples
from campaign.spec.load import load_campaign
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from clearcap.cli import app
from clearcap.questions.whatif import change_of
from clearcap.web.jobs import queries
from clearcap.web.jobs.pool import JobPool
from clearcap.web.jobs.queries import (
    AskedRows,
    QueryService,
    advice_answer,
    allocation_answer,
    comparison_answer,
    histogram_answer,
    rows_version,
    what_if_answer,
)
from reporting.tolerance.reweighting import weights
from tests.campaign import fake_engine
from tests.clearcap.web.running import until_true

pytestmark = pytest.mark.bits

NARROWER = ["J1.std=0.016"]
BEYOND = "preload.upper=1.5"
COSTS = "[variables.J1]\ncost = 1.0\n[variables.preload]\ncost = 2.0\n"


@pytest.fixture(scope="module")
def pooled(storage):
    """Return an event loop and a pool of one process, kept for all tests of this module: starting one takes seconds."""
    with asyncio.Runner() as runner:
        pool = JobPool(1)
        runner.run(pool.__aenter__())
        yield runner, pool
        runner.run(pool.__aexit__(None, None, None))


@pytest.fixture
def asked(pooled, folder):
    """Return what runs a coroutine function with the answers of a store."""
    runner, pool = pooled
    return lambda store, question: runner.run(question(QueryService(pool, store, folder)))


def said(*words):
    """Return the document that the command prints."""
    return json.loads(CliRunner().invoke(app, [*words, "--json"]).stdout)


@pytest.mark.processes
def test_the_numbers_are_those_of_the_command(filled, asked):
    """The answer is the command's document, to the last bit of each number."""
    store, plan = filled
    narrower = json.loads(asked(store, lambda a: a.ask("u", what_if_answer, [plan.campaign_id], NARROWER, False)))
    assert narrower == said("whatif", plan.campaign_id, "--set", NARROWER[0], "--store", store.url)
    assert narrower["responses"]["FC-1"]["cpk"]["value"] > 0
    assert "preview" not in narrower


@pytest.mark.processes
def test_refusals_and_advice_are_those_of_the_command(filled, asked, tmp_path):
    """And what smaller tolerances cost."""
    store, plan = filled
    place, name = ["--store", store.url], plan.campaign_id
    costs = tmp_path / "costs.toml"
    costs.write_text(COSTS)

    async def ask(answers):
        return [
            await answers.ask("u", what_if_answer, [name], [BEYOND], False),
            await answers.ask("u", advice_answer, [name]),
            await answers.ask("u", allocation_answer, [name], COSTS),
        ]

    refused, advised, allocated = (json.loads(each) for each in asked(store, ask))
    assert refused == said("whatif", name, "--set", BEYOND, *place)
    assert refused["refused"][0]["runs"] > 100
    assert set(refused["refused"][0]["responses"]) == set(plan.mechanism.responses)
    assert advised == said("advise", name, *place)
    assert allocated == said("advise", name, "--cost", str(costs), *place)


@pytest.mark.processes
def test_an_answer_is_kept_until_the_rows_change(growing, asked, monkeypatch):
    """Its bytes and its name stay; with new rows it is another."""
    store, plan, compute = growing
    compute(0, 1, 2, 3)
    name = plan.campaign_id

    async def ask(answers):
        first = await answers.ask("u", what_if_answer, [name], NARROWER, False)
        with monkeypatch.context() as nobody_computes:
            nobody_computes.setattr(answers._pool, "run", None)
            again = await answers.ask("v", what_if_answer, [name], NARROWER, False)
        assert again is first
        other = await answers.ask("u", what_if_answer, [name], ["J1.std=0.017"], False)
        compute(4)
        answers._versions.clear()  # a second or two later
        later = await answers.ask("u", what_if_answer, [name], NARROWER, False)
        assert len({first, other, later}) == 3
        return first, later

    counts = [json.loads(each)["responses"]["FC-1"] for each in asked(store, ask)]
    assert [each["n"] + each["dropped"] for each in counts] == [200, 250]


@pytest.mark.processes
def test_equal_questions_at_once_are_computed_once(filled, asked, monkeypatch):
    """Fifty users ask the same: one job. Who goes away does not end it for the others."""
    store, plan = filled

    async def ask(answers):
        jobs, run = [], answers._pool.run

        async def counted(*words):
            jobs.append(words)
            return await run(*words)

        monkeypatch.setattr(answers._pool, "run", counted)
        asking = (answers.ask(f"user {n}", what_if_answer, [plan.campaign_id], NARROWER, False) for n in range(50))
        tasks = [asyncio.create_task(each) for each in asking]
        await until_true(lambda: jobs, "a job")
        tasks[0].cancel()
        found = await asyncio.gather(*tasks[1:])
        assert len(set(found)) == 1
        return len(jobs)

    assert asked(store, ask) == 1


@pytest.mark.processes
def test_a_question_that_nobody_waits_for_is_ended(filled, asked, monkeypatch):
    """Its place is free at once, and the next who asks it is answered."""
    store, plan = filled

    async def ask(answers):
        begun, run = asyncio.Event(), answers._pool.run

        async def noted(*words):
            begun.set()
            return await run(*words)

        monkeypatch.setattr(answers._pool, "run", noted)
        task = asyncio.create_task(answers.ask("u", what_if_answer, [plan.campaign_id], NARROWER, False))
        await begun.wait()
        assert answers._pool.turns.running == 1
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        return await answers.ask("u", what_if_answer, [plan.campaign_id], NARROWER, False)

    assert json.loads(asked(store, ask))["responses"]


WRONG = (
    ([], "no --set is given"),
    (["J9.std=1"], "J9"),
    (["J1.std=-1"], "must be greater than 0"),
    (["J1.std=1"] * 300, "allowed: up to 200"),
    (["J1.std=" + "1" * 2000], "of up to 1000"),
)


@pytest.mark.processes
def test_a_wrong_question_is_the_commands_error(filled, asked):
    """The words are the same, and the next question is answered."""
    store, plan = filled

    async def ask(answers):
        for settings, words in WRONG:
            with pytest.raises(SpecError, match=words):
                await answers.ask("u", what_if_answer, [plan.campaign_id], settings, False)
        return await answers.ask("u", what_if_answer, [plan.campaign_id], NARROWER, False)

    assert asked(store, ask)


@pytest.mark.processes
def test_a_campaign_that_is_not_there_or_empty_is_one_error(growing, asked):
    """And remembered for nobody."""
    store, plan, compute = growing

    async def ask(answers):
        with pytest.raises(StoreError, match="no campaign"):
            await answers.ask("u", what_if_answer, ["nobody-0123456789"], NARROWER, False)
        with pytest.raises(CampaignError, match="no sample is computed yet"):
            await answers.ask("u", what_if_answer, [plan.campaign_id], NARROWER, False)
        compute(0, 1, 2, 3)
        answers._versions.clear()
        return await answers.ask("u", what_if_answer, [plan.campaign_id], NARROWER, False)

    assert asked(store, ask)


@pytest.mark.processes
def test_two_campaigns_are_compared(own_filled, asked, campaign_file):
    """A campaign with another, and not with itself."""
    store, plan = own_filled
    campaign_file.write_text(campaign_file.read_text().replace("mean = 0.07", "mean = 0.08"))
    other = make_plan(load_campaign(str(campaign_file)), 25)
    store.create_plan(other)
    run_batch(CampaignAddress.of(store, other, fake_engine.simulate), BatchRequest(0))

    async def ask(answers):
        with pytest.raises(SpecError, match="is the campaign itself"):
            await answers.ask("u", comparison_answer, [plan.campaign_id, plan.campaign_id])
        return await answers.ask("u", comparison_answer, [plan.campaign_id, other.campaign_id])

    found = json.loads(asked(store, ask))
    assert found["campaign"] == plan.campaign_id
    assert found["comparison"]["campaign"] == other.campaign_id
    assert found["comparison"]["responses"][0]["mean_difference"] < 0


@pytest.fixture
def rows(filled, folder):
    """Return what names the rows to a worker."""
    store, plan = filled
    queries._opened.cache_clear()
    return AskedRows(store.url, plan.campaign_id, rows_version(store, plan.campaign_id), str(folder))


def test_a_preview_takes_the_first_samples_and_says_so(rows, monkeypatch):
    """It is exact, and says nothing, where these are all."""
    exact = what_if_answer(rows, tuple(NARROWER), False)
    assert what_if_answer(rows, tuple(NARROWER), True) == exact
    monkeypatch.setattr(queries, "PREVIEW_ROWS", 300)
    preview = what_if_answer(rows, tuple(NARROWER), True)
    assert preview["preview"] == {"rows": 300, "of": 400}
    found = preview["responses"]["FC-1"]
    assert found["n"] + found["dropped"] == 300
    assert histogram_answer(rows, "FC-1", (), True)["preview"] == {"rows": 300, "of": 400}
    assert what_if_answer(rows, tuple(NARROWER), False) == exact


def test_bins_before_and_after(filled, rows):
    """Both count the samples with a value; after the change they follow the weights; limits are edges."""
    store, plan = filled
    found = histogram_answer(rows, "FC-1", tuple(NARROWER), False)
    columns = independent_samples(store, plan)
    y = columns.values["FC-1"]
    weight = weights(change_of(plan, columns, NARROWER)).weight
    finite = np.isfinite(y)
    assert sum(found["before"]) == finite.sum()
    assert sum(found["after"]) == pytest.approx(finite.sum())
    inside = (y[finite] >= found["edges"][3]) & (y[finite] < found["edges"][4])
    share = weight[finite][inside].sum() / weight[finite].sum()
    assert found["after"][3] == pytest.approx(share * finite.sum())
    assert (found["lsl"], found["usl"]) == (9.0, 16.0)
    assert found["unit"] == plan.mechanism.response_units()["FC-1"]
    assert histogram_answer(rows, "FC-1", (), False)["after"] is None
    refused = histogram_answer(rows, "FC-1", ("J1.std=0.0001",), False)
    assert refused["after"] is None
    assert "are worth" in refused["refusal"]
    with pytest.raises(SpecError, match="FC-1"):
        histogram_answer(rows, "FC-9", (), False)


def test_a_worker_keeps_what_it_has_opened(rows, monkeypatch):
    """The second question reads neither plan nor columns; other rows are opened anew."""
    what_if_answer(rows, tuple(NARROWER), False)
    monkeypatch.setattr(queries, "open_store", lambda *_: pytest.fail("the store is opened"))
    what_if_answer(rows, ("J1.std=0.017",), False)
    with pytest.raises(pytest.fail.Exception):
        what_if_answer(replace(rows, version="0" * 64), tuple(NARROWER), False)
