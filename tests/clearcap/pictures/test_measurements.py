"""What responses measure, as drawn: arrows end where the measure does."""

import numpy as np
import pytest

from clearcap.pictures.sketch import contacts_at_start, measurements
from engine import load_mechanism, read_trajectory, simulate
from tests.engine.small import block_on_floor, made


@pytest.fixture(scope="module")
def c60():
    """Return what is drawn of the C-60, by name."""
    mechanism = load_mechanism("c60")
    return {measurement.name: measurement for measurement in measurements(mechanism, contacts_at_start(mechanism))}


@pytest.mark.parametrize(
    ("name", "start", "length", "direction", "point"),
    [  # numbers of the public model: distances between its CAD surfaces in ON
        ("FC-2", (0, 0), 10.5953, (1, 0), (10.5953, -2.9771)),
        ("FC-3", (0, 0), 2.9771, (0, -1), (10.5953, -2.9771)),
        ("FC-4", (0, 0), 10.7628, (1, 0), (10.7628, -2.4327)),
        ("FC-5", (0, 0), 2.4327, (0, -1), (10.7628, -2.4327)),
        ("FC-6", (-5, -8.9), 0.3891, (1, 0), (1.3891, -9.0587)),  # the centre of the tail's arc of radius 6
    ],
)
def test_arrows_of_the_c60(c60, name, start, length, direction, point):
    """From the needle's axis or the plunger's face along X or Y, as long as the distance; the measured point beside."""
    measure = c60[name]
    np.testing.assert_allclose(measure.start[:2], start, atol=1e-6)
    np.testing.assert_allclose((measure.end - measure.start)[:2], np.multiply(length, direction), atol=1e-4)
    np.testing.assert_allclose(measure.point[:2], point, atol=0.02 if name == "FC-6" else 1e-4)
    assert measure.value.startswith(f"{length:.4g} mm")
    across = np.array([direction[1], direction[0]])
    if name != "FC-6":  # its end is on the arc, its point the arc's centre
        assert (measure.point - measure.end)[:2] @ direction == pytest.approx(0, abs=1e-12)
    else:
        assert (measure.point - measure.end)[:2] @ direction == pytest.approx(6)
    assert abs((measure.end - measure.start)[:2] @ across) < 1e-12


def test_force_of_the_c60(c60):
    """FC-1 pushes the moving contact off the fixed one, along +X from its face; its band is the same arrow."""
    force = c60["FC-1"]
    assert (force.kind, force.value) == ("arrow", "arrow: force on moving_contact")
    assert force.start[0] == pytest.approx(1.5, abs=0.05)
    np.testing.assert_allclose(force.end - force.start, [1, 0, 0], atol=1e-12)
    for bound in ("FC-1_low", "FC-1_high"):
        np.testing.assert_array_equal(c60[bound].end, force.end)
    assert (c60["latched"].kind, c60["latched"].value) == ("none", "1 if latch_overlap > 0, else 0")
    assert set(c60) == set(load_mechanism("c60").responses)


def test_arrows_are_the_values_of_a_run(tmp_path):
    """Position, gap, and one that is negative: as long as the responses at the start, the arrow in their direction."""
    data = block_on_floor(origin=[0, 0, 0.7])
    corner = next(iter(data["contacts"]))
    data["responses"] = {
        "up": {
            "type": "position",
            "from": {"body": "ground", "point": [0, 0, 0]},
            "to": {"body": "block", "point": [0, 0, 0]},
            "direction": {"vector": [0, 0, 1]},
        },
        "down": {
            "type": "position",
            "from": {"body": "ground", "point": [0, 0, 0]},
            "to": {"body": "block", "point": [0, 0, 0]},
            "direction": {"vector": [0, 0, -1]},
        },
        "gap": {"type": "gap", "contact": corner},
    }
    mechanism = made(data)
    simulate(mechanism, horizon=0.01, trajectory=tmp_path / "run.h5")
    values = {name: series[0] for name, series in read_trajectory(tmp_path / "run.h5").responses.items()}
    assert values["down"] < 0
    drawn = {measurement.name: measurement for measurement in measurements(mechanism, contacts_at_start(mechanism))}
    for name, sign in (("up", 1), ("down", -1)):
        arrow = drawn[name].end - drawn[name].start
        np.testing.assert_allclose(arrow, [0, 0, sign * abs(values[name])], atol=1e-12)
    gap = drawn["gap"].end - drawn["gap"].start
    assert np.linalg.norm(gap) == pytest.approx(values["gap"], abs=1e-12)


def test_every_kind_of_response_is_explained():
    """Angles turn at their joint, speeds and forces are arrows or dots, what has no place says what it is."""
    crank, ball = ({m.name: m for m in measurements(each, contacts_at_start(each))}
                   for each in map(load_mechanism, ("four_bar", "sphere_roll")))  # fmt: skip
    pivot = load_mechanism("four_bar").bodies["crank"].origin
    assert crank["crank"].kind == "turn"
    np.testing.assert_allclose(crank["crank"].start, pivot, atol=0.5)
    kinds = {name: each.kind for name, each in ball.items()}
    assert kinds == {"way": "length", "speed": "arrow", "spin": "turn", "friction": "point"}
