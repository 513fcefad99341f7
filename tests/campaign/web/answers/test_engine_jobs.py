"""What the service has the engine do: the command's documents, from texts and names, never from paths."""

import json
from dataclasses import asdict

import pytest
from typer.testing import CliRunner

from campaign.cli import app
from campaign.errors import CampaignError, SpecError
from campaign.spec.load import load_campaign
from campaign.web.answers.engine_jobs import (
    SingleRun,
    check_campaign,
    check_mechanism,
    single_run,
    written_report,
)
from campaign.web.jobs.samples import replay_document
from engine import MechanismError, simulate
from engine.mechanism import library_names
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed

PENDULUM = "clearance_pendulum"


def shipped(name):
    """Return the text of a shipped mechanism."""
    from importlib import resources

    return resources.files("engine.mechanism").joinpath("library", f"{name}.toml").read_text(encoding="utf-8")


def test_a_single_run_is_the_commands():
    """By name, and from the text of the same file; the certificate's time of the clock apart."""
    said = json.loads(CliRunner().invoke(app, ["simulate", "c60", "--set", "J1=0.05", "--json"]).stdout)
    for asked in (SingleRun("c60", values={"J1": 0.05}), SingleRun(shipped("c60"), True, {"J1": 0.05})):
        found = json.loads(json.dumps(single_run(asked)))
        assert found["responses"] == said["responses"]
        assert found["ranges"] == said["ranges"]
        assert found["units"] == said["units"]
        assert {**found["certificate"], "wall_s": 0} == {**said["certificate"], "wall_s": 0}
        assert found["warnings"] == []


def test_the_motion_comes_as_a_file(tmp_path):
    """It is a trajectory that the engine reads."""
    from engine import read_trajectory

    path = tmp_path / "motion.h5"
    path.write_bytes(single_run(SingleRun(PENDULUM, motion=True)))
    assert read_trajectory(path).time.size > 3


@pytest.mark.parametrize("name", ["/etc/passwd", "../c60.toml", "nobody", ""])
def test_a_mechanism_is_a_shipped_name_or_a_text(name):
    """No file that is named is opened; the message says what there is."""
    with pytest.raises(SpecError, match=f"is not shipped; allowed: .*{library_names()[0]}"):
        single_run(SingleRun(name))


def test_posted_texts_are_checked(tmp_path):
    """A sound one says what it is, any other all its faults; files that it names come with it or not at all."""
    checked = check_mechanism(shipped(PENDULUM))
    assert checked["mechanism"] == PENDULUM
    with pytest.raises(MechanismError, match="bodies"):
        check_mechanism(shipped(PENDULUM).replace("[bodies.", "[bodied.", 1))
    found = check_campaign(SPEC, {})
    assert found == {
        "name": "demo",
        "title": "demo",
        "samples": 25,
        "variables": ["J1", "preload"],
        "responses": ["FC-1"],
    }
    own = SPEC.replace('mechanism = "c60"', 'mechanism = "mine.toml"')
    assert check_campaign(own, {"mine.toml": shipped("c60").encode()})["name"] == "demo"
    secret = tmp_path / "secret.toml"
    secret.write_text("hush = 1")
    with pytest.raises(CampaignError) as refused:
        check_campaign(SPEC.replace('"c60"', json.dumps(str(secret))), {})
    assert "hush" not in str(refused.value)


def test_a_sample_is_repeated_and_reported(campaign_file, tmp_path):
    """The document is the command's; a report is written into the store."""
    store, plan = computed(tmp_path / "runs", load_campaign(str(campaign_file), samples=4), 2, simulate)
    found = replay_document(store.url, plan.campaign_id, 3)
    assert found["same"] is True
    assert found["differences"] == ""
    said = json.loads(CliRunner().invoke(app, ["replay", plan.campaign_id, "3", "--store", store.url, "--json"]).stdout)
    assert found["stored"] == said["stored"]
    assert (said["same"], said["differences"]) == (True, "")
    with pytest.raises(SpecError, match="samples 0 to 3"):
        replay_document(store.url, plan.campaign_id, 4)
    files = written_report(store.url, plan.campaign_id, kinds=("html", "json"))
    assert set(files) == {"html", "json"}
    assert asdict(SingleRun("c60"))["motion"] is False
