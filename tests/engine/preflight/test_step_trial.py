"""A fixed step with which a mechanism does not come to rest, and the longest that does."""

import pytest

from engine import load_mechanism, simulate
from engine.mechanism import set_values
from engine.preflight.cautions import step_caution
from tests.engine.preflight.examples import SPRING, guided
from tests.engine.small import made


def test_a_step_too_long_is_named_with_the_longest_that_does():
    """With c h / m = 3 the speed grows, with half the step it falls."""
    damper = {key: SPRING[key] for key in ("type", "a", "b")} | {"damping": 6000.0}
    mechanism = made(guided({"velocity": [1e-3, 0, 0]}, dampers={"d": damper}))
    caution = step_caution(mechanism, 1e-3)
    assert caution is not None
    assert str(caution).startswith(
        "simulation.step = 0.001 s: with this fixed step the mechanism does not come to rest ("
    )
    assert caution.customary == "up to 0.0005 s"


def test_a_step_that_does_or_that_is_not_to_blame():
    """At rest with it; or never at rest, whatever the step."""
    assert step_caution(load_mechanism("incline"), 1e-3) is None
    assert step_caution(made(guided({"velocity": [0.3, 0, 0]}, springs={"s": SPRING})), 1e-3, 0.2) is None


@pytest.mark.parametrize("preset", ["paper", None])
def test_the_c60_bears_a_step_of_a_fiftieth(preset):
    """In free fall 0.02 ms lost the latch while the projection of a long step could create energy; it holds now."""
    mechanism = load_mechanism("c60")
    if preset:
        mechanism = set_values(mechanism, mechanism.preset(preset))
    run = simulate(mechanism, step=0.02)
    assert run.status == "ok", run.message
    assert run.responses["latched"] == 1
    assert step_caution(mechanism, 0.02) is None
