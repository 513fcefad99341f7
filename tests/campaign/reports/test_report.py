"""What reporting is told of a campaign, and where the report goes."""

import json
import secrets
import shlex
from functools import partial
from pathlib import Path

import pytest

from campaign.errors import CampaignError
from campaign.plan import make_plan
from campaign.reports.report import report, report_spec
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from tests.campaign import fake_engine
from tests.campaign.driving import computed


def test_spec_says_limits_units_and_origin(plan):
    """Every response with unit and limits, every variable with its requested distribution."""
    spec = report_spec(plan)
    assert (spec.title, spec.campaign, spec.requested) == ("demo", plan.campaign_id, 25)
    assert [response.name for response in spec.responses] == list(plan.mechanism.responses)
    first, second = (next(r for r in spec.responses if r.name == name) for name in ("FC-1", "FC-2"))
    assert (first.unit, first.lsl, first.usl, first.target, first.source) == ("N", 9.0, 16.0, None, "a test")
    assert (second.unit, second.lsl, second.usl, second.target, second.source) == ("mm", None, None, None, "")
    clearance, preload = spec.variables
    assert (clearance.name, clearance.unit, clearance.lower, clearance.upper) == ("J1", "mm", 0.01, 0.13)
    assert clearance.distribution == "truncated normal, mean 0.07, sd 0.0175, between 0.01 and 0.13"
    assert (preload.unit, preload.mean, preload.std) == ("rad", 0.95, pytest.approx(0.1 / 12**0.5))
    assert spec.provenance["seed"] == "7"
    assert spec.provenance["step"].endswith(" ms")
    assert spec.provenance["engine build"] == plan.engine_build


def test_report_says_how_to_repeat_a_failed_run(campaign_file, tmp_path):
    """The command of a failed sample sets keys of the mechanism, not names of variables, and the campaign's horizon."""
    campaign_file.write_text(
        campaign_file.read_text().replace("[variables.J1]", "[simulation]\nhorizon = 12.5\n\n[variables.J1]")
    )
    plan = make_plan(load_campaign(str(campaign_file)), 25)
    store = open_store(str(tmp_path / "runs"))
    store.create_plan(plan)
    run_batch(CampaignAddress.of(store, plan, partial(fake_engine.raises_above, 0.07)), BatchRequest(0))
    table = store.table()
    written = report(store, plan)
    failures = json.loads(Path(written["json"]).read_text())["failures"]
    assert 0 < len(failures) < 25
    for failure in failures:
        row = table.slice(failure["sample"], 1).to_pylist()[0]
        assert shlex.split(failure["command"]) == [
            *("clearcap", "simulate", "c60", "--horizon", "12.5"),
            *("--set", f"J1={row['J1']!r}", "--set", f"springs.A3.preload={row['preload']!r}"),
        ]


@pytest.mark.parametrize(("setting", "words"), [("", []), ("step = 1e-3", ["--step", "0.001"])])
def test_command_names_only_what_the_campaign_changes(campaign_file, setting, words):
    """A step the campaign does not give stays the mechanism's: naming it would switch off its adaptive steps."""
    campaign_file.write_text(
        campaign_file.read_text().replace("[variables.J1]", f"[simulation]\n{setting}\n[variables.J1]")
    )
    spec = report_spec(make_plan(load_campaign(str(campaign_file))))
    assert shlex.split(spec.simulate) == ["clearcap", "simulate", "c60", *words]
    assert [variable.key for variable in spec.variables] == ["J1", "springs.A3.preload"]


def test_command_names_the_preset():
    """A run of the campaign in free fall falls freely when it is repeated."""
    spec = report_spec(make_plan(load_campaign("c60_paper")))
    assert shlex.split(spec.simulate) == ["clearcap", "simulate", "c60", "--preset", "paper"]


@pytest.mark.parametrize("kind", ["folder", "memory"])
def test_report_lies_in_the_store(plan, tmp_path, kind):
    """In a folder the report is written in place, behind a URL it is uploaded; paths and URLs lead to it."""
    store = open_store(str(tmp_path) if kind == "folder" else f"memory://{secrets.token_hex(4)}")
    store.create_plan(plan)
    for batch in range(3):
        run_batch(CampaignAddress.of(store, plan, fake_engine.simulate), BatchRequest(batch))
    written = report(store, plan)
    content = store.files.read(f"{plan.campaign_id}/report/{Path(written['html']).name}").decode()
    assert plan.campaign_id in content
    json.loads(store.files.read(f"{plan.campaign_id}/report/{Path(written['json']).name}"))
    if kind == "folder":
        assert Path(written["html"]).read_text() == content
    else:
        assert written["html"].startswith("memory://")


def test_error_of_reporting_is_for_the_user(store, plan, monkeypatch):
    """What reporting refuses ends in one message."""
    rows = plan.schema.empty_table().drop_columns(["status"])
    monkeypatch.setattr("campaign.reports.report.report_rows", lambda store, plan: [rows])
    with pytest.raises(CampaignError, match=f"report of {plan.campaign_id}"):
        report(store, plan)


def test_a_running_campaign_gets_a_provisional_report(plan, tmp_path):
    """With one of three batches there, every number is called provisional; with none, there is a page all the same."""
    store = open_store(str(tmp_path))
    store.create_plan(plan)
    page = Path(report(store, plan)["html"]).read_text()
    assert "0 of 25 requested samples are computed" in page.replace("\u202f", "")
    run_batch(CampaignAddress.of(store, plan, fake_engine.simulate), BatchRequest(1))
    written = report(store, plan)
    content = json.loads(Path(written["json"]).read_text())
    assert (content["requested"], content["finished"]) == (25, 10)
    assert "every number below is provisional" in Path(written["html"]).read_text()


def test_a_page_has_the_distributions_and_the_advice_of_the_campaign(plan, tmp_path):
    """What only the campaign knows reaches the page: probabilities asked for, batches, how far a spread may grow."""
    store = open_store(str(tmp_path))
    store.create_plan(plan)
    for batch in range(3):
        run_batch(CampaignAddress.of(store, plan, fake_engine.simulate), BatchRequest(batch))
    spec = report_spec(plan, store)
    x, p = zip(*spec.variables[0].cdf, strict=True)
    assert p == pytest.approx(plan.spec.variables["J1"].cdf(x))
    assert spec.replay == f"clearcap replay --store {store.url} {plan.campaign_id}"
    content = json.loads(Path(report(store, plan)["json"]).read_text())
    assert content["replay"] == spec.replay
    assert {each["variable"] for each in content["advice"]} == {"J1", "preload"} or content["advice_note"]


@pytest.mark.slow
def test_the_advice_of_the_page_knows_production_lots(campaign_file, tmp_path):
    """Four lots say nothing of how far a spread may grow, however many samples they have; 20 lots do."""
    for size, refused in ((100, True), (20, False)):
        path = campaign_file.parent / f"lots{size}.toml"
        batch = f"std = 0.0175\nbatch = {{size = {size}, std = 0.01}}"
        path.write_text(campaign_file.read_text().replace("std = 0.0175", batch))
        store, plan = computed(tmp_path / f"s{size}", load_campaign(str(path), samples=400), 200)
        content = json.loads(Path(report(store, plan)["json"]).read_text())
        advice = {each["variable"]: each for each in content["advice"]}
        assert bool(advice["J1"]["refusal"]) == refused, content["advice_note"]
        assert (advice["J1"]["interval"][0] is None) == refused
