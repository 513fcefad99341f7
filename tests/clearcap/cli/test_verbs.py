"""The verbs that drive, end, resume, repeat and follow a campaign, with the engine on a small mechanism."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from functools import partial

import pytest
from typer.testing import CliRunner

import campaign.coordinator.coordinate
import campaign.coordinator.submit
from campaign.coordinator.rerun import RerunResult
from campaign.store import open_store
from clearcap.cli import app
from tests.campaign import fake_engine
from tests.campaign.commands import ROOT, clearcap
from tests.campaign.driving import computed
from tests.until import until

pytestmark = pytest.mark.processes

SLOPE = """
format = 1
name = "slope"
mechanism = "incline"
samples = 12

[simulation]
horizon = 0.2

[variables.friction]
target = "materials.block_slope.friction"
distribution = "uniform"
lower = 0.4
upper = 0.8
"""


@pytest.fixture
def slope(tmp_path):
    """Return a folder with a campaign of blocks on slopes, some of which slide and are not at rest at the end."""
    (tmp_path / "slope.toml").write_text(SLOPE)
    return tmp_path


@pytest.mark.slow
def test_submitted_campaign_is_driven_to_its_report(slope):
    """``submit`` prints the id alone and returns; a process of its own computes it; submitting again finds it."""
    done = clearcap("submit", "slope.toml", "--workers", "1", cwd=slope)
    assert done.returncode == 0, done.stderr
    (campaign_id,) = done.stdout.split()
    assert "started a coordinator (process " in done.stderr
    followed = clearcap("watch", "--json", cwd=slope)
    until((slope / "runs" / campaign_id / "report" / "report.html").exists, "no report")
    heartbeat = json.loads(followed.stdout)
    assert (heartbeat["state"], heartbeat["done"], heartbeat["left"]) == ("completed", 12, 0)
    assert "12/12 runs" in followed.stderr
    again = json.loads(clearcap("submit", "slope.toml", "--json", "--queue-only", cwd=slope).stdout)
    assert (again["campaign"], again["driver"]) == (campaign_id, "none")
    status = json.loads(clearcap("status", "--json", cwd=slope).stdout)
    assert (status["state"], status["done"]) == ("completed", 12)


@pytest.fixture
def there(slope):
    """Return the folder with the campaign, computed by a worker's own functions, and its id."""
    from campaign.spec.load import load_campaign
    from engine import simulate

    _, plan = computed(slope / "runs", load_campaign(str(slope / "slope.toml")), 5, simulate)
    return slope, plan


@pytest.mark.slow
@pytest.mark.bits
def test_replay_is_equal_to_the_bit(there, monkeypatch):
    """A row once more, in another process or here; a row that was tampered with is not equal, and exits 1."""
    folder, plan = there
    done = clearcap("replay", plan.campaign_id, 7, "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["same"] is True
    assert document["row"]["friction"] == document["stored"]["friction"]
    monkeypatch.chdir(folder)
    store = open_store("runs")
    rows = store.read_part(plan, 1)
    steps = rows.schema.get_field_index("steps")
    changed = rows.set_column(steps, rows.schema.field(steps), [[n + 1 for n in rows["steps"].to_pylist()]])
    store.write_part(plan, 1, changed)
    done = CliRunner().invoke(app, ["replay", plan.campaign_id, "7", "--plot", "seven.svg"])
    assert done.exit_code == 1, done.output
    assert "differs from the row in the store" in done.stdout
    assert (folder / "seven.svg").exists()
    done = CliRunner().invoke(app, ["replay", plan.campaign_id, "12"])
    assert "has samples 0 to 11" in str(done.exception)


@pytest.mark.slow
def test_rerun_of_what_failed(there, monkeypatch):
    """Blocks that slide are not settled: run again they still are not, and their rows say that they were tried twice.

    So too few runs are ok for a verdict, and the verb says so, as ``run`` does.
    """
    folder, plan = there
    monkeypatch.chdir(folder)
    failed = [row for row in open_store("runs").table().to_pylist() if row["status"] != "ok"]
    assert 0 < len(failed) < 12
    done = CliRunner().invoke(app, ["rerun", plan.campaign_id, "--workers", "1", "--json"])
    assert done.exit_code == 1, done.output
    document = json.loads(done.stdout)
    assert (document["samples"], document["before"]) == (len(failed), document["after"])
    table = open_store("runs").table().to_pylist()
    assert {row["sample"] for row in table if row["attempts"] == 2} == {row["sample"] for row in failed}
    begun, _, judged = done.stderr.partition("\n")
    assert begun == f"clearcap: computing {len(failed)} row{'s' if len(failed) > 1 else ''} again"
    assert judged.startswith(
        f"clearcap: error: {len(failed)} of 12 runs failed ({len(failed)} not_at_rest); failures.min_ok"
    )
    done = CliRunner().invoke(app, ["rerun", plan.campaign_id, "--status", "crashed", "--status", "invalid"])
    assert (done.exit_code, "no run has the status crashed or invalid, nothing" in done.stdout) == (1, True)


def test_rerun_prints_what_goes_on_and_takes_both_selections(faked, campaign_file, monkeypatch):
    """``--sample`` and ``--status`` add up; the command that follows has the store; without failures all is done."""
    campaign_id = json.loads(
        faked.invoke(
            app, ["run", str(campaign_file), "--workers", "1", "--no-report", "--json", "--store", "a b"]
        ).stdout
    )["campaign"]
    seen = []

    def rerun(store, plan, samples, cluster, **repeats):
        seen.append(samples)
        return RerunResult(len(samples), {}, {"ok": len(samples)}, {})

    monkeypatch.setattr("campaign.coordinator.rerun.rerun", rerun)
    monkeypatch.setattr("campaign.coordinator.rerun.failed_samples", lambda *_: [3, 5])
    words = ["rerun", campaign_id[:9], "--store", "a b", "--sample", "5", "--sample", "1", "--status", "crashed"]
    done = faked.invoke(app, words)
    assert (done.exit_code, seen) == (0, [[1, 3, 5]])
    assert f"update the report with: clearcap report {campaign_id} --store 'a b'" in done.stdout
    monkeypatch.setattr("campaign.coordinator.rerun.failed_samples", lambda *_: [])
    done = faked.invoke(app, ["rerun", campaign_id, "--store", "a b", "--json"])
    assert (done.exit_code, json.loads(done.stdout)["samples"]) == (0, 0)


def test_cancel_and_resume(faked, campaign_file):
    """A campaign nobody drives is cancelled at once; a coordinator leaves it; resumed, it is computed."""
    done = faked.invoke(app, ["submit", str(campaign_file), "--queue-only", "--batch-size", "5"])
    (campaign_id,) = done.stdout.split()
    done = json.loads(faked.invoke(app, ["cancel", "--json"]).stdout)
    assert done == {"campaign": campaign_id, "store": "runs", "before": "queued"}
    assert json.loads(faked.invoke(app, ["status", "--json"]).stdout)["state"] == "cancelled"
    assert f"{campaign_id} was cancelled before. Continue it with: clear" in faked.invoke(app, ["cancel"]).stdout
    words = ["coordinate", campaign_id, "--workers", "1"]
    left = faked.invoke(app, words)
    assert type(left.exception).__name__ == "Cancelled"
    assert left.exception.exit_code == 3
    assert faked.invoke(app, ["status"]).stdout.count("clearcap resume") == 1
    done = faked.invoke(app, ["resume", "--workers", "1", "--no-report", "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["statuses"] == {"ok": 25}
    assert "nothing to cancel" in faked.invoke(app, ["cancel"]).stdout


@pytest.mark.parametrize(
    ("before", "said"),
    [
        ("running", "is running and stops within seconds; its finished rows stay. Continue it with: clearcap resume"),
        ("interrupted", "is cancelled; it was interrupted. Continue it with: clearcap resume"),
    ],
)
def test_what_cancel_says(faked, campaign_file, monkeypatch, before, said):
    """A campaign that is computed ends a little later; any other is cancelled at once."""
    (campaign_id,) = faked.invoke(app, ["submit", str(campaign_file), "--queue-only"]).stdout.split()
    monkeypatch.setattr("campaign.coordinator.requests.cancel_campaign", lambda *_: before)
    assert faked.invoke(app, ["cancel"]).stdout.startswith(f"{campaign_id} {said}")


@pytest.mark.parametrize("verb", ["run", "resume", "coordinate", "report"])
def test_too_few_ok_runs_fail_by_default(faked, campaign_file, monkeypatch, verb):
    """Every verb that ends a campaign or writes its report exits 1, says why and what to do; the report is written."""
    some = partial(fake_engine.raises_above, 0.07)
    real = campaign.coordinator.coordinate.coordinate.func
    monkeypatch.setattr(campaign.coordinator.coordinate, "coordinate", partial(real, simulate=some))
    words = ["--workers", "1", "--json"]
    done = faked.invoke(app, ["run", str(campaign_file), *words])
    campaign_id = json.loads(done.stdout)["campaign"]
    if verb != "run":
        shutil.rmtree(f"runs/{campaign_id}/report")
        done = faked.invoke(app, [verb, campaign_id, *(["--json"] if verb == "report" else words)])
    assert done.exit_code == 1, done.output
    failed = json.loads(faked.invoke(app, ["status", "--json"]).stdout)["failed"]
    assert f"{failed} of 25 runs failed ({failed} crashed); failures.min_ok requires 99 % ok runs" in done.stderr
    assert f"clearcap replay {campaign_id} " in done.stderr
    document = json.loads(done.stdout)
    assert os.path.exists(document["report"]["html"])
    if verb != "report":
        assert document["verdicts"]["FC-1"] == "no verdict"
        assert document["headline"].startswith(f"No verdict: {failed} of 25 samples failed")


def test_a_lower_share_of_ok_runs_can_be_stated(faked, campaign_file, monkeypatch):
    campaign_file.write_text(campaign_file.read_text() + "\n[failures]\nmin_ok = 0.1\n")
    some = partial(fake_engine.raises_above, 0.07)
    real = campaign.coordinator.coordinate.coordinate.func
    monkeypatch.setattr(campaign.coordinator.coordinate, "coordinate", partial(real, simulate=some))
    done = faked.invoke(app, ["run", str(campaign_file), "--workers", "1", "--no-report", "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["samples"] == 25


@pytest.mark.slow
def test_the_terminal_says_no_verdict_with_and_without_a_report(faked, campaign_file, monkeypatch):
    """A table of capable survivors alone would mislead; what stopped too early has its report too."""
    always = partial(fake_engine.raises_above, -1.0)
    some = partial(fake_engine.raises_above, 0.07)
    real = campaign.coordinator.coordinate.coordinate.func
    monkeypatch.setattr(campaign.coordinator.coordinate, "coordinate", partial(real, simulate=some))
    for words in ([], ["--no-report"]):
        done = faked.invoke(app, ["run", str(campaign_file), "--workers", "1", *words], env={"COLUMNS": "120"})
        assert "of 25 " in done.stdout.splitlines()[0]
        assert re.search(r"FC-1 \[N\] +no verdict", done.stdout)
    monkeypatch.setattr(campaign.coordinator.coordinate, "coordinate", partial(real, simulate=always))
    done = faked.invoke(app, ["run", str(campaign_file), "--workers", "1", "--samples", "4000"])
    assert type(done.exception).__name__ == "TooManyFailed"
    assert os.path.exists(re.search(r"report of the runs so far: (\S+)", done.stderr).group(1))


@pytest.mark.slow
def test_terminated_coordinator_is_open_for_the_next(slope):
    """SIGTERM, as a supervisor sends it, ends it in order; its campaign is open, and the service goes on."""
    text = SLOPE.replace("samples = 12", "samples = 4000").replace("horizon = 0.2", "horizon = 5.0")
    (slope / "slope.toml").write_text(text)
    submitted = clearcap("submit", "slope.toml", "--queue-only", "--batch-size", "20", cwd=slope)
    assert submitted.returncode == 0, submitted.stderr
    command = [sys.executable, "-m", "clearcap", "coordinate", "--workers", "1"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    service = subprocess.Popen(command, cwd=slope, env=environment, stderr=subprocess.PIPE, text=True)
    try:
        until(lambda: json.loads(clearcap("status", "--json", cwd=slope).stdout)["done"], "no row")
        service.send_signal(signal.SIGTERM)
        service.wait()
    finally:
        service.kill()
        service.stderr.close()
    status = json.loads(clearcap("status", "--json", cwd=slope).stdout)
    assert (status["state"], status["open"]) == ("interrupted", True)
    assert 0 < status["done"] < 4000
    assert not (slope / "runs" / status["campaign"] / "lease.json").exists()
