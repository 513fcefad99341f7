"""What looks wrong in a campaign is said before its first run."""

import logging

import numpy as np
import pytest

from campaign.coordinator.submit import plan_campaign
from campaign.errors import SpecError
from campaign.spec.campaign_cautions import campaign_cautions
from campaign.spec.load import load_campaign
from campaign.spec.named_files import campaign_names

PENDULUM = {
    "format": 1,
    "name": "pendulum",
    "mechanism": "clearance_pendulum",
    "samples": 4,
    "seed": 1,
    "variables": {"J1": {"distribution": "uniform", "lower": 2e-4, "upper": 9e-4}},
}


def warned(**tables):
    """Return the cautions on the pendulum's campaign with other tables, as texts."""
    return [str(caution) for caution in campaign_cautions(load_campaign(PENDULUM | tables))]


def test_a_variable_in_another_unit():
    """A clearance in metres, as in mm: the key of the mechanism, and the median."""
    lower = {"distribution": "uniform", "lower": 2e-8, "upper": 9e-8}
    (text,) = warned(variables={"J1": lower})
    assert text.startswith("joints.J1.radial_clearance = 5.5e-08 m: unusually small")
    assert warned() == []


def test_measured_values_that_drift():
    """They are drawn again in any order, as if the process had been stable; sorted or not, the reader decides."""
    drifting = [5e-4 + 1e-6 * i + 2e-5 * (-1) ** i for i in range(80)]
    measured = {"distribution": "empirical", "values": drifting}
    (text,) = warned(variables={"J1": measured})
    assert text.startswith("variables.J1: the measured values are not in random order: they rise from row to row (rank")
    assert text.endswith("; find the cause and measure again; if the rows were sorted, it means nothing")
    shuffled = np.random.default_rng(1).permutation(drifting).tolist()
    assert warned(variables={"J1": measured | {"values": shuffled}}) == []


@pytest.mark.parametrize("name", campaign_names())
def test_no_shipped_campaign_is_warned_of(name):
    """They are as they should be."""
    assert [str(caution) for caution in campaign_cautions(load_campaign(name))] == []


def test_a_step_that_the_campaign_sets_is_tried(monkeypatch):
    """With its horizon; the caution names the longest step that comes to rest."""
    tried = []

    def caution(mechanism, step, horizon):
        tried.append((mechanism.name, step, horizon))

    monkeypatch.setattr("campaign.spec.campaign_cautions.step_caution", caution)
    assert warned(simulation={"step": 1e-3, "horizon": 5.0}) == []
    assert tried == [("clearance_pendulum", 1e-3, 5.0)]


def test_planning_warns_once(tmp_path, caplog):
    """Before a new campaign is planned, and not when it is continued."""
    data = PENDULUM | {"variables": {"J1": {"distribution": "uniform", "lower": 2e-8, "upper": 9e-8}}}
    for count in (1, 0):
        caplog.clear()
        with caplog.at_level(logging.WARNING, "campaign"):
            plan_campaign(data, str(tmp_path))
        assert sum("warning: joints.J1.radial_clearance" in message for message in caplog.messages) == count


@pytest.mark.parametrize(
    ("tables", "key"),
    [
        ({"simulation": {"step": 100.0}}, "simulation.step = 100.0"),
        ({"failures": {"retry": [{"step": 1e-3}, {"step": 3.0, "horizon": 2.0}]}}, "failures.retry.1.step = 3.0"),
    ],
)
def test_a_step_longer_than_the_horizon_is_refused(tables, key):
    """Its own horizon, or that of the mechanism, 10 s."""
    with pytest.raises(SpecError, match=f"{key}: longer than the horizon"):
        load_campaign(PENDULUM | tables)
