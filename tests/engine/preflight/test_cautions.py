"""What is sound is not warned of."""

import pytest

import clearcap
from engine import library_names, load_mechanism, set_values
from engine.preflight import cautions
from tests.each import each
from tests.engine.preflight.examples import guided, lever, warned
from tests.engine.small import block_on_floor, made


@each("name", library_names())
def test_no_shipped_mechanism_is_warned_of(name):
    """Nor any of its benches or presets."""
    mechanism = load_mechanism(name)
    variants = [mechanism, *(mechanism.on_bench(bench) for bench in mechanism.benches)]
    variants += [set_values(mechanism, mechanism.preset(preset)) for preset in mechanism.presets]
    assert [str(caution) for variant in variants for caution in cautions(variant)] == []


@pytest.mark.parametrize("clearance", [0.01, 0.03, 0.13])
def test_nor_the_clearances_of_the_paper(clearance):
    """From its tightest to its loosest joint."""
    mechanism = set_values(load_mechanism("c60"), {f"J{i}": clearance for i in range(1, 8)})
    assert cautions(mechanism) == []


def test_nor_the_example_of_the_docs():
    """The lever of the page on mechanism files."""
    assert warned(lever()) == []


def test_a_start_that_is_not_the_drawn_one_is_said():
    """A block drawn 1 mm into the floor: what overlaps, and how far it is moved; nothing where it stands on it."""
    data = block_on_floor(origin=[0, 0, 0.099])
    found = [caution for caution in cautions(made(data)) if caution.key == "simulation.assembly_travel"]
    assert len(found) == 1
    assert found[0].text.startswith("as drawn, contacts.corner_0: gap -0.001 m at the start, contacts.corner_2: ")
    assert "moves a body by 0.001 m" in found[0].text
    data["bodies"]["block"]["origin"] = [0, 0, 0.1]
    assert not [caution for caution in cautions(made(data)) if caution.key == "simulation.assembly_travel"]


def test_python_gets_the_warnings_of_the_command():
    """`clearcap.check` has them with the values that it is given; what cannot start raises."""
    data = guided(phases=[{"name": "run", "duration": 0.5}])
    assert clearcap.check(made(data)) == []
    (caution,) = clearcap.check(made(data), {"bodies.ball.mass": 2e6})
    assert caution.key == "bodies.ball.mass"
    assert caution.value == 2e6
    with pytest.raises(clearcap.MechanismError, match="did you mean"):
        clearcap.check(made(data), {"bodies.ball.mas": 1.0})
