"""Weighted runs decide what plain samples leave open: one campaign, one verdict, the same bits every time."""

from contextlib import suppress
from dataclasses import replace
from functools import partial

import pytest
from scipy.integrate import quad
from scipy.stats import truncnorm

from campaign.coordinator.requests import SignedCampaign
from campaign.errors import CampaignError
from campaign.spec.load import load_campaign
from campaign.store.store import repeated_shares
from campaign.worker import messages
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from clearcap.questions.decision import decide, decided_by, plan_decision
from clearcap.questions.report import analysis, report
from clearcap.questions.signing import check_whole, open_archive, signed_files
from clearcap.questions.verification import recomputed, verify_export
from tests.campaign import fake_engine
from tests.campaign.driving import computed, rows
from tests.clearcap.questions.test_verification import export, signoff

JOINT = {"distribution": "truncated_normal", "mean": 0.07, "std": 0.0175, "lower": 0.01, "upper": 0.13}
PLAY = truncnorm(-24 / 7, 24 / 7, 0.07, 0.0175)
# The fake engine's FC-1 is 10 + J1 + 2 J2.
LIMIT = 0.21 + 4.3 * 0.0175 * 5**0.5
JUMP_BELOW = 0.26  # the limit with the second contact


def campaign_with(**tables):
    """Return a campaign of 200 samples whose FC-1 has a limit far out in its tail."""
    return load_campaign(
        {
            **{"format": 1, "name": "tail", "mechanism": "c60", "samples": 200, "seed": 4},
            "variables": {"J1": JOINT, "J2": JOINT},
            "responses": {"FC-1": {"usl": 10.0 + LIMIT}},
            **tables,
        }
    )


def compute(store, plan, simulate=fake_engine.simulate):
    """Compute all batches of a plan in this process."""
    address = CampaignAddress.of(store, plan, simulate, repeated_shares(store, plan))
    for batch in range(len(plan.batches)):
        run_batch(address, BatchRequest(batch))


def test_aimed_runs_decide_what_the_samples_leave_open(tmp_path) -> None:
    """The share beyond the limit is an integral; 200 samples permit a second population."""
    store, plan = computed(tmp_path / "s", campaign_with(), 50)
    before = analysis(store, plan)
    assert [r.spec.name for r in before.responses if r.verdict.certain is False] == ["FC-1"]
    decides, names = plan_decision(store, plan)
    assert (names, decides.spec.samples, decides.spec.sampler) == (("FC-1",), 1250, "importance")
    assert analysis(store, plan).responses[0].verdict == before.responses[0].verdict  # not while runs are missing
    compute(store, decides)
    share = quad(lambda x: PLAY.pdf(x) * PLAY.sf(LIMIT - 2 * x), 0.01, 0.13, limit=500, epsabs=1e-13)[0]
    found = analysis(store, plan)
    rare, verdict = found.rare.responses[0].total, found.responses[0].verdict
    assert rare.interval[0] < 1e6 * share < rare.interval[1]
    assert (verdict.word, verdict.certain, verdict.by) == ("capable", True, "rare rejects")
    assert decides.campaign_id in verdict.assumes
    assert decides.campaign_id in open_page(report(store, plan)["html"])
    assert plan_decision(store, plan) is None
    assert decided_by(store, plan) == ((decides, names),)


def open_page(path: str) -> str:
    with open(path) as file:
        return file.read()


def second_contact(mechanism, values, **settings):
    """FC-1 of one assembly in 1,000 has another contact, half of which take it beyond the limit."""
    run = fake_engine.simulate(mechanism, values, **settings)
    jumps = values["J1"] > PLAY.isf(1e-3)
    return replace(run, responses={**run.responses, "FC-1": run.responses["FC-1"] + (LIMIT - JUMP_BELOW) * jumps})


@pytest.mark.slow
def test_the_same_samples_get_the_same_aimed_runs(tmp_path) -> None:
    """A campaign that is killed and continued, or computed in other batches, is decided by the same rows."""
    tables = []
    for name, batch in (("a", 200), ("b", 30)):
        store, plan = computed(tmp_path / name, campaign_with(), batch, second_contact)
        with suppress(InterruptedError):
            decide(store, plan, partial(killed, store), lambda _: None)
        every = []
        decide(store, plan, lambda decides: every.append(decides) or compute(store, decides, second_contact), len)  # noqa: B023
        assert [each for each, _ in decided_by(store, plan)] == every
        tables.append([rows(store, decides) for decides in every])
    assert len(tables[0]) == len(tables[1]) > 1
    assert all(a.equals(b) for a, b in zip(*tables, strict=True))


def killed(store, plan):
    """Compute the first batch of a plan."""
    address = CampaignAddress.of(store, plan, second_contact, repeated_shares(store, plan))
    run_batch(address, BatchRequest(0))
    raise InterruptedError


@pytest.mark.slow
def test_further_runs_aim_where_the_first_found_rejects(tmp_path) -> None:
    """A contact that the samples did not meet is found by the wide part of the first; the second measures it."""
    store, plan = computed(tmp_path / "s", campaign_with(samples=250), 50, second_contact)
    assert analysis(store, plan).responses[0].capability.ppm_observed == 0.0
    decide(store, plan, lambda decides: compute(store, decides, second_contact), len)
    share = quad(lambda x: PLAY.pdf(x) * PLAY.sf((JUMP_BELOW - x) / 2), PLAY.isf(1e-3), 0.13)[0]
    found = analysis(store, plan)
    first, (second,) = found.rare, found.rare.later
    assert first.responses[0].total.doubt
    low, high = second.responses[0].total.interval
    assert low < 1e6 * share < high
    verdict = found.responses[0].verdict
    assert (verdict.word, verdict.certain) == ("marginal", True)
    assert second.campaign in verdict.assumes
    page = open_page(report(store, plan)["html"])
    assert first.campaign in page
    assert second.campaign in page
    check_whole(store, plan)
    path = tmp_path / "x.zip"
    path.write_bytes(export((store, plan), [signoff(plan.campaign_id, signed_files(store, plan))]))
    assert verify_export(open_archive(path)).faults == []
    assert recomputed(open_archive(path)) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "tables",
    [
        {"decide": {"runs": 0}},
        {"sampler": "lhs"},
        {"responses": {"FC-1": {"usl": 1000.0}}},
        {"samples": 20},
        {"variables": {"J1": JOINT, "J2": {**JOINT, "batch": {"size": 10, "std": 0.002}}}},
    ],
    ids=["no runs", "no random samples", "certain", "no verdict", "production batches"],
)
def test_what_is_decided_or_cannot_be_gets_no_runs(tmp_path, tables) -> None:
    store, plan = computed(tmp_path / "s", campaign_with(**tables), 200)
    assert plan_decision(store, plan) is None
    assert store.campaigns() == [plan.campaign_id]


def test_the_number_of_runs_is_bounded(tmp_path) -> None:
    store, plan = computed(tmp_path / "s", campaign_with(decide={"runs": 300}), 200)
    assert plan_decision(store, plan)[0].spec.samples == 300


def test_rows_of_another_build_get_no_runs_of_this_one(tmp_path, monkeypatch) -> None:
    """One verdict is of one build; a command on an old campaign says so and goes on."""
    store, plan = computed(tmp_path / "s", campaign_with(), 50)
    monkeypatch.setattr(messages, "differences", lambda _: "scipy 1 here, 2 in the plan")
    with pytest.raises(messages.WrongBuild):
        plan_decision(store, plan)
    said = list[str]()
    decide(store, plan, pytest.fail, said.append)
    assert len(said) == 1


@pytest.mark.slow
def test_a_sign_off_covers_the_runs_that_decide(tmp_path) -> None:
    """They are exported beside the rows, and the numbers follow from both; without a part of them nothing is signed."""
    store, plan = computed(tmp_path / "s", campaign_with(), 50)
    decides, _ = plan_decision(store, plan)
    compute(store, decides)
    report(store, plan, kinds=["json"])
    check_whole(store, plan)
    path = tmp_path / "x.zip"
    path.write_bytes(export((store, plan), [signoff(plan.campaign_id, signed_files(store, plan))]))
    assert verify_export(open_archive(path)).faults == []
    assert recomputed(open_archive(path)) == []
    store.files.remove(f"{decides.campaign_id}/parts/part-000000.parquet")
    with pytest.raises(CampaignError, match=f"{decides.campaign_id}: 1 batches have no rows"):
        check_whole(store, plan)
    report(store, plan, kinds=["json"])  # what is left decides nothing
    path.write_bytes(export((store, plan), [signoff(plan.campaign_id, signed_files(store, plan))]))
    assert verify_export(open_archive(path)).faults == []
    store.write_json(plan.campaign_id, "signed.json", {"signer": "ada"})
    (tmp_path / "other").mkdir()
    other, same = computed(tmp_path / "other", campaign_with(), 50)
    other.write_json(same.campaign_id, "signed.json", {"signer": "ada"})
    with pytest.raises(SignedCampaign):
        plan_decision(other, same)
