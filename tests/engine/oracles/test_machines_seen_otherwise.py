"""Machines with adaptive steps are the same elsewhere, in another order, in a mirror, in other units."""

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine import simulate
from engine.run import Run
from tests.each import each
from tests.engine.linkages import in_millimetres, mirrored
from tests.engine.oracles.machines import detent, oscillator, plates, seesaw, tether, toggle, wedge
from tests.engine.small import made, turned

MACHINES: dict[str, Callable[[], dict[str, Any]]] = {
    "plates": lambda: plates(15.0),
    "oscillator": lambda: oscillator(0.3, 0.21),
    "wedge": lambda: wedge(0.3, 0.2, 1.0),
    "tether": lambda: tether(0.5, 0.3, 0.6),
    "seesaw": lambda: seesaw(0.28),
    "seesaw with play": lambda: seesaw(0.28, 1e-3),
    "detent": lambda: detent(10.0, 0.6, 0.15, 20.0),
    "toggle": lambda: toggle(0.15, 1e-4, 0.1),
}
MANY = each("name", MACHINES)


def ran(data: dict[str, Any]) -> Run:
    """Run a machine, which has to be ok."""
    run = simulate(made(data))
    assert run.status == "ok", run.message
    return run


def same(run: Run, other: Run, scale: float = 1.0) -> None:
    """Check that responses agree: what a machine at rest may still creep, and forces, to a few millionths."""
    assert run.responses.keys() == other.responses.keys()
    for name, value in run.responses.items():
        is_length = run.units[name] == "m"
        there = other.responses[name] / (scale if is_length else 1.0)
        assert there == pytest.approx(value, rel=2e-5, abs=1e-7 if is_length else 1e-5), name


@MANY
@pytest.mark.parametrize("shift", [[1.0, -1.0, 0.5], [0.0, 0.0, -0.001]])
def test_place_does_not_matter(name, shift):
    """Moved by up to a metre and a half, with all steps as long where nothing is at the brink of slipping."""
    data = MACHINES[name]()
    same(ran(data), ran(turned(data, Rotation.from_rotvec([0, 0, 1e-9]), np.array(shift))))


@MANY
def test_the_direction_of_the_world_does_not_matter(name):
    """Turned with gravity and loads."""
    turn, data = Rotation.from_rotvec([0.4, -1.1, 0.7]), MACHINES[name]()
    same(ran(data), ran(turned(data, turn, np.array([0.5, -0.2, 0.1]))))


@MANY
def test_the_order_does_not_matter(name):
    """Bodies, joints, contacts and springs the other way round, the sides of contacts exchanged."""
    data = MACHINES[name]()
    other = copy.deepcopy(data)
    for table in {"bodies", "joints", "contacts", "springs"} & data.keys():
        other[table] = dict(reversed(data[table].items()))
    for contact in other.get("contacts", {}).values():
        contact["a"], contact["b"] = contact["b"], contact["a"]
    same(ran(data), ran(other))


@MANY
def test_a_contact_that_never_touches_changes_no_bit(name):
    """A peg of the ground, a hundred metres away, first of all contacts."""
    data = MACHINES[name]()
    body = list(data["bodies"])[-1]
    sphere = {"centre": [0, 0, 0], "radius": 0.1}
    peg = {"a": {"body": "ground", "point": [50, 60, 70]}, "b": {"body": body, "sphere": sphere}, "friction": 0.3}
    one, other = ran(data), ran(data | {"contacts": {"peg": peg} | data.get("contacts", {})})
    assert (one.certificate.steps, one.responses) == (other.certificate.steps, other.responses)


@MANY
def test_the_image_in_a_mirror_is_the_same(name):
    """The mirror is the plane x = 0: x and angles about y change their signs."""
    data = MACHINES[name]()
    other = mirrored(data)
    for response in other["responses"].values():
        if response["type"] == "angle":
            response["axis"] = [-component for component in response["axis"]]
    for force, image in zip(data.get("forces", {}).values(), other.get("forces", {}).values(), strict=True):
        image["force"] = [-force["force"][0], *force["force"][1:]]
    same(ran(data), ran(other))


@MANY
def test_units_do_not_matter(name):
    """In mm, g and ms: lengths a thousand times as large, forces and angles the same."""
    data = MACHINES[name]()
    run = simulate(in_millimetres(made(data)))
    assert run.status == "ok", run.message
    same(ran(data), run, 1000.0)


@MANY
def test_steps_create_little_energy(name):
    """All steps of a run together create less than a tenth of the largest kinetic energy a step's bound refers to."""
    certificate = ran(MACHINES[name]()).certificate
    assert certificate.max_created_energy <= certificate.created_energy
    assert certificate.created_energy < 200 * max(certificate.max_created_energy, 1e-9)
