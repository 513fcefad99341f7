"""A campaign's rows become the file of one that aims at rejects."""

import numpy as np
import pytest
import tomli_w
from scipy.special import ndtri
from scipy.stats import norm

from campaign.errors import CampaignError, SpecError
from campaign.inputs.sampling import sampler_named
from campaign.inputs.sampling.inverse_transform import uniforms
from campaign.spec.load import load_campaign
from campaign.store import open_store
from clearcap.questions.decision import aimed_campaign
from clearcap.questions.report import report_spec
from reporting.rare.rare_rejects import rare_rejects
from reporting.samples import read_samples
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed, submit

SIGMA = np.hypot(0.004, 2 * 0.02)  # of the stand-in's FC-1 = 10 + J1 + 2 preload
NORMAL = """
[variables.J1]
distribution = "normal"
mean = 0.07
std = 0.004

[variables.preload]
target = "springs.A3.preload"
distribution = "normal"
mean = 0.95
std = 0.02

[responses.FC-1]
"""


def pilot(tmp_path, limits, samples=200, **keys):
    """Return a campaign of two normal variables, whose response is their sum."""
    head = f'format = 1\nname = "demo"\nmechanism = "c60"\nsamples = {samples}\nseed = 7\n'
    head += "".join(f"{key} = {value}\n" for key, value in keys.items())
    path = tmp_path / "pilot.toml"
    path.write_text(head + NORMAL + limits)
    return load_campaign(str(path))


def aimed_at(tmp_path, store, plan, samples, **options):
    """Return the campaign that aims with the rows of a plan, read from a file of its own."""
    path = tmp_path / "aimed.toml"
    path.write_text(tomli_w.dumps(aimed_campaign(store, plan, samples, **options).tables))
    return load_campaign(str(path))


@pytest.mark.slow
def test_from_plain_runs_to_one_ppm_and_again(tmp_path):
    """200 plain runs, 1,000 that aim, 1,000 that aim by those: the exact share of a sum, to a few percent."""
    limits = f"lsl = {11.97 - 4.5 * SIGMA}\nusl = {11.97 + 4.753424 * SIGMA}\n"
    store, plan = computed(tmp_path / "runs", pilot(tmp_path, limits), 100)
    for seed in (8, 9):
        asked = aimed_at(tmp_path, store, plan, 1000)
        assert (asked.spec.name, asked.spec.seed, asked.spec.samples) == ("demo-rare", seed, 1000)
        assert len(asked.spec.importance.components) == 3
        store, plan = computed(tmp_path / "runs", asked, 200)
    [shift] = {tuple(c.shift) for c in asked.spec.importance.components if c.shift}
    assert shift == ("J1", "preload")
    assert "rejects" in asked.spec.importance.components[0].source
    spec = report_spec(plan, store)
    [found] = rare_rejects(read_samples(store.table(plan.campaign_id), spec), spec, 0.95).responses
    assert found.above.ppm == pytest.approx(1.0, rel=4 * found.above.standard_error)
    assert found.below.ppm == pytest.approx(1e6 * norm.sf(4.5), rel=4 * found.below.standard_error)
    assert found.total.standard_error < 0.12


def test_scores_are_those_that_were_drawn(tmp_path):
    """Of independent samples the normal scores of their uniform numbers, whatever the distributions."""
    spec = pilot(tmp_path, "usl = 20.0\n").spec
    for sampler in ("random", "sobol"):
        other = spec.model_copy(update={"sampler": sampler})
        scores = sampler_named(sampler).scores(other, 3, 5)
        assert list(scores) == ["J1", "preload"]
    assert sampler_named("random").scores(spec, 3, 5)["J1"] == pytest.approx(ndtri(uniforms(7, "J1", 3, 5)))


@pytest.mark.slow
def test_what_cannot_be_aimed_at(tmp_path):
    """No rows, no limits, an unknown response, samples that nothing has drawn, production batches."""
    store = open_store(str(tmp_path / "runs"))
    with pytest.raises(CampaignError, match="no sample is computed yet"):
        aimed_campaign(store, submit(store, pilot(tmp_path, "usl = 12.0\n"), 100), 100)
    with pytest.raises(SpecError, match=r"FC-2.*FC-1"):
        aimed_campaign(store, store.plan(store.campaigns()[0]), 100, ("FC-2",))
    with pytest.raises(SpecError, match="no response has limits"):
        aimed_campaign(store, submit(store, pilot(tmp_path, ""), 100), 100)
    path = tmp_path / "grid.toml"
    grid = '"grid"\ngrid = { J1 = 5, preload = 5 }'
    path.write_text(SPEC.replace("samples = 25", f"samples = 25\nsampler = {grid}"))
    store, plan = computed(tmp_path / "grid", load_campaign(str(path)), 25)
    with pytest.raises(SpecError, match="sampler grid"):
        aimed_campaign(store, plan, 100)
    path.write_text(SPEC.replace("upper = 1.0", "upper = 1.0\nbatch = { size = 5, std = 0.001 }"))
    store, plan = computed(tmp_path / "lots", load_campaign(str(path)), 25)
    with pytest.raises(SpecError, match=r"\bbatch"):
        aimed_campaign(store, plan, 100)


def test_a_file_without_defaults(tmp_path):
    """The file says what the pilot's file said, and no more."""
    store, plan = computed(tmp_path / "runs", pilot(tmp_path, "usl = 12.2\n"), 100)
    tables = aimed_campaign(store, plan, 500).tables
    assert set(tables) == {*("format", "name", "mechanism", "samples", "seed", "sampler", "importance")} | {
        *("variables", "responses")
    }
    assert tables["variables"]["J1"] == {"distribution": "normal", "mean": 0.07, "std": 0.004}
