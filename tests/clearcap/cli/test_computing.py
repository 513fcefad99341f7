"""``clearcap repeat``, and what the other verbs do with repeats."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from campaign.plan_header import repeated_samples
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.store.store import read_repeats
from clearcap.cli import app
from engine import simulate
from engine.mechanism import full_key
from tests.campaign.driving import computed

BLOCKS = """\
format = 1
name = "blocks"
mechanism = "incline"
samples = 12
[simulation]
horizon = 0.5
[repeats]
share = 0.3
[variables.friction]
target = "materials.block_slope.friction"
distribution = "uniform"
lower = 0.65
upper = 0.8
"""


@pytest.fixture
def blocks(tmp_path):
    """Return the folder of a store with a campaign of the engine's own, and its plan."""
    file = tmp_path / "blocks.toml"
    file.write_text(BLOCKS)
    folder = tmp_path / "runs"
    return folder, computed(folder, load_campaign(str(file)), 5, simulate)[1]


@pytest.mark.processes
def test_more_repeats(faked, campaign_file, tmp_path):
    """They are added, the report is written again, and no row is computed; what is there is named."""
    run = json.loads(faked.invoke(app, ["run", str(campaign_file), "--workers", "1", "--json"]).stdout)
    identity, store = run["campaign"], open_store("runs")
    words = ["repeat", identity, "--share", "0.5", "--workers", "1"]
    done = json.loads(faked.invoke(app, [*words, "--json"]).stdout)
    assert (done["computed"], done["samples"], done["ok"]) == (0, 25, 25)
    plan = store.plan(identity)
    expected = repeated_samples(25, 0.0, 0.5).tolist()
    assert sorted(read_repeats(store, plan)["sample"].to_pylist()) == expected
    assert f", {len(expected)} of {len(expected)} repeats" in faked.invoke(app, ["status"]).stdout
    card = json.loads((tmp_path / "runs" / identity / "report" / "capability.json").read_text())["trust"]
    line = next(check for check in card if check["name"] == "Repeatability")
    assert f"{len(expected)} samples were simulated a second time" in line["text"]
    assert f"clearcap repeat {identity} --share 1 --store" in line["text"]
    again = faked.invoke(app, [*words[:2], "--share", "0.1", "--no-report"])
    assert again.exit_code == 0
    assert f"{identity} repeats 0.5 of its samples already; for more give a larger --share" in again.stderr
    written = json.loads(faked.invoke(app, ["compact", "--json"]).stdout)["written"]
    assert any(name.startswith("repeats-2/rows-") for name in written)
    assert sorted(read_repeats(store, plan)["sample"].to_pylist()) == expected


def test_repeats_are_replayed(blocks):
    """Bit for bit, with half the step; a sample without a repeat is said to have none."""
    folder, plan = blocks
    store = open_store(str(folder))
    repeat = read_repeats(store, plan).to_pylist()[0]
    assert repeat["repeated_with"].startswith("simulation.step = ")
    words = ["replay", plan.campaign_id, str(repeat["sample"]), "--repeat", "--store", str(folder)]
    done = json.loads(CliRunner().invoke(app, [*words, "--json"]).stdout)
    assert done["same"] is True
    assert done["row"]["steps"] == repeat["steps"] > 1.5 * store.table().to_pylist()[repeat["sample"]]["steps"]
    other = next(s for s in range(12) if s not in plan_numbers(store, plan))
    words[2] = str(other)
    assert "the store has no repeat of this sample yet" in CliRunner().invoke(app, words).stdout


def plan_numbers(store, plan):
    """Return the samples that have a repeat."""
    return set(read_repeats(store, plan)["sample"].to_pylist())


@pytest.mark.processes
def test_without_repeats(faked, campaign_file):
    """``share = 0`` computes none; the report says so and how to get some."""
    campaign_file.write_text(
        campaign_file.read_text().replace("[variables.J1]", "[repeats]\nshare = 0\n[variables.J1]", 1)
    )
    run = json.loads(faked.invoke(app, ["run", str(campaign_file), "--workers", "1", "--json"]).stdout)
    text = Path(run["report"]["html"]).read_text(encoding="utf-8")
    assert "No sample was repeated with half the step" in text
    assert f"To repeat some: clearcap repeat {run['campaign']} --share 0.1" in text
    assert "repeats" not in faked.invoke(app, ["status"]).stdout


def test_a_dry_run_shows_what_varies(faked, campaign_file, tmp_path):
    """Each variable has the key that it sets and its distribution in words; nothing is planned or computed."""
    found = faked.invoke(app, ["run", str(campaign_file), "--dry-run"])
    assert found.exit_code == 0
    campaign = load_campaign(str(campaign_file))
    shown = " ".join(found.stdout.split())
    for name, variable in campaign.spec.variables.items():
        assert f"{name} {full_key(campaign.mechanism, variable.target or name)} {variable.text()}" in shown
    assert not (tmp_path / "runs").exists()
