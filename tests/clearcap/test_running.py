"""Campaigns that Python code runs."""

import subprocess
import sys

import pandas as pd
import pytest
from distributed import Client, LocalCluster

import clearcap
from campaign.coordinator.lease import hold_lease, is_coordinated
from campaign.coordinator.state import state_of
from campaign.coordinator.submit import plan_campaign
from clearcap import running
from tests.until import until

pytestmark = pytest.mark.processes

STICKS = {"target": "materials.block_slope.friction", "distribution": "uniform", "lower": 0.65, "upper": 0.8}
SLOPE = {
    "format": 1,
    "name": "slope",
    "mechanism": "incline",
    "samples": 4,
    "failures": {"min_ok": 0.5},
    "simulation": {"horizon": 0.2},
    "variables": {"friction": STICKS},
}


@pytest.fixture
def store(tmp_path):
    """Return the folder of a store."""
    return tmp_path / "runs"


def test_run_open_and_run_again(store, capfd):
    """A dict becomes a complete campaign, which is found again, and not computed again; failed runs are a warning."""
    half = {**SLOPE, "failures": {"min_ok": 0.9}, "variables": {"friction": {**STICKS, "lower": 0.5}}}
    with pytest.warns(UserWarning, match=r"failures\.min_ok"):
        results = clearcap.run_campaign(half, samples=6, store=store, workers=1, progress=False)
    assert results.rows.index.tolist() == [0, 1, 2, 3, 4, 5]
    assert 0 < len(results.ok) < 6
    assert capfd.readouterr() == ("", "")
    with pytest.warns(UserWarning, match=r"failures\.min_ok"):
        again = clearcap.run_campaign(half, samples=6, store=store, workers=1)
    assert again.id == results.id == clearcap.open_campaign(store=store).id
    assert again.rows.equals(results.rows)  # wall_s too: they are the same rows
    assert "6/6 runs" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"campaign": {**SLOPE, "samples": -1}}, "samples = -1"),
        ({"campaign": {**SLOPE, "mechanism": "incine"}}, "did you mean 'incline'"),
        ({"campaign": SLOPE, "store": "memory://runs"}, "name a folder or a URL"),
        ({"campaign": SLOPE, "workers": 1, "cluster": clearcap.Cluster()}, "name the workers in the cluster"),
        ({"campaign": clearcap.load_campaign(SLOPE), "samples": 9}, "belong to load_campaign"),
    ],
)
def test_wrong_input(arguments, message, store):
    """The message is that of the command; nothing is written."""
    with pytest.raises(clearcap.SpecError, match=message):
        clearcap.run_campaign(**{"store": store, **arguments})
    assert not store.exists()


def test_another_coordinator(store):
    """The error has the message of the process that computes, and the class of its exit status."""
    opened, plan = plan_campaign(SLOPE, str(store))
    with hold_lease(opened, plan.campaign_id), pytest.raises(clearcap.CampaignError, match=plan.campaign_id) as raised:
        clearcap.run_campaign(SLOPE, store=store, workers=1, progress=False)
    assert not str(raised.value).startswith("error")


def test_interrupt_ends_the_coordinator(monkeypatch, store):
    """An interrupt that reaches this process alone, as in a notebook, ends the other one in order."""
    plan = None

    def interrupted(process, progress):
        until(
            lambda: state_of(clearcap.open_store(str(store)), plan.campaign_id)["state"] == "running", "nobody begins"
        )
        raise KeyboardInterrupt

    def remembered(*arguments):
        nonlocal plan
        opened, plan = plan_campaign(*arguments)
        return opened, plan

    monkeypatch.setattr("campaign.coordinator.submit.plan_campaign", remembered)
    monkeypatch.setattr(running, "_follow", interrupted)
    with pytest.raises(KeyboardInterrupt):
        clearcap.run_campaign(SLOPE, samples=4, store=store, workers=1, progress=False)
    assert not is_coordinated(clearcap.open_store(str(store)), plan.campaign_id)
    assert not (store / plan.campaign_id / "lease.json").exists()


def test_a_mechanism_built_in_code_is_run_as_its_file(store, tmp_path):
    """The rows of an object, of its tables and of the file are the same; what the function is told leads to them."""
    seen = []
    longer = clearcap.load_mechanism("incline").extended(simulation={"horizon": 0.4})
    built = clearcap.run_campaign({**SLOPE, "mechanism": longer}, store=store, workers=1, progress=seen.append)
    assert [beat.samples for beat in seen] == [4] * len(seen)
    assert (seen[-1].state, seen[-1].done, seen[-1].left) == ("completed", 4, 0)
    assert built.plan.spec.mechanism == "incline.toml"
    (tmp_path / "incline.toml").write_text(longer.to_toml())
    from_file = {**SLOPE, "mechanism": str(tmp_path / "incline.toml")}
    assert clearcap.load_campaign(from_file).mechanism.digest() == built.plan.mechanism.digest()
    assert clearcap.load_campaign({**SLOPE, "mechanism": longer.to_dict()}).mechanism == longer
    repeated = built.repeat(1.0, workers=1, progress=False)
    assert clearcap.open_store(str(store)).survey(repeated.plan).statuses == {"ok": 4}
    assert built.replay(2).same


class Follows:
    """A progress that takes rows, too."""

    def __init__(self):
        self.beats, self.tables = [], []

    def __call__(self, beat):
        """Keep a heartbeat."""
        self.beats.append(beat)

    def rows(self, rows):
        """Keep a table."""
        self.tables.append(rows)


def test_rows_are_told_while_they_are_computed(store):
    """Each once, as in the results, those of an earlier run too; what is raised ends the run."""
    seen, again = Follows(), Follows()
    results = clearcap.run_campaign(SLOPE, store=store, workers=1, progress=seen)
    told = pd.concat(seen.tables).sort_index()
    assert told.index.tolist() == [0, 1, 2, 3]
    pd.testing.assert_frame_equal(told, results.rows)
    assert seen.beats[-1].done == 4
    clearcap.run_campaign(SLOPE, store=store, workers=1, progress=again)
    assert sorted(n for table in again.tables for n in table.index) == [0, 1, 2, 3]
    again.rows = _refuse
    with pytest.raises(RuntimeError, match="rows"):
        clearcap.run_campaign(SLOPE, samples=6, store=store, workers=1, progress=again)


def _refuse(rows):
    raise RuntimeError(f"{len(rows)} rows")


def test_a_progress_function_that_raises_ends_the_run(store):
    """What it raises arrives; the coordinator has gone, and the same call continues."""

    def stop(beat):
        raise RuntimeError(beat.campaign)

    with pytest.raises(RuntimeError, match="slope-"):
        clearcap.run_campaign(SLOPE, store=store, workers=1, progress=stop)
    assert not is_coordinated(clearcap.open_store(str(store)), clearcap.open_campaign(store=store).id)


@pytest.mark.slow
def test_a_dask_client_of_ones_own(store):
    """Its workers compute; it stays open, and a scheduler inside this process is refused."""
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        results = clearcap.run_campaign(SLOPE, store=store, cluster=client, progress=False)
        assert results.statuses == {"ok": 4}
        assert client.submit(sum, (1, 2)).result() == 3
    inside = Client(processes=False, n_workers=1, dashboard_address=None)
    with inside, pytest.raises(clearcap.SpecError, match="another process cannot reach"):
        clearcap.run_campaign(SLOPE, store=store, cluster=inside)


@pytest.mark.slow
def test_a_script_needs_no_guard(store, tmp_path):
    """The workers do not import the script that started them."""
    script = tmp_path / "script.py"
    script.write_text(f"import clearcap\nprint(clearcap.run_campaign({SLOPE!r}, store={str(store)!r}).statuses)\n")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True)
    assert done.stdout == "{'ok': 4}\n", done.stderr
