"""Constants from measurements by the rows of a campaign in a store: by the function, by the command, and back again."""

import json
import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import clearcap
from campaign.errors import CampaignError, SpecError
from campaign.inputs.sampling import draw
from campaign.spec.load import load_campaign
from clearcap.cli import app
from clearcap.questions.calibration import calibrated, load_measurements
from engine import load_mechanism, simulate
from tests.campaign.driving import computed
from tests.house import ROOT

MEASUREMENTS = """
constants = ["J1"]

[discrepancy]
FC-1 = {{ sigma = 0.0 }}
FC-2 = {{ scale = 0.01 }}

[[measurements]]
response = "FC-1"
value = {}
sigma = 0.001
at = {{ {} }}

[[measurements]]
response = "FC-2"
value = {}
sigma = 0.001
at = {{ {} }}
"""


@pytest.fixture
def bench(campaign, tmp_path, monkeypatch):
    """Return the store, the plan and the row whose responses were measured with all but J1 known."""
    monkeypatch.chdir(tmp_path)
    spec = campaign.spec.model_copy(update={"samples": 60})
    store, plan = computed(tmp_path / "runs", replace(campaign, spec=spec), 20)
    row = store.table().to_pandas().iloc[7]
    known = f"preload = {float(row['preload'])!r}"
    (tmp_path / "bench.toml").write_text(MEASUREMENTS.format(float(row["FC-1"]), known, float(row["FC-2"]), known))
    return store, plan, row


def test_a_constant_is_found_again(bench, tmp_path):
    """The rows are linear: the constant of a row follows from its responses; the command says and writes the same."""
    _, plan, row = bench
    found = clearcap.calibrate_campaign("bench.toml", plan.campaign_id)
    (constant,) = found.constants
    assert constant.mean == pytest.approx(row["J1"], abs=4e-3 * constant.prior_std + 2e-3)
    assert constant.std < 0.5 * constant.prior_std
    place = [plan.campaign_id, "bench.toml"]
    printed = CliRunner().invoke(app, ["calibrate", *place, "--output", "posterior.csv"])
    assert printed.exit_code == 0, printed.output
    lines = printed.stdout.splitlines()
    assert lines[0] == found.told[0]
    document = json.loads(CliRunner().invoke(app, ["calibrate", *place, "--json"]).stdout)
    assert document["constants"][0]["mean"] == constant.mean
    # the draws are the distribution of a variable, with every digit
    tables = {**plan.spec.model_dump(mode="json", exclude_none=True), "samples": 50}
    written = tomllib.loads(next(line for line in lines if line.startswith("variables.")))
    tables["variables"]["J1"] = written["variables"]["J1"]
    tables.pop("repeats", None)
    values = draw(load_campaign(tables).spec, 0, 50)["J1"]
    assert set(values) <= set(found.draws["J1"])


def test_values_of_two_benches_are_used_together(bench, campaign, tmp_path):
    """A response of another campaign, of its rows; one that draws other variables is refused."""
    _, plan, row = bench

    def other(name, **changes):
        spec = campaign.spec.model_copy(update={"name": name, "seed": 99, "samples": 60, **changes})
        return computed(tmp_path / "runs", replace(campaign, spec=spec), 20)[1]

    also = other("also")
    known = {"preload": float(row["preload"])}
    tables = {
        "constants": ["J1"],
        "discrepancy": {"FC-1": {"sigma": 0.0}, "FC-2": {"sigma": 0.0}},
        "measurements": [
            {"response": "FC-1", "value": float(row["FC-1"]) + 0.02, "sigma": 0.01, "at": known},
            {"response": "FC-1", "value": float(row["FC-1"]) - 0.02, "sigma": 0.01, "at": known, "campaign": "also"},
        ],
    }
    found = clearcap.calibrate_campaign(tables, plan.campaign_id)
    assert list(found.quality) == list(found.units) == ["FC-1", "FC-1 (also)"]
    assert found.units["FC-1 (also)"] == also.mechanism.response_units()["FC-1"]
    alone = clearcap.calibrate_campaign({**tables, "measurements": tables["measurements"][:1]}, plan.campaign_id)
    (both,), (one,) = found.constants, alone.constants
    assert both.mean == pytest.approx(row["J1"], abs=0.3 * both.prior_std)
    assert both.std < one.std
    variables = dict(campaign.spec.variables)
    variables["J1"] = variables["J1"].model_copy(update={"std": 0.5 * variables["J1"].std})
    other("differs", variables=variables)
    tables["measurements"][1]["campaign"] = "differs"
    with pytest.raises(SpecError, match=r"measurements\.1\.campaign.*J1 differ"):
        clearcap.calibrate_campaign(tables, plan.campaign_id)


def test_faults_are_named(bench):
    """Each fault of the file names its key; an absent file and absent rows say so."""
    _, plan, row = bench
    sound = {"response": "FC-1", "value": float(row["FC-1"]), "sigma": 0.01}
    for tables, key in (
        ({"constants": ["J9"], "measurements": [sound]}, "constants.0"),
        ({"constants": ["J1", "J1"], "measurements": [sound]}, "named twice"),
        ({"constants": ["J1"], "measurements": [{**sound, "response": "FC-9"}]}, "measurements.0.response"),
        ({"constants": ["J1"], "measurements": [{**sound, "sigma": 0.0}]}, "measurements.0.sigma"),
        ({"constants": ["J1"], "measurements": [{**sound, "at": {"J1": 0.05}}]}, "one of the constants"),
        ({"constants": ["J1"], "measurements": [{**sound, "at": {"preload": 9.0}}]}, "beyond the rows"),
        ({"constants": ["J1"], "measurements": [sound], "discrepancy": {"FC-1": {}}}, "discrepancy.FC-1"),
        ({"constants": ["J1"], "measurements": []}, "measurements"),
    ):
        with pytest.raises(SpecError, match=key):
            clearcap.calibrate_campaign(tables, plan.campaign_id)
    with pytest.raises(SpecError, match="cannot be read"):
        clearcap.calibrate_campaign("absent.toml", plan.campaign_id)


def test_few_rows_ask_for_more(campaign, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    computed(tmp_path / "runs", replace(campaign, spec=campaign.spec.model_copy(update={"samples": 12})), 6)
    sound = {"response": "FC-1", "value": 12.0, "sigma": 0.01}
    with pytest.raises(CampaignError, match="compute more"):
        clearcap.calibrate_campaign({"constants": ["J1"], "measurements": [sound]})


def test_variables_of_one_table_vary_together(campaign):
    """Rows of a table stay whole with any sampler, in any order of the variables; what needs scores is refused."""
    tables = {**campaign.spec.model_dump(mode="json", exclude_none=True), "samples": 40}
    first, second = list(tables["variables"])[:2]
    rows = np.linspace(0.03, 0.06, 30)  # clearances of J1
    joint = {"distribution": "empirical", "joint": "bench"}
    tables["variables"][first] = {**joint, "values": rows.tolist()}
    target = tables["variables"][second]["target"]
    tables["variables"][second] = {**joint, "target": target, "values": (1.0 - rows).tolist()}
    for sampler in ("random", "sobol", "lhs", "halton"):
        spec = load_campaign({**tables, "sampler": sampler}).spec
        drawn = draw(spec, 0, 40)
        assert drawn[first] + drawn[second] == pytest.approx(1.0)
        assert len(set(drawn[first])) > 15
        again = draw(spec, 13, 5)
        assert (again[first] == drawn[first][13:18]).all()
    reverse = load_campaign({**tables, "sampler": "random", "variables": dict(reversed(tables["variables"].items()))})
    random = draw(load_campaign({**tables, "sampler": "random"}).spec, 0, 40)
    assert (draw(reverse.spec, 0, 40)[first] == random[first]).all()
    for other, key in (
        ({"sampler": "saltelli"}, "joint"),
        ({"sampler": "importance", "importance": {"components": [{"share": 0.5, "scale": 2.0}]}}, "joint"),
        ({"correlations": [[first, second, 0.5]]}, "correlations"),
    ):
        with pytest.raises(SpecError, match=key):
            load_campaign({**tables, **other})
    tables["variables"][second]["values"] = [0.95, 0.96]
    with pytest.raises(SpecError, match="different numbers of values"):
        load_campaign(tables)


@pytest.mark.slow
def test_the_constants_of_the_c60(tmp_path):
    """The paper's two forces tell two constants of the C-60 that it does not state; the tripping force alone, one.

    The latch angle includes the 12 degrees of the preset latch12, which was fitted by hand.
    """
    folder = ROOT / "docs" / "examples" / "calibration"
    for name in ("c60_contact_force", "c60_trip"):
        store, plan = computed(tmp_path / "runs", load_campaign(str(folder / f"{name}.toml")), 32, simulate)
    both = load_measurements(folder / "c60_bench.toml")
    found = calibrated(store, plan, both)
    spring, latch = found.constants
    assert [words.split(":")[0] for words in found.told] == ["The data tell A3_preload", "The data tell latch_angle"]
    assert spring.mean == pytest.approx(0.991, abs=0.02)
    assert spring.std < 0.03
    assert latch.interval[0] < np.radians(12.0) < latch.interval[1]
    assert np.degrees(latch.mean) == pytest.approx(12.7, abs=1.0)
    assert 0.01 < latch.std < 0.03
    assert abs(found.correlations[0][2]) < 0.15
    alone = calibrated(store, plan, both.model_copy(update={"measurements": both.measurements[:1]}))
    assert alone.told[1].startswith("The data do not tell A3_preload")
    assert alone.constants[0].spread > 0.9
    assert alone.correlations[0][2] > 0.15
    # the page has these numbers
    page = " ".join((ROOT / "docs" / "measured.md").read_text("utf-8").split())
    assert f"{spring.mean:.2f} ± {spring.std:.2f} rad" in page
    assert "12.7 ± 1.0 degrees" in page


@pytest.mark.slow
def test_the_button_of_the_docs(tmp_path):
    """The example of the docs: peak and friction of a simulated button are found again, but not by the peak alone."""
    page = (ROOT / "docs" / "measured.md").read_text("utf-8")
    example = tomllib.loads(re.search(r"^```toml\n(constants = .*?)^```", page, re.M | re.S)[1])
    load_measurements(example)
    button = load_mechanism("push_button")
    truth = {"peak": 3.1, "friction": 0.17, "preload": 0.31}
    run = simulate(button, {f"parameters.{name}": value for name, value in truth.items()})
    for each in example["measurements"]:
        each["value"] = run.responses[each["response"]]
    variables = {
        name: {"target": f"parameters.{name}", "distribution": "normal", "mean": mean, "std": std}
        for name, mean, std in (("peak", 3.0, 0.2), ("friction", 0.15, 0.03), ("preload", 0.3, 0.02))
    }
    head = {"format": 1, "name": "button", "mechanism": "push_button", "samples": 40, "sampler": "sobol"}
    campaign = load_campaign({**head, "variables": variables, "repeats": {"share": 0.0}})
    store, plan = computed(tmp_path / "runs", campaign, 20, simulate)
    found = calibrated(store, plan, load_measurements(example))
    assert found.quality["actuation"].q2 > 0.99
    for constant in found.constants:
        assert constant.interval[0] < truth[constant.name] < constant.interval[1]
        assert constant.spread < 0.5
    assert all(words.startswith("The data tell") for words in found.told)
    alone = {**example, "measurements": example["measurements"][:1], "discrepancy": {"actuation": {"sigma": 0.0}}}
    told = calibrated(store, plan, load_measurements(alone)).told
    assert told[1].startswith("The data do not tell friction")  # of which much less was assumed than of the peak
