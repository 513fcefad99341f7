"""What the service has the engine do: the command's documents, from texts and names, never from paths."""

import json

import pytest
from typer.testing import CliRunner

from campaign.errors import SpecError
from campaign.spec.load import load_campaign
from clearcap.cli import app
from clearcap.questions import mechanisms
from clearcap.questions.mechanisms import MechanismSource, animate_once, check_text, simulate_once
from clearcap.questions.report import written_report
from clearcap.questions.samples import replay_document
from engine import MechanismError, simulate
from engine.mechanism import library_names
from tests.campaign.driving import computed

PENDULUM = "clearance_pendulum"


def shipped(name):
    """Return the text of a shipped mechanism."""
    from importlib import resources

    return resources.files("engine.mechanism").joinpath("library", f"{name}.toml").read_text(encoding="utf-8")


def test_a_single_run_is_the_commands():
    """By name, and from the text of the same file; the certificate's time of the clock apart."""
    said = json.loads(CliRunner().invoke(app, ["simulate", "c60", "--set", "J1=0.05", "--json"]).stdout)
    for asked in (
        MechanismSource("c60", None, values={"J1": 0.05}),
        MechanismSource("m", shipped("c60"), values={"J1": 0.05}),
    ):
        found = json.loads(json.dumps(simulate_once(asked)))
        assert found["responses"] == said["responses"]
        assert found["ranges"] == said["ranges"]
        assert found["units"] == said["units"]
        assert {**found["certificate"], "wall_s": 0} == {**said["certificate"], "wall_s": 0}


@pytest.mark.slow
def test_the_motion_is_a_gif(monkeypatch):
    """It has more than one picture."""
    monkeypatch.setattr(mechanisms, "ANIMATION_FRAMES", 8)
    motion = animate_once(MechanismSource(PENDULUM))
    assert motion.startswith(b"GIF89a")
    assert motion.count(b"\x21\xf9\x04") > 3  # a graphic control extension for each


@pytest.mark.parametrize("name", ["/etc/passwd", "../c60.toml", "nobody", ""])
def test_a_mechanism_is_a_shipped_name_or_a_text(name):
    """No file that is named is opened; the message says what there is."""
    with pytest.raises(SpecError, match=f"none of this name; shipped: .*{library_names()[0]}"):
        simulate_once(MechanismSource(name))


def test_a_posted_text_is_checked():
    """A sound one says what it is, any other all its faults."""
    assert check_text(MechanismSource("m", shipped(PENDULUM)))["summary"]["name"] == PENDULUM
    with pytest.raises(MechanismError, match="bodies"):
        check_text(MechanismSource("m", shipped(PENDULUM).replace("[bodies.", "[bodied.", 1)))


def test_a_sample_is_repeated_and_reported(campaign_file, storage, tmp_path):
    """The document is the command's; a report is written into the store."""
    store, plan = computed(storage(tmp_path), load_campaign(str(campaign_file), samples=4), 2, simulate)
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
