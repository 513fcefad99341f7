"""A sampler is one object: whoever adds one and lists it has a campaign file, rows and a report that know it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from campaign.errors import SpecError, StoreError
from campaign.inputs.sampling import SAMPLERS, check_sampling, draw, sampler_named
from campaign.inputs.sampling.inverse_transform import InverseTransformSampler, uniforms
from campaign.plan import Plan
from campaign.plan_header import seal_plan
from campaign.spec.campaign_file import CampaignSpec, campaign_schema
from campaign.spec.load import load_campaign
from clearcap.questions.report import report, report_spec
from tests.campaign import fake_engine
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed
from tests.each import each

pytestmark = pytest.mark.bits

DOCS = (Path(__file__).parents[4] / "docs" / "campaign.md").read_text()


class Antithetic(InverseTransformSampler):
    """Every second sample mirrors the one before it."""

    name = "antithetic"
    summary = "random samples in mirrored pairs"
    report = "Antithetic pairs: means are known better than the intervals say."
    not_extendable = "pairs are complete"

    def check(self, inputs):
        """Refuse half a pair."""
        if inputs.samples % 2:
            raise ValueError(f"samples = {inputs.samples}: sampler antithetic draws pairs; write an even number")

    def uniforms(self, inputs, names, first, count):
        """Return u and 1 - u in turn."""
        number = np.arange(first, first + count)
        pairs = {name: uniforms(inputs.seed, name, first // 2, count // 2 + 1) for name in names}
        return {name: np.where(number % 2, 1.0 - u[number // 2 - first // 2], u[number // 2 - first // 2])
                for name, u in pairs.items()}  # fmt: skip


@pytest.fixture
def antithetic(monkeypatch):
    """List one more sampler."""
    monkeypatch.setitem(SAMPLERS, "antithetic", Antithetic())


def written(tmp_path, **keys):
    """Return the path of the demonstration campaign with other keys."""
    lines = [f"{key} = {json.dumps(value)}" for key, value in keys.items()]
    head = [line for line in SPEC.splitlines() if line.split(" = ")[0] not in keys]
    path = tmp_path / "demo.toml"
    path.write_text("\n".join([*lines, *head]))
    return str(path)


@pytest.mark.slow
def test_following_the_recipe_is_enough(antithetic, tmp_path):
    """One object and its line in the registry: the file names it, rows are drawn, the report says what they are."""
    campaign = load_campaign(written(tmp_path, sampler="antithetic", samples=24))
    drawn = draw(campaign.spec, 0, 24)["preload"]  # uniform on [0.9, 1.0]
    assert drawn[::2] + drawn[1::2] == pytest.approx(1.9)
    assert draw(campaign.spec, 7, 9)["preload"].tobytes() == drawn[7:16].tobytes()
    store, plan = computed(tmp_path / "runs", campaign, 10, fake_engine.simulate)
    assert store.table()["preload"].to_pylist() == drawn.tolist()
    files = report(store, plan)
    content = json.loads(Path(files["json"]).read_text())
    assert content["sampler"] == "antithetic"
    assert content["design"] == {"production": True, "text": Antithetic.report}
    assert Antithetic.report in Path(files["html"]).read_text()
    assert "antithetic" in campaign_schema()["properties"]["sampler"]["enum"]


def test_what_the_sampler_refuses_is_refused(antithetic, tmp_path):
    """Its own check, and what follows from what it says of itself."""
    with pytest.raises(SpecError, match="samples = 25"):
        load_campaign(written(tmp_path, sampler="antithetic"))
    stop = '\n[stop]\nresponse = "FC-1"\nstatistic = "mean"\nhalf_width = 1.0\n'
    path = Path(written(tmp_path, sampler="antithetic", samples=24))
    path.write_text(path.read_text() + stop)
    with pytest.raises(SpecError, match=r"\bstop: "):
        load_campaign(str(path))


def test_an_unknown_sampler_is_refused_everywhere(campaign, plan, tmp_path):
    """No name falls through to another sampler: in the file, in a plan, in a spec that nobody checked."""
    with pytest.raises(SpecError, match=r"sampler = .sobl."):
        load_campaign(written(tmp_path, sampler="sobl"))
    content = json.loads(plan.to_json())
    content["spec"]["sampler"] = "sobl"
    with pytest.raises(StoreError, match=r"plan\.json cannot be read"):
        Plan.from_json(seal_plan({key: value for key, value in content.items() if key not in ("format", "sha256")}))
    with pytest.raises(ValidationError, match="'random', 'lhs'"):
        CampaignSpec.model_validate(content["spec"])
    unchecked = campaign.spec.model_copy(update={"sampler": "sobl"})
    text = r"sampler = .sobl.: no such sampler; allowed: random, lhs, .*list; did you mean 'sobol'?"
    for refuse in (
        lambda: sampler_named("sobl"),
        lambda: draw(unchecked, 0, 1),
        lambda: check_sampling(unchecked),
        lambda: report_spec(replace(plan, spec=unchecked)),
    ):
        with pytest.raises(ValueError, match=text):
            refuse()


@each("name", SAMPLERS)
def test_every_sampler_says_what_it_is(name):
    """In the documentation, in the schema of the campaign file, and in the report."""
    sampler = sampler_named(name)
    assert f"- `{name}`: " in DOCS
    assert sampler.report.endswith(".")
    assert (
        sampler.production
        or "not a production" in sampler.report
        or "need not represent a production" in sampler.report
    )
