"""Motions that lose no energy."""

from engine import simulate
from tests.engine.preflight.examples import SPRING, guided, warned
from tests.engine.small import made

SAID = "bodies.ball: no contact, damper or damping of the phase takes energy from its motion: it never comes to rest"


def test_a_swing_that_nothing_damps():
    """Thrown, or off its balance: the caution, and then a run that is not at rest."""
    push = {"f": {"body": "ball", "force": [1, 0, 0]}}
    for data in (guided({"velocity": [0.3, 0, 0]}, springs={"s": SPRING}), guided(springs={"s": SPRING}, forces=push)):
        (text,) = warned(data)
        assert text.startswith(SAID)
        assert simulate(made(data)).status == "not_at_rest"


def test_a_swing_that_is_damped_or_does_not_begin():
    """A damping of spring or phase, a balance at the start, a phase of given length."""
    body = {"velocity": [0.3, 0, 0]}
    for data in (
        guided(body, springs={"s": SPRING | {"damping": 1.0}}),
        guided(body, springs={"s": SPRING}, phases=[{"name": "run", "damping": 1.0}]),
        guided(springs={"s": SPRING}),
        guided(body, springs={"s": SPRING}, phases=[{"name": "run", "duration": 1.0}]),
    ):
        assert warned(data) == []
