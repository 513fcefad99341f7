"""What is sound is not warned of."""

import pytest

from engine import library_names, load_mechanism, set_values
from engine.preflight import cautions
from tests.each import each
from tests.engine.preflight.examples import lever, warned


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
