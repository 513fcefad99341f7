"""An importance campaign, end to end: from its file through store, resumption and rerun to its columns."""

import json
from pathlib import Path

import numpy as np
import pytest
from jsonschema import validate

from campaign.coordinator.heartbeat import Progress
from campaign.coordinator.rerun import rerun_batch
from campaign.errors import SpecError
from campaign.inputs.sampling import draw, sampler_named
from campaign.samples import independent_samples, lots_of
from campaign.spec.load import load_campaign
from campaign.worker.messages import CampaignAddress
from clearcap.questions.report import report
from reporting.render.data_files import report_schema
from tests.campaign import fake_engine
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed, rows, start

TABLE = """
[[importance.components]]
share = 0.6
shift = { J1 = 3.0 }

[[importance.components]]
share = 0.2
scale = 2.0
"""


def written(tmp_path, text=SPEC, samples=25):
    """Return the demonstration campaign with importance sampling."""
    path = tmp_path / "rare.toml"
    path.write_text(text.replace("samples = 25", f'samples = {samples}\nsampler = "importance"') + TABLE)
    return load_campaign(str(path))


@pytest.mark.slow
@pytest.mark.processes
def test_rows_are_the_same_however_they_are_computed(tmp_path):
    """Batches of 3 on two workers, of 10 in this process, and a longer campaign: components and weights to the bit."""
    asked = written(tmp_path)
    by_workers = rows(*start(tmp_path / "a", asked))
    store, plan = computed(tmp_path / "b", asked, 10)
    assert by_workers.equals(rows(store, plan))
    store, longer = computed(tmp_path / "b", written(tmp_path, samples=40), 7)
    assert rows(store, longer).slice(0, 25).equals(rows(store, plan))
    table = store.table(plan.campaign_id)
    own = sampler_named("importance").own_columns(plan.spec, np.arange(25))
    assert table["component"].to_pylist() == own["component"].tolist()
    assert table["log_weight"].to_pylist() == own["log_weight"].tolist()
    assert table["aimed"].to_pylist() == own["aimed"].tolist()
    assert table["J1"].to_pylist() == draw(plan.spec, 0, 25)["J1"].tolist()


@pytest.mark.slow
def test_failed_runs_have_weights_and_reruns_keep_them(tmp_path):
    """A run that fails is a row with its weight; computed again, it has the same one."""
    asked = written(tmp_path)
    store, plan = computed(tmp_path / "runs", asked, 10, simulate=_fails)
    before = store.table()
    failed = [row["sample"] for row in before.to_pylist()[:10] if row["status"] != "ok"]
    assert failed
    assert before["log_weight"].null_count == 0
    rerun_batch(CampaignAddress.of(store, plan, fake_engine.simulate), 0, tuple(failed[:1]))
    after = store.table()
    assert after["status"][failed[0]].as_py() == "ok"
    for name in ("component", "log_weight"):
        assert after[name].to_pylist() == before[name].to_pylist()


def _fails(mechanism, values, **settings):
    """Fail where J1 is large."""
    status = "jammed" if values["J1"] > 0.08 else "ok"
    return fake_engine.simulate(mechanism, values, status=status, message="" if status == "ok" else "stuck")


def test_questions_go_to_production_alone(tmp_path):
    """What-if, advice and the progress take the samples that are drawn from the distributions themselves."""
    store, plan = computed(tmp_path / "runs", written(tmp_path, samples=200), 50)
    table = store.table()
    nominal = table["component"].to_numpy() == 0
    assert 20 < nominal.sum() < 60
    samples = independent_samples(store, plan)
    assert lots_of(plan, samples.number) is None
    progress = Progress(store, plan, store.survey(plan))
    assert progress.moments["FC-1"].n == nominal.sum()
    assert samples.values["J1"].tolist() == table["J1"].to_numpy()[nominal].tolist()


def test_columns_keep_their_names(tmp_path):
    """A variable may not have the name of a column that the sampler adds; other samplers do not mind."""
    text = SPEC.replace("variables.preload", "variables.component")
    with pytest.raises(SpecError, match=r"variables\.component"):
        written(tmp_path, text)
    path = tmp_path / "plain.toml"
    path.write_text(text)
    assert "component" in load_campaign(str(path)).spec.variables


def test_its_report_has_the_rare_rejects(tmp_path):
    """From the file to capability.json, which fits its schema: weighted shares, and all else over the plain runs."""
    text = SPEC.replace("usl = 16.0", "usl = 12.08")
    store, plan = computed(tmp_path / "runs", written(tmp_path, text, samples=400), 100)
    content = json.loads(Path(report(store, plan)["json"]).read_text())
    validate(content, report_schema())
    table = store.table()
    nominal = table["component"].to_numpy() == 0
    assert content["used"] == content["rare"]["plain"] == nominal.sum()
    [rare] = content["rare"]["responses"]
    rejects = table["FC-1"].to_numpy() > 12.08
    assert rare["total"]["ppm"] == pytest.approx(1e6 * np.mean(rejects * np.exp(table["log_weight"].to_numpy())))
    assert rare["total"]["rejects"] == rejects.sum() > nominal[rejects].sum()
