"""Where journals lie at the end of runs: against known answers of a pendulum that hangs on its bolt."""

import numpy as np
import pytest
from PIL import Image

from campaign.pictures.polarisation import mean_way, plot_polarisation
from campaign.reports.journal_positions import Seat, seats_of, seats_of_campaign, together
from campaign.spec.load import load_campaign
from engine import read_trajectory, simulate
from tests.engine.small import made, shipped


def hanging(tmp_path, gravity, bearing="link"):
    """Return the seats of a pendulum that starts straight and is braked; bore on the link, or on the ground."""
    data = shipped("clearance_pendulum") | {"gravity": gravity, "phases": [{"name": "settle", "damping": 200.0}]}
    data["bodies"]["link"]["angle"] = float(np.arctan2(gravity[0], -gravity[1]))
    data["springs"]["damper"]["free_angle"] = data["bodies"]["link"]["angle"]
    if bearing == "ground":
        joint = data["joints"]["J1"]
        joint["bearing"], joint["journal"] = joint["journal"], {**joint["bearing"], "radius": 0.01}
        del joint["bearing"]["radius"]
    simulate(made(data), horizon=2.0, trajectory=tmp_path / "run.h5", every=1000)
    run = read_trajectory(tmp_path / "run.h5")
    assert run.status == "ok", run.message
    return seats_of(run)


@pytest.mark.parametrize("gravity", [[0.0, -9.81, 0.0], [6.0, -8.0, 0.0]])
@pytest.mark.parametrize("bearing", ["link", "ground"])
def test_journal_lies_where_gravity_pushes_it(tmp_path, gravity, bearing):
    """The bolt high in the link's bore, the link's pin low in the ground's; both rings carry half the weight."""
    pull = np.array(gravity[:2]) * (-1 if bearing == "link" else 1)  # on the journal, as against the bearing
    seats = hanging(tmp_path, gravity, bearing)
    assert [(seat.joint, seat.ring) for seat in seats] == [("J1", 1), ("J1", 2)]
    up = [0.0, 1.0] if gravity[0] == 0 else np.array([-gravity[0], -gravity[1]]) / 10.0  # of the picture
    right = np.array([up[1], -up[0]])
    expected = np.array([pull @ right, pull @ up])
    for seat in seats:
        np.testing.assert_allclose(seat.ways[0], expected / np.linalg.norm(expected), atol=1e-3)
        np.testing.assert_allclose(seat.loads[0], 0.05 * expected, atol=1e-3)


def test_together_and_mean():
    """Runs are rows; the mean force is as long as the runs agree."""
    runs = [[Seat("J1", 1, np.array([[0.0, 1.0]]), np.array([[0.0, 4.0]]))] for _ in range(3)]
    (seat,) = together(runs)
    assert seat.ways.shape == seat.loads.shape == (3, 2)
    np.testing.assert_allclose(mean_way(seat), [0, 1])
    both = Seat("J1", 1, np.zeros((2, 2)), np.array([[3.0, 0.0], [0.0, 3.0]]))
    np.testing.assert_allclose(mean_way(both), [0.5, 0.5])
    np.testing.assert_array_equal(mean_way(Seat("J1", 1, np.zeros((1, 2)), np.zeros((1, 2)))), [0, 0])
    assert together([]) == []


def test_campaign_and_its_figure(tmp_path):
    """Two samples of the C-60 in two processes: all rings, as in one run of the same values; a figure with words."""
    campaign = load_campaign("c60", samples=2)
    seats = seats_of_campaign(campaign, 2)
    assert len(seats) == 16
    assert {seat.ways.shape for seat in seats} == {(2, 2)}
    assert all((np.linalg.norm(seat.ways, axis=1) < 1 + 1e-6).all() for seat in seats)
    plot_polarisation(seats, "C-60", tmp_path / "seats.png")
    with Image.open(tmp_path / "seats.png") as image:
        image.load()
        assert image.text["Description"].startswith("C-60: 2 runs. J1 ring 1 presses at ")
