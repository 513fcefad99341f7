"""What reporting is told of a campaign, where the report goes, and what its head, its drawing and a comparison say."""

import getpass
import json
import secrets
import shlex
import tomllib
from functools import partial
from pathlib import Path

import pytest

from campaign.coordinator.state import write_state
from campaign.errors import CampaignError, SpecError
from campaign.json_values import json_values
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from clearcap.questions.plan_differences import plan_differences
from clearcap.questions.report import (
    author,
    campaign_end,
    comparison_document,
    mechanism_drawing,
    report,
    report_date,
    report_spec,
)
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
    monkeypatch.setattr("clearcap.questions.report.report_rows", lambda store, plan: [rows])
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


def test_the_author_is_the_campaigns_else_the_headers_else_who_submitted_it(campaign_file, tmp_path):
    """The nearest to a signature wins."""
    texts = {"": getpass.getuser(), '[header]\nAuthor = "quality lab"\n': "quality lab"}
    plain = campaign_file.read_text()
    for i, (added, expected) in enumerate(texts.items()):
        campaign_file.write_text(plain + added)
        store, plan = computed(tmp_path / str(i), load_campaign(str(campaign_file)), 25)
        assert author(plan, store) == expected
    campaign_file.write_text(plain.replace("samples", 'author = "A. Author <x>"\nsamples'))
    store, plan = computed(tmp_path / "named", load_campaign(str(campaign_file)), 25)
    assert author(plan, store) == "A. Author <x>"
    assert "<dd>A. Author &lt;x&gt;</dd>" in Path(report(store, plan)["html"]).read_text()


@pytest.mark.parametrize("content", [{}, {"user": 7}, {"user": None}])
def test_an_author_that_nobody_knows_is_empty(store, plan, content):
    """A store of an earlier version has no submission; a broken one names nobody."""
    store.write_json(plan.campaign_id, "submission.json", content)
    assert author(plan, store) == ""


@pytest.mark.parametrize("state", [{}, {"state": "running", "since": 0}, {"state": "completed", "since": "x"}])
def test_a_campaign_has_an_end_when_it_is_completed(store, plan, state):
    """Not while it runs, and not if the store does not say when."""
    store.write_json(plan.campaign_id, "state.json", state)
    assert campaign_end(plan, store) == ""
    store.write_json(plan.campaign_id, "state.json", {"state": "completed", "since": 1_763_856_000.5})
    assert campaign_end(plan, store) == "2025-11-23 00:00 UTC"


def test_the_date_of_a_report_can_be_given(monkeypatch):
    """As reproducible builds give it."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    assert report_date() == "1970-01-01 00:00 UTC"
    for wrong in ("", "-1", "noon", "1e9", "9" * 30):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", wrong)
        with pytest.raises(SpecError, match="SOURCE_DATE_EPOCH"):
            report_date()


@pytest.mark.slow
def test_two_reports_differ_in_their_date_alone(campaign, tmp_path, monkeypatch):
    """All files are equal bit for bit, but for the one place of the page and of the JSON where the date stands."""
    store, plan = computed(tmp_path, campaign, 25)
    write_state(store, plan.campaign_id, "completed")
    files = []
    for date in ("0", "0", "86400"):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", date)
        files.append({kind: Path(path).read_bytes() for kind, path in report(store, plan).items()})
    first, again, later = files
    assert first == again
    assert {kind for kind in first if first[kind] != later[kind]} == {"html", "json"}
    for kind in ("html", "json"):
        assert first[kind].count(b"1970-01-01 00:00 UTC") == 1
        assert first[kind].replace(b"1970-01-01 00:00", b"1970-01-02 00:00") == later[kind]
    assert json.loads(first["json"])["ended"].endswith("UTC")


def test_the_page_shows_what_is_measured(store, plan):
    """Every response is marked, or listed with what it is."""
    drawing, note = mechanism_drawing(plan)
    assert (drawing is not None, note) == (True, "")
    page = Path(report(store, plan)["html"]).read_text()
    figure = page.split('id="mechanism"')[1].split("</section>")[0]
    assert ">FC-2</text>" in figure
    assert "10.6 mm here" in figure
    assert "1 if latch_overlap &gt; 0, else 0; not in the picture" in figure
    assert [each.name for each in drawing.legend] == list(plan.mechanism.responses)


def test_a_mechanism_that_cannot_be_drawn_is_said(store, plan, monkeypatch):
    """The report is written without its picture, and says so; the reason is no markup."""

    def fails(*_):
        raise ValueError("no <b>way</b>")

    monkeypatch.setattr("clearcap.questions.report.sketch_mechanism", fails)
    page = Path(report(store, plan)["html"]).read_text()
    assert "The mechanism could not be drawn (ValueError: no &lt;b&gt;way&lt;/b&gt;)." in page
    assert "Can these numbers be trusted?" in page


def both(campaign_file, folder, change):
    """Return a store with a campaign and one whose file has another text, and their plans."""
    store, first = computed(folder, load_campaign(str(campaign_file), samples=200), 100)
    other = campaign_file.parent / "other.toml"
    other.write_text(change(campaign_file.read_text()))
    _, second = computed(folder, load_campaign(str(other), samples=200), 100)
    return store, first, second


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("mean = 0.07", "mean = 0.08"),
        lambda text: text.replace("std = 0.0175", "std = 0.0175\nbatch = {size = 20, std = 0.01}"),
    ],
)
def test_the_numbers_are_those_of_the_report(campaign_file, tmp_path, change):
    """Of a shifted mean, and of a campaign with production batches against one without."""
    store, first, second = both(campaign_file, tmp_path / "runs", change)
    found = comparison_document(store, first, second)
    written = report(store, first, kinds=("json",), against=second.campaign_id)
    expected = json.loads(Path(written["json"]).read_text(encoding="utf-8"))["comparison"]
    compared = json.loads(json.dumps(json_values(found["comparison"])))
    assert found["campaign"] == first.campaign_id
    assert compared["campaign"] == second.campaign_id
    for mine, said in zip(compared["responses"], expected["responses"], strict=True):
        for key in ("response", "mean_difference", "mean_interval", "std_ratio", "cpk_difference", "histogram"):
            assert mine[key] == said[key]
    assert compared["responses"][0]["mean_difference"] is not None


def test_what_differs_in_the_plans_comes_first(campaign_file, tmp_path):
    """What changes rows, of the mechanism too, before limits and titles; a key that only one has; equal keys never."""
    store, first, second = both(
        campaign_file,
        tmp_path / "runs",
        lambda text: text.replace("mean = 0.07", "mean = 0.08").replace('name = "demo"', 'name = "demo"\ntitle = "B"'),
    )
    found = plan_differences(store, first.campaign_id, store, second.campaign_id)
    assert [(each.key, each.here, each.there, each.changes_rows) for each in found] == [
        ("variables.J1.mean", 0.07, 0.08, True),
        ("title", "", "B", False),
    ]
    assert plan_differences(store, first.campaign_id, store, first.campaign_id) == []
    moved = load_campaign({**tomllib.loads(campaign_file.read_text()), "preset": "latch12", "seed": 8})
    elsewhere, third = computed(tmp_path / "elsewhere", moved, 25)
    keys = [each.key for each in plan_differences(store, first.campaign_id, elsewhere, third.campaign_id)]
    assert "mechanism.parameters.latch_angle" in keys
    assert "preset" in keys
    assert keys.index("seed") < keys.index("mechanism.parameters.latch_angle")  # a long mechanism cannot cut it off


def test_corners_are_not_compared(campaign_file, tmp_path):
    """They do not represent production."""
    store, first = computed(tmp_path / "runs", load_campaign(str(campaign_file), samples=200), 100)
    other = campaign_file.parent / "other.toml"
    other.write_text(campaign_file.read_text().replace("seed = 7", 'seed = 7\nsampler = "worst_case"'))
    _, second = computed(tmp_path / "runs", load_campaign(str(other), samples=5), 100)
    with pytest.raises(CampaignError, match="are corners"):
        comparison_document(store, first, second)
