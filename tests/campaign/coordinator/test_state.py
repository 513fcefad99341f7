"""The state of a campaign, also if its file holds something strange."""

import pytest

import campaign.coordinator.heartbeat as following
from campaign.coordinator import lease
from campaign.coordinator.heartbeat import Heartbeat
from campaign.coordinator.lease import hold_lease, this_process
from campaign.coordinator.requests import cancel_campaign
from campaign.coordinator.state import resume_command, state_of, write_state
from campaign.store.layout import HEARTBEAT, LEASE, STATE
from tests.campaign.commands import clearcap_here


def test_state_is_read_back(store, plan):
    """With the time at which it began."""
    write_state(store, plan.campaign_id, "failed", "because")
    state = state_of(store, plan.campaign_id)
    assert (state["state"], state["message"], state["open"]) == ("failed", "because", False)
    assert state["since"] > 1.7e9


def test_who_continues_a_campaign_computes_where_it_was_computed(store, plan):
    """Whatever happens to it in the meantime; options that nobody has written are left out."""
    options = ["--cluster", "slurm", "--workers", "2:64"]
    write_state(store, plan.campaign_id, "interrupted", options=options)
    cancel_campaign(store, plan.campaign_id)
    words = f"clearcap resume {plan.campaign_id} --cluster slurm --workers 2:64 --store {store.url}"
    assert (state_of(store, plan.campaign_id)["state"], resume_command(store, plan.campaign_id)) == ("cancelled", words)
    for odd in (None, "rm", [3], {}):
        store.write_json(plan.campaign_id, STATE, {"state": "failed", "options": odd})
        assert resume_command(store, plan.campaign_id) == f"clearcap resume {plan.campaign_id} --store {store.url}"


@pytest.mark.parametrize("since", [1e308, -1e308, "yesterday", True, [1], {}, None, 10**400])
def test_strange_date_breaks_no_list(store, plan, monkeypatch, capsys, since):
    """It is no date; the campaign, and all others, are listed."""
    store.write_json(plan.campaign_id, STATE, {"state": "completed", "since": since})
    assert state_of(store, plan.campaign_id)["since"] is None
    code, output, _ = clearcap_here(capsys, monkeypatch, "list", "--store", store.url)
    assert code == 0
    assert plan.campaign_id in output


def test_lost_state_is_that_of_the_heartbeat(store, plan):
    """Running while a coordinator lives; open as soon as none does, so that the campaign is continued."""
    assert state_of(store, plan.campaign_id)["state"] == "planned"
    store.write_json(plan.campaign_id, HEARTBEAT, {"state": "running"})
    with hold_lease(store, plan.campaign_id):
        assert state_of(store, plan.campaign_id)["state"] == "running"
    state = state_of(store, plan.campaign_id)
    assert (state["state"], state["open"]) == ("interrupted", True)
    write_state(store, plan.campaign_id, "cancelled")
    assert not state_of(store, plan.campaign_id)["open"]


def test_status_of_a_coordinator_elsewhere_that_has_ended(store, plan, monkeypatch, capsys):
    """It says who no longer writes, and the command that continues; the state remains, for it may be cut off."""
    write_state(store, plan.campaign_id, "running", options=["--workers", "3"])
    elsewhere = {"host": "another machine", "name": "node7", "pid": 4711}
    store.write_json(plan.campaign_id, LEASE, {"token": "x", **this_process(), **elsewhere})
    beat = Heartbeat(plan.campaign_id, "running", 25, 20, 20, 0, 5, {"ok": 20}, 3.5, 9.0, 2)
    store.write_json(plan.campaign_id, HEARTBEAT, beat.to_json())
    monkeypatch.setattr(following, "HEARTBEAT_INTERVAL", 0.0)
    monkeypatch.setattr(lease, "STALE_AFTER", 0.0)
    code, output, _ = clearcap_here(capsys, monkeypatch, "status", "--store", store.url)
    first, *others = output.splitlines()
    assert (code, first.partition(":")[2].split(",")[0]) == (0, " running")
    assert others[0].endswith("ETA -")
    assert others[1].startswith("  its coordinator no longer writes (process 4711 on node7, last at ")
    assert others[2] == f"  continue it with: clearcap resume {plan.campaign_id} --workers 3 --store {store.url}"


def test_the_last_state_is_written_while_it_is_read(store, plan, monkeypatch):
    """A coordinator that ended well between two reads was not interrupted."""

    def ends(*_):
        write_state(store, plan.campaign_id, "completed")
        return False

    write_state(store, plan.campaign_id, "running")
    monkeypatch.setattr("campaign.coordinator.state.is_coordinated", ends)
    assert state_of(store, plan.campaign_id)["state"] == "completed"


def test_a_campaign_that_is_being_cancelled_says_so(store, plan):
    """From the request until its coordinator has ended; then the state says it."""
    with hold_lease(store, plan.campaign_id):
        write_state(store, plan.campaign_id, "running")
        assert state_of(store, plan.campaign_id)["message"] == ""
        cancel_campaign(store, plan.campaign_id)
        state = state_of(store, plan.campaign_id)
        assert (state["state"], state["message"]) == ("running", "cancelled; it stops within seconds")
        write_state(store, plan.campaign_id, "cancelled")
    assert state_of(store, plan.campaign_id)["message"] == ""
