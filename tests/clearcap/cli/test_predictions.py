"""``clearcap design``: the file that it writes is a campaign, and finds the share that the physics has."""

import json
import re

import pytest
from scipy.stats import norm

from campaign.spec.load import load_campaign
from engine import load_mechanism, simulate
from tests.campaign.commands import ROOT, clearcap, clearcap_here
from tests.campaign.driving import computed
from tests.clearcap.questions.test_aimed_campaign import pilot


def test_it_writes_a_campaign(tmp_path, capsys, monkeypatch):
    """It says what it expects and where it aims; the file loads. With --json, one document."""
    computed(tmp_path / "runs", pilot(tmp_path, "lsl = 11.7\nusl = 12.2\n"), 100)
    words = ("design", "--store", tmp_path / "runs", "--samples", 500, "--output", tmp_path / "rare.toml")
    code, out, _ = clearcap_here(capsys, monkeypatch, *words)
    assert code == 0
    assert "FC-1 below 11.7" in out
    assert "quadratic" in out
    shares = [float(each) for each in re.findall(r"^ *([\d.]+) %", out, re.MULTILINE)]
    assert sum(shares) == pytest.approx(100.0)
    assert "production itself" in out
    assert load_campaign(str(tmp_path / "rare.toml")).spec.samples == 500
    code, out, _ = clearcap_here(capsys, monkeypatch, *words, "--json")
    content = json.loads(out)
    assert [target["name"] for target in content["targets"]] == ["FC-1 below 11.7", "FC-1 above 12.2"]
    assert content["components"][-1]["scale"] == 2.0


def test_nothing_to_aim_at(tmp_path, capsys, monkeypatch):
    """Limits that plain runs break often: the file is written, and a message says what it is good for."""
    computed(tmp_path / "runs", pilot(tmp_path, "usl = 11.98\n"), 100)
    words = ("design", "--store", tmp_path / "runs", "--output", tmp_path / "rare.toml")
    code, _, err = clearcap_here(capsys, monkeypatch, *words)
    assert code == 0
    assert "no limit needs a separate component" in err
    code, _, err = clearcap_here(capsys, monkeypatch, *words[:-1], tmp_path / "rare.txt")
    assert code == 2
    assert "unknown ending" in err


BLOCK = """
[variables.friction]
target = "materials.block_slope.friction"
distribution = "truncated_normal"
mean = 0.9
std = 0.02
lower = 0.6
upper = 1.2

[variables.mass]
target = "bodies.block.mass"
distribution = "uniform"
lower = 0.9
upper = 1.1

[responses.slide]
usl = {usl}
"""


@pytest.mark.processes
@pytest.mark.slow
def test_the_way_of_a_block_down_a_slope(tmp_path):
    """With physics, from the shell: a block stops after v^2 / 2 g (friction cos 30 - sin 30), whatever its mass.

    Its way falls as friction grows, so its limit is where friction is 4.5 sigma below its mean: 3.4 ppm.
    """
    text = (ROOT / "engine" / "mechanism" / "library" / "incline.toml").read_text()
    moving = "mass = 1.0\nvelocity = [0.8660254037844386, 0.0, -0.5]"  # 1 m/s down the slope
    (tmp_path / "block.toml").write_text(text.replace("mass = 1.0", moving))
    mechanism = load_mechanism(tmp_path / "block.toml")
    usl = simulate(mechanism, {"materials.block_slope.friction": 0.9 - 4.5 * 0.02}).responses["slide"]
    head = 'format = 1\nname = "slope"\nmechanism = "block.toml"\nsamples = 150\n'
    (tmp_path / "slope.toml").write_text(head + BLOCK.format(usl=usl))
    for words in (
        ("run", "slope.toml", "--workers", 1, "--no-report"),
        ("design", "--samples", 700, "--output", "rare.toml"),
        ("run", "rare.toml", "--workers", 2),
    ):
        ended = clearcap(*words, cwd=tmp_path)
        assert ended.returncode == 0, ended.stderr
    [written] = (tmp_path / "runs").glob("slope-rare-*/report/capability.json")
    content = json.loads(written.read_text())
    [share] = (r["total"] for r in content["rare"]["responses"])
    exact = 1e6 * norm.sf(4.5)
    assert share["standard_error"] < 0.15
    assert share["ppm"] == pytest.approx(exact, rel=4 * share["standard_error"])
    assert f" {share['ppm']:.3g} " in ended.stdout
    assert share["interval"][0] < exact < share["interval"][1]
    first = clearcap("replay", written.parents[1].name, 7, "--json", cwd=tmp_path)
    assert json.loads(first.stdout)["same"] is True
