"""Where journals lie at the end of runs: against known answers of a pendulum that hangs on its bolt."""

import numpy as np
import pytest
from PIL import Image

from campaign.spec.load import load_campaign
from clearcap.pictures.play import JournalPositions, journal_positions, mean_direction, merge_runs, plot_polarisation
from clearcap.questions.mechanisms import campaign_journal_positions
from engine import Recording, read_trajectory, simulate
from tests.engine.small import made, shipped


def hanging(tmp_path, gravity, bearing="link"):
    """Return the journals of a pendulum that starts straight and is braked; bore on the link, or on the ground."""
    data = shipped("clearance_pendulum") | {"gravity": gravity, "phases": [{"name": "settle", "damping": 200.0}]}
    data["bodies"]["link"]["angle"] = float(np.arctan2(gravity[0], -gravity[1]))
    data["springs"]["damper"]["free_angle"] = data["bodies"]["link"]["angle"]
    if bearing == "ground":
        joint = data["joints"]["J1"]
        joint["bearing"], joint["journal"] = joint["journal"], {**joint["bearing"], "radius": 0.01}
        del joint["bearing"]["radius"]
    simulate(made(data), horizon=2.0, trajectory=Recording(tmp_path / "run.h5", every=1000))
    run = read_trajectory(tmp_path / "run.h5")
    assert run.status == "ok", run.message
    return journal_positions(run)


@pytest.mark.parametrize("gravity", [[0.0, -9.81, 0.0], [6.0, -8.0, 0.0]])
@pytest.mark.parametrize("bearing", ["link", "ground"])
def test_journal_lies_where_gravity_pushes_it(tmp_path, gravity, bearing):
    """The bolt high in the link's bore, the link's pin low in the ground's; both rings carry half the weight."""
    pull = np.array(gravity[:2]) * (-1 if bearing == "link" else 1)  # on the journal, as against the bearing
    journals = hanging(tmp_path, gravity, bearing)
    assert [(journal.joint, journal.ring) for journal in journals] == [("J1", 1), ("J1", 2)]
    up = [0.0, 1.0] if gravity[0] == 0 else np.array([-gravity[0], -gravity[1]]) / 10.0  # of the picture
    right = np.array([up[1], -up[0]])
    expected = np.array([pull @ right, pull @ up])
    for journal in journals:
        np.testing.assert_allclose(journal.eccentricities[0], expected / np.linalg.norm(expected), atol=1e-3)
        np.testing.assert_allclose(journal.forces[0], 0.05 * expected, atol=1e-3)


def test_merged_runs_and_mean():
    """Runs are rows; the mean force is as long as the runs agree."""
    runs = [[JournalPositions("J1", 1, np.array([[0.0, 1.0]]), np.array([[0.0, 4.0]]))] for _ in range(3)]
    (journal,) = merge_runs(runs)
    assert journal.eccentricities.shape == journal.forces.shape == (3, 2)
    np.testing.assert_allclose(mean_direction(journal), [0, 1])
    both = JournalPositions("J1", 1, np.zeros((2, 2)), np.array([[3.0, 0.0], [0.0, 3.0]]))
    np.testing.assert_allclose(mean_direction(both), [0.5, 0.5])
    np.testing.assert_array_equal(mean_direction(JournalPositions("J1", 1, np.zeros((1, 2)), np.zeros((1, 2)))), [0, 0])
    assert merge_runs([]) == []


@pytest.mark.slow
@pytest.mark.processes
def test_campaign_and_its_figure(tmp_path):
    """Two samples of the C-60 in two processes: all rings, as in one run of the same values; a figure with words."""
    campaign = load_campaign("c60", samples=2)
    journals = campaign_journal_positions(campaign, 2)
    assert len(journals) == 16
    assert {journal.eccentricities.shape for journal in journals} == {(2, 2)}
    assert all((np.linalg.norm(journal.eccentricities, axis=1) < 1 + 1e-6).all() for journal in journals)
    plot_polarisation(journals, "C-60", tmp_path / "journals.png")
    with Image.open(tmp_path / "journals.png") as image:
        image.load()
        assert image.text["Description"].startswith("C-60: 2 runs. J1 ring 1 presses at ")
