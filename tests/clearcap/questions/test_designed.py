"""A designed campaign, end to end: from its file through sampler and store to total indices, and questions to it."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from campaign.coordinator.rerun import rerun_batch
from campaign.inputs.sampling import sampler_named
from campaign.spec.load import load_campaign
from campaign.worker.messages import CampaignAddress
from clearcap.questions.report import report, report_spec
from clearcap.questions.whatif import what_if
from tests.campaign import fake_engine
from tests.campaign.driving import computed
from tests.reporting.models import ISHIGAMI_FIRST, ISHIGAMI_TOTAL, ishigami_of

NAMES = ("J1", "J2", "J3")
VARIABLES = "".join(f'[variables.{name}]\ndistribution = "uniform"\nlower = 0.02\nupper = 0.12\n\n' for name in NAMES)
FIXED = '[variables.preload]\ntarget = "springs.A3.preload"\ndistribution = "constant"\nvalue = 0.95\n\n'
HEAD = 'format = 1\nname = "demo"\nmechanism = "c60"\nsampler = "saltelli"\nseed = 7\nsamples = {}\n\n'
LIMITS = "[responses.FC-1]\nlsl = 8.0\nusl = 40.0\n"


def ishigami(fails_above, mechanism, values, **settings):
    """Return runs whose responses are Ishigami's function of J1 to J3, from 20 on; fail where J1 is above a value."""
    x = np.array([(values[name] - 0.07) / 0.05 * np.pi for name in NAMES])
    run = fake_engine.simulate(mechanism, values)
    if values["J1"] > fails_above:
        return fake_engine.simulate(mechanism, values, status="not_converged", message="residual 1e-3")
    run.responses.update(dict.fromkeys(run.responses, 20.0 + float(ishigami_of(x[None])[0])))
    return run


def designed(tmp_path, rows):
    """Return a campaign of a design with so many rows."""
    path = tmp_path / "designed.toml"
    path.write_text(HEAD.format(5 * rows) + VARIABLES + FIXED + LIMITS)
    return load_campaign(str(path))


def influences(store, plan):
    """Return what the campaign's report says of FC-1's variables, and its notes."""
    content = json.loads(Path(report(store, plan)["json"]).read_text())
    found = next(r for r in content["responses"] if r["spec"]["name"] == "FC-1")["sensitivity"]
    return {i["variable"]: i for i in found["influences"]}, found["notes"]


@pytest.mark.slow
def test_total_indices_of_a_campaign(tmp_path):
    """Ishigami's known indices come back; the constant beside the variables is no part of the design."""
    store, plan = computed(tmp_path / "runs", designed(tmp_path, 1024), 1000, partial(ishigami, 1.0))
    assert report_spec(plan).designed == NAMES
    found, notes = influences(store, plan)
    assert [found[name]["total"] for name in NAMES] == pytest.approx(ISHIGAMI_TOTAL, abs=0.03)
    assert [found[name]["first_order"] for name in NAMES] == pytest.approx(ISHIGAMI_FIRST, abs=0.03)
    for name, right in zip(NAMES, ISHIGAMI_TOTAL, strict=True):
        low, high = found[name]["total_interval"]
        assert low < right < high
    assert found["preload"]["total"] is None
    assert any(note.startswith("Variables that act together with others: J1 explains") for note in notes)


@pytest.mark.slow
def test_a_hole_is_closed_by_a_rerun(tmp_path):
    """One run fails: no total indices, and its number; once it is computed again they are there."""
    asked = designed(tmp_path, 64)
    whole, _ = computed(tmp_path / "a", asked, 100, partial(ishigami, 1.0))
    limit = sorted(set(whole.table()["J1"].to_pylist()))[-2]
    store, plan = computed(tmp_path / "b", asked, 100, partial(ishigami, limit))
    failed = [row["sample"] for row in store.table().to_pylist() if row["status"] != "ok"]
    assert failed
    found, notes = influences(store, plan)
    assert found["J1"]["total"] is None
    assert found["J1"]["first_order"] is not None
    assert f"{len(failed)} of the design's 320 samples have no value (sample {failed[0]}" in notes[-1]
    address = CampaignAddress.of(store, plan, partial(ishigami, 1.0))
    for batch in {sample // 100 for sample in failed}:
        rerun_batch(address, batch, tuple(sample for sample in failed if sample // 100 == batch))
    assert influences(store, plan)[0]["J1"]["total"] is not None


def test_a_longer_design_takes_over_the_rows_of_a_shorter_one(tmp_path):
    """Twice the rows: the first half is there already, to the bit."""
    store, short = computed(tmp_path / "runs", designed(tmp_path, 32), 40)
    rows = store.table(short.campaign_id)
    store, longer = computed(tmp_path / "runs", designed(tmp_path, 64), 40)
    assert store.table(longer.campaign_id).slice(0, 160).equals(rows)


def test_questions_go_to_the_draws_alone(tmp_path):
    """Weights are for draws by themselves: mean and count are those of A and B, the mixed runs are left out."""
    store, plan = computed(tmp_path / "runs", designed(tmp_path, 256), 500, partial(ishigami, 1.0))
    table = store.table()
    own = sampler_named("saltelli").independent(plan.spec, table["sample"].to_numpy())
    found = what_if(store, plan, ["J1.upper=0.12"])["FC-1"]
    assert own.sum() == 512
    assert found.effective == pytest.approx(512)
    assert found.mean.value == pytest.approx(table["FC-1"].to_numpy()[own].mean(), rel=1e-12)
