"""``clearcap report``: what cannot be written ends in an exit status that a script sees."""

import json
import subprocess
import sys
from functools import partial

import pytest

from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store.store import comparisons
from clearcap.questions.report import report
from tests.campaign import fake_engine
from tests.campaign.commands import clearcap_here
from tests.campaign.driving import computed
from tests.campaign.store.test_store import fill


def test_a_pdf_without_weasyprint_is_refused(store, plan, capsys, monkeypatch):
    """Not a line and status 0, after which a script looks for a file that is not there."""
    monkeypatch.setattr("reporting.write.find_spec", lambda name: None)
    status, _, said = clearcap_here(capsys, monkeypatch, "report", plan.campaign_id, "--store", store.url, "--pdf")
    assert status == 1
    assert "pip install 'clearcap[pdf]'" in said
    assert not store.files.exists(f"{plan.campaign_id}/report/report.html")


def test_a_summary_is_written_beside_the_report(store, plan, capsys, monkeypatch):
    """Only when it is asked for; with --pdf on paper too."""
    words = ("report", plan.campaign_id, "--store", store.url, "--no-excel", "--json")
    kinds = {}
    for options in ((), ("--summary",)):
        status, printed, _ = clearcap_here(capsys, monkeypatch, *words, *options)
        assert status == 0
        kinds[options] = json.loads(printed)["report"]
    assert set(kinds["--summary",]) - set(kinds[()]) == {"summary"}
    assert kinds["--summary",]["summary"].endswith("summary.html")


@pytest.mark.processes
def test_a_report_loads_no_dask(store, plan):
    """Not even to say whether enough runs are ok: dask takes longer to load than the rows."""
    words = ["clearcap", "report", plan.campaign_id, "--store", store.url, "--no-excel"]
    code = f"import sys; sys.argv = {words}\nfrom clearcap.cli import main\ntry:\n    main()\nfinally:\n    "
    code += "print('loaded', 'dask' in sys.modules or 'distributed' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "loaded False"


@pytest.fixture
def others(either_store, plan, campaign_file):
    """Return two other campaigns of the store that holds the plan; all have rows."""
    plans = [make_plan(load_campaign(str(campaign_file), seed=seed), 25) for seed in (8, 9)]
    for other in plans:
        either_store.create_plan(other)
        fill(either_store, other, [0])
    fill(either_store, plan)
    return plans


def test_a_pooled_report(either_store, plan, others, capsys, monkeypatch):
    """One of three campaigns, in a folder of its own; pooled or compared, not both."""
    name, ids = plan.campaign_id, [other.campaign_id for other in others]
    words = ("report", name, "--no-excel", "--json", "--store", either_store.url, "--pool", ids[0], "--pool", ids[1])
    status, printed, _ = clearcap_here(capsys, monkeypatch, *words)
    written = json.loads(printed)
    assert (status, written["pool"]) == (0, ids)
    assert written["report"]["json"] == either_store.files.address(f"{name}/pooled/{'+'.join(ids)}/capability.json")
    status, _, said = clearcap_here(capsys, monkeypatch, *words, "--against", ids[0])
    assert (status, "--against, --pool" in said) == (2, True)


def test_a_pool_has_enough_ok_runs_together(tmp_path, campaign_file, capsys, monkeypatch):
    """The exit status is that of all samples, and the run to look at is one that failed."""

    def member(samples, seed, simulate):
        return computed(tmp_path / "runs", load_campaign(str(campaign_file), samples=samples, seed=seed), 500, simulate)

    fails = partial(fake_engine.raises_above, 0.07)
    (store, few), (_, many) = member(25, 7, fails), member(2000, 8, fake_engine.simulate)
    report, pool = ("report", "--no-excel", "--store", store.url), ("--pool", few.campaign_id)
    assert clearcap_here(capsys, monkeypatch, *report, few.campaign_id)[0] == 1
    assert clearcap_here(capsys, monkeypatch, *report, many.campaign_id, *pool)[0] == 0
    assert clearcap_here(capsys, monkeypatch, *report, few.campaign_id, "--pool", many.campaign_id)[0] == 0
    _, ok = member(20, 9, fake_engine.simulate)
    status, _, said = clearcap_here(capsys, monkeypatch, *report, ok.campaign_id, *pool)
    assert (status, f"replay {few.campaign_id}" in said) == (1, True)


@pytest.mark.slow
def test_comparisons_are_documents_of_their_own(either_store, plan, others, capsys, monkeypatch):
    """Neither the campaign's own report nor another comparison is replaced; status says which there are."""
    name, first, second = plan.campaign_id, *(other.campaign_id for other in others)
    report(either_store, plan, kinds=["json"])
    own = either_store.files.read(f"{name}/report/capability.json")
    assert comparisons(either_store, name) == {}
    words = ("report", name, "--no-excel", "--json", "--store", either_store.url)
    status, printed, _ = clearcap_here(capsys, monkeypatch, *words, "--against", first[:-1])
    written = json.loads(printed)
    assert (status, written["against"], set(written["report"])) == (0, first, {"html", "json", "parquet"})
    assert written["report"]["json"] == either_store.files.address(f"{name}/comparisons/{first}/capability.json")
    before = either_store.files.read(f"{name}/comparisons/{first}/capability.json")
    report(either_store, plan, kinds=["json"], against=second)
    assert either_store.files.read(f"{name}/report/capability.json") == own
    assert either_store.files.read(f"{name}/comparisons/{first}/capability.json") == before
    names = ["capability.json", "capability.parquet", "report.html"]
    assert comparisons(either_store, name) == {first: names, second: [names[0], names[2]]}
    content = json.loads(before)
    assert (content["comparison"]["campaign"], content["comparison"]["samples"]) == (first, 25)
    assert content["replay"] == f"clearcap replay --store {either_store.url} {name}"
    assert content["provenance"]["command of this report"].endswith(f" --against {first}")
    assert "--against" not in json.loads(own)["provenance"]["command of this report"]
    _, printed, _ = clearcap_here(capsys, monkeypatch, "status", name, "--json", "--store", either_store.url)
    folders = {other: either_store.files.address(f"{name}/comparisons/{other}") for other in (first, second)}
    assert json.loads(printed)["comparisons"] == folders
    _, printed, _ = clearcap_here(capsys, monkeypatch, "status", name, "--store", either_store.url)
    assert f"  compared with {first}: {folders[first]}" in printed.splitlines()


@pytest.mark.slow
def test_a_summary_on_paper(store, plan, capsys, monkeypatch):
    """Both documents as PDF."""
    pytest.importorskip("weasyprint")
    words = ("report", plan.campaign_id, "--store", store.url, "--no-excel", "--summary", "--pdf")
    assert clearcap_here(capsys, monkeypatch, *words)[0] == 0
    for name in ("report.pdf", "summary.pdf"):
        assert store.files.read(f"{plan.campaign_id}/report/{name}").startswith(b"%PDF")
