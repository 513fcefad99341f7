"""Trajectories of small runs, for all tests of pictures."""

import pytest

from engine import load_mechanism, read_trajectory, simulate


@pytest.fixture(scope="session")
def pendulum(tmp_path_factory):
    """Return the shipped pendulum's first 0.1 s: released concentric, its bore falls onto the bolt."""
    path = tmp_path_factory.mktemp("pictures") / "pendulum.h5"
    simulate(load_mechanism("clearance_pendulum"), horizon=0.1, trajectory=path)
    return read_trajectory(path)


@pytest.fixture(scope="session")
def slide(tmp_path_factory):
    """Return the shipped block sliding down its slope for 0.2 s."""
    path = tmp_path_factory.mktemp("pictures") / "slide.h5"
    changes = {"materials.block_slope.friction": 0.3}
    simulate(load_mechanism("incline"), changes, horizon=0.2, full_horizon=True, trajectory=path)
    return read_trajectory(path)
