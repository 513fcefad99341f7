"""A ball in a bowl of spline patches, against the same ball in a hollow sphere in closed form."""

from typing import Any

import numpy as np

from tests.engine.histories import History, history
from tests.engine.kernels.surface_shapes import half_sphere_bowl
from tests.engine.small import coordinates, made, small

BOWL, BALL, ERROR = 0.5, 0.1, 2.5e-5  # radii; error of the patches [m]


SIDES = {
    "spline": {"surface": half_sphere_bowl(BOWL, conversion=ERROR)},
    "sphere": {"socket": {"centre": [0, 0, 0], "radius": BOWL}},
}


def ball(side: dict[str, Any], horizon: float, step: float, friction: float, drag: float) -> History:
    """Let a ball go at the wall of a bowl, and record it."""
    start = (BOWL - BALL - 1e-4) * np.array([0.55, 0.25, -np.sqrt(1 - 0.55**2 - 0.25**2)])
    data = small(
        gravity=[0, 0, -9.81],
        simulation={"step": step, "horizon": horizon, "rest": {"window": 10.0, "drift": 1e-12}},
        phases=[{"name": "roll", "duration": horizon, "damping": drag}],
        bodies={"ground": {"fixed": True}, "ball": {"mass": 1.0, "inertia": [0.004] * 3, "origin": start.tolist()}},
        contacts={
            "wall": {
                "a": {"body": "ball", "sphere": {"centre": [0, 0, 0], "radius": BALL}},
                "b": {"body": "ground", **side},
                "friction": friction,
            }
        },
        responses=coordinates("ball"),
    )
    return history(made(data))


def test_without_friction_energy_is_kept_and_the_way_is_that_in_a_sphere():
    """Sliding to and fro: energy is kept as in the sphere, and the balls are never farther apart than the form's error.

    The error of the patches grows along the way as that of a radius would: by its share of it, a few times.
    """
    runs = {name: ball(side, 0.6, 1e-3, 0.0, 0.0) for name, side in SIDES.items()}
    drop = 9.81 * np.ptp(runs["sphere"].x[:, 0, 2])
    away = np.linalg.norm(runs["spline"].x[:, 0] - runs["sphere"].x[:, 0], axis=1)
    assert away.max() < 10 * ERROR
    lost = {name: np.ptp(run.energy[20:]) / drop for name, run in runs.items()}  # after it has met the wall
    assert lost["spline"] < 0.01
    assert abs(lost["spline"] - lost["sphere"]) < 1e-4


def test_with_friction_and_drag_it_comes_to_rest_at_the_bottom():
    """The ball ends where that in the sphere does: at the lowest point, a pole where all patches meet."""
    runs = {name: ball(side, 6.0, 5e-3, 0.5, 4.0) for name, side in SIDES.items()}
    for run in runs.values():
        np.testing.assert_allclose(run.x[-1, 0], [0, 0, BALL - BOWL], atol=2 * ERROR)
    assert np.abs(runs["spline"].x - runs["sphere"].x).max() < 20 * ERROR
