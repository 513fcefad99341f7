"""Springs and dampers that are too stiff for the time step."""

import pytest

from engine import simulate
from tests.engine.preflight.examples import SPRING, guided, warned
from tests.engine.small import made


def test_a_stiff_spring():
    """A ball of 2 kg on 2e7 N/m answers within 2 ms, twice the step of 1 ms; as customary it is quiet."""
    data = guided(springs={"s": SPRING | {"stiffness": 2e7, "damping": 1.0}})
    (text,) = warned(data)
    assert text.startswith("springs.s.stiffness = 2e+07 N/m: its bodies answer within 0.00199 s, too fast for")
    assert warned(guided(springs={"s": SPRING | {"damping": 1.0}})) == []


@pytest.mark.parametrize(("damping", "status", "texts"), [(6000.0, "diverged", 1), (100.0, "ok", 0)])
def test_a_stiff_damper(damping, status, texts):
    """The caution comes where the run is then lost, and not where it comes to rest."""
    damper = {key: SPRING[key] for key in ("type", "a", "b")} | {"damping": damping}
    data = guided(body={"velocity": [1e-3, 0, 0]}, dampers={"d": damper})
    assert len(warned(data)) == texts
    assert all(text.startswith("dampers.d.damping = 6000 N s/m: its bodies answer within") for text in warned(data))
    assert simulate(made(data)).status == status
