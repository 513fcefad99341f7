"""What a file is that was given in place of another: one message that says it, and which verb takes it."""

import json
import shlex

import pytest

from campaign.errors import SpecError
from campaign.spec.campaign_file import CampaignSpec
from campaign.spec.load import load_campaign
from engine import Mechanism, MechanismError, load_mechanism
from engine.faults.file_kinds import CAMPAIGN_KEYS, MECHANISM_KEYS
from tests.each import each

MECHANISM = 'format = 1\nname = "lift"\nunits = "mm-g-ms"\n[bodies.ground]\nfixed = true\n'
CAMPAIGN = 'format = 1\nname = "lift"\nmechanism = "incline"\n[variables.J1]\ndistribution = "normal"\n'
PLAN = {"format": 2, "sha256": "0" * 64, "campaign": "x-1", "row_build": "a", "engine_build": "b", "spec": {}}
REPORT = {"format": 2, "title": "a title", "campaign": "x-1"}

# by the name of a file: its content, and what is said of it in place of a mechanism and of a campaign
FILES = {
    "a mechanism.toml": (MECHANISM, None, "is a mechanism file, not a campaign; one run of it: clearcap simulate {}"),
    "a campaign.toml": (CAMPAIGN, "is a campaign file, not a mechanism; compute it with: clearcap run {}", None),
    "no mechanism key.toml": ("samples = 3\n[variables.J1]\nstd = 1\n", "is a campaign file, not a mechanism", None),
    "costs.toml": ("[variables.J1]\ncost = 1.0\n", "is a cost file; clearcap advise takes it", "is a cost file"),
    "plan.json": (json.dumps(PLAN, indent=1), "is the plan of a campaign in a store; clearcap resume takes", "plan"),
    "capability.json": (json.dumps(REPORT, indent=1), "is the data of a report", "is the data of a report"),
    "other.json": ('{"a": 1}', "is a JSON document; name a mechanism file", "is a JSON document"),
    "part.parquet": (b"PAR1\x15\x00\xff", "is a Parquet file, such as the rows of a campaign", "is a Parquet file"),
    "run.h5": (b"\x89HDF\r\n\x1a\n\x00", "is an HDF5 file, such as the motion of a run", "is an HDF5 file"),
    "report.html": ("<!doctype html><title>x</title>", "is a web page, such as a report", "is a web page"),
}
REFUSED = [(name, wanted) for name in FILES for wanted in ("mechanism", "campaign") if name[2:-5] != wanted]


def refusal(wanted, path):
    """Return what is said of a file in place of what is wanted."""
    with pytest.raises(MechanismError if wanted == "mechanism" else SpecError) as refused:
        (load_mechanism if wanted == "mechanism" else load_campaign)(str(path))
    return str(refused.value)


@each(("name", "wanted"), REFUSED)
def test_other_file(name, wanted, tmp_path):
    """One line names the file and what it is; no list of faults."""
    path = tmp_path / name
    content, *said = FILES[name]
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    message, expected = refusal(wanted, path), said[wanted == "campaign"]
    if expected is None:  # a campaign without its mechanism is one with a fault
        assert "mechanism: missing; add it" in message
        return
    assert str(path) in message
    assert expected.format(shlex.quote(str(path))) in message
    assert len(message.splitlines()) == 1


def test_folders(store, plan, tmp_path):
    """A store, the folder of one campaign, and any other folder."""
    (tmp_path / "other").mkdir()
    said = {
        "runs": f"is a store of campaigns; list them with: clearcap list --store {tmp_path}/runs",
        f"runs/{plan.campaign_id}": f"continue that with: clearcap resume {plan.campaign_id} --store {tmp_path}/runs",
        "other": "a folder, not a regular file",
    }
    for name, expected in said.items():
        for wanted in ("mechanism", "campaign"):
            assert expected in refusal(wanted, tmp_path / name)


def test_shipped_mechanism_is_no_campaign(tmp_path, monkeypatch):
    """The name of a shipped mechanism, given to a verb that takes campaigns."""
    monkeypatch.chdir(tmp_path)
    assert "is a shipped mechanism, not a campaign; one run of it: clearcap simulate incline;" in refusal(
        "campaign", "incline"
    )


def test_campaign_that_names_a_campaign(tmp_path):
    """The file that a campaign names as its mechanism is told in one line too."""
    (tmp_path / "other.toml").write_text(CAMPAIGN)
    (tmp_path / "this.toml").write_text(CAMPAIGN.replace("incline", "other.toml"))
    assert "is a campaign file, not a mechanism" in refusal("campaign", tmp_path / "this.toml")


def test_keys_are_those_of_the_formats():
    """The keys that tell the two formats from each other are keys of one format alone."""
    mechanism = {field.alias or name for name, field in Mechanism.model_fields.items()}
    assert CampaignSpec.model_fields.keys() - mechanism >= CAMPAIGN_KEYS
    assert mechanism - CampaignSpec.model_fields.keys() >= MECHANISM_KEYS
