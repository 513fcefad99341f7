"""What is sent of a campaign whose mechanism takes its geometry from a CAD file."""

import hashlib
import shutil
import tomllib

import pytest

from campaign.spec.campaign_cautions import campaign_questions
from clearcap.client.remote_server import campaign_upload
from engine import load_mechanism, load_mechanism_text
from tests.engine.mechanism.geometry.latch_file import LATCH

MECHANISM = """\
format = 1
name = "latch"
units = "mm-g-ms"
[cad]
file = "latch.step"
sha256 = "{sha256}"
[simulation]
step = 5e-3
horizon = 500.0
penetration = 1e-7
rest = {{ window = 10.0, drift = 1e-5 }}
#? bodies: which part is fixed? This is the largest
[bodies.base]
part = "base"
fixed = true
[bodies.crank]
part = "crank"
"""
CAMPAIGN = '#? variables: which?\nformat = 1\nname = "c"\nmechanism = "latch.toml"\nsamples = 3\n'


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    """Return a campaign file beside a mechanism file and its CAD file."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    shutil.copy(LATCH, tmp_path / "latch.step")
    sha256 = hashlib.sha256(LATCH.read_bytes()).hexdigest()
    (tmp_path / "latch.toml").write_text(MECHANISM.format(sha256=sha256))
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    return tmp_path / "campaign.toml"


@pytest.mark.slow
@pytest.mark.processes
def test_geometry_is_sent_as_numbers(campaign):
    """A server opens no CAD file: it gets the mechanism that this machine reads, in plain numbers."""
    [(name, content)] = campaign_upload(campaign)[1].items()
    assert name == "latch.toml"
    assert "cad" not in tomllib.loads(content.decode())
    here = load_mechanism(campaign.with_name("latch.toml"))
    assert load_mechanism_text(content.decode()).bodies == here.bodies


def test_other_mechanisms_are_sent_as_they_are(campaign):
    """Comments and all, sound or not: the server says what is wrong with them."""
    for text in ("format = 1  # as it is\n", "no TOML ["):
        campaign.with_name("latch.toml").write_text(text)
        assert campaign_upload(campaign)[1] == {"latch.toml": text.encode()}


def test_questions_of_both_files(campaign):
    """Those of the campaign file, then those of the mechanism file that it names."""
    said = list(campaign_questions(str(campaign)))
    assert [each.partition(": ")[2].partition(": ")[0].rpartition("/")[2] for each in said] == [
        "campaign.toml, line 1",
        "latch.toml, line 12",
    ]
    assert list(campaign_questions(campaign.with_name("none.toml"))) == []
    assert list(campaign_questions({"mechanism": "latch.toml"})) == []
