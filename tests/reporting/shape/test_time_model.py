"""Model classes of ISO 22514-2: processes of each class are named so, and what is not enough says so."""

import numpy as np
import pytest
from scipy.stats import f_oneway, rankdata

from reporting.shape.time_model import FEWEST_GROUPS, WORDS, time_model
from studies.time_models import CLASSES, GROUPS, held, models, values
from tests.each import each
from tests.house import ROOT


def right(name, found):
    return sum(model.name == name for model in found)


LEAST = {"A1": 0.95, "A2": 0.9, "B": 0.9, "C1": 0.9, "C2": 0.6, "C3": 0.9, "C4": 0.9, "D": 0.9}


@each("name", CLASSES)
def test_processes_of_each_class_are_named(name):
    """25 subgroups of 20."""
    assert right(name, models(name, 25, 20, 20)) >= 20 * LEAST[name] - 1


def test_a_stable_normal_process_is_rarely_called_another():
    """Three tests at 1 %, and two of the spread."""
    assert right("A1", models("A1", 25, 5, 200)) >= 190


@each("name", ["B", "C2", "D"])
def test_what_few_values_do_not_show_is_not_excluded(name):
    """25 subgroups of 5 miss a varying spread, or the shape of the means, in up to 40 %: it is said to be possible."""
    found = models(name, 25, 5, 40)
    assert held(name, found) >= 37
    missed = next(model for model in found if model.name != name and name in model.possible)
    assert missed.label == " or ".join((missed.name, *missed.possible))
    assert f"do not exclude {name} ({WORDS[name]}); 50 groups of 5 would." in missed.text
    assert not any(model.possible for size in GROUPS[1:] for model in models("A1", *size, 5))


def test_the_spread_of_a_few_large_lots_is_looked_at():
    """Of 20 lots of 6,000 parts all lots are, by some of their parts."""
    x = np.random.default_rng(7).normal(size=(20, 6000)) * np.repeat([1.0, 1.2], 10)[:, None]
    found = time_model(x.ravel(), np.repeat(np.arange(20), 6000), "lots")
    assert (found.name, found.groups, found.size) == ("B", 20, 6000)
    assert found.p_spread < 0.01


def test_the_tests_are_those_of_scipy():
    """Conover and Iman's is the analysis of variance of the ranks."""
    x, groups = values("C1", 25, 5, np.random.default_rng(3)), np.repeat(np.arange(25), 5)
    found = time_model(x, groups, "subgroups")
    assert found.p_location == pytest.approx(f_oneway(*rankdata(x).reshape(25, 5)).pvalue, rel=1e-9)
    assert (found.groups, found.size, found.of) == (25, 5, "subgroups")
    assert found.text.startswith(f"{found.name}: {WORDS[found.name]}. It rests on 25 subgroups of 5 or more: ")


def test_groups_are_in_any_arrangement():
    """Values of a group need not be neighbours; consecutive values are groups of five where none are named."""
    x, groups = values("A1", 30, 5, np.random.default_rng(4)), np.repeat(np.arange(30), 5)
    mixed = np.random.default_rng(5).permutation(x.size)
    sorted_by_group = mixed[np.argsort(groups[mixed], kind="stable")]
    assert time_model(x[mixed], groups[mixed], "lots") == time_model(x[sorted_by_group], groups, "lots")
    alone, given = time_model(x, None, ""), time_model(x, groups, "subgroups")
    assert (alone.of, alone.groups, alone.p_location) == ("consecutive values", 30, given.p_location)


@pytest.mark.parametrize(
    ("x", "groups", "words"),
    [
        (np.arange(39.0), None, "39 values"),
        (np.arange(100.0), np.repeat(np.arange(FEWEST_GROUPS - 1), 6)[:100], "lots of two or more values"),
        (np.arange(100.0), np.arange(100), "0 lots"),
        (np.ones(100), None, "do not differ"),
    ],
)
def test_what_is_not_enough_has_no_class(x, groups, words):
    found = time_model(x, groups, "lots")
    assert found.name == ""
    assert words in found.text


def test_many_values_take_little():
    """Of 200,000 values only some groups are looked at in random orders."""
    assert time_model(np.random.default_rng(6).normal(size=200_000), None, "").name == "A1"


@pytest.mark.slow
def test_the_table_of_the_study():
    """To 12 %: more than three standard errors of 200 processes."""
    text = (ROOT / "studies" / "time_models.md").read_text("utf-8")
    rows = dict(line.strip("| ").split(" | ", 1) for line in text.splitlines() if line.startswith("| "))
    for name in CLASSES:
        for cell, (groups, size) in zip(rows[name].split(" | "), GROUPS, strict=True):
            found = models(name, groups, size, 200)
            shares = [right(name, found) / 2, held(name, found) / 2]
            assert shares == pytest.approx([float(cell.split()[at]) for at in (0, 2)], abs=12), (name, groups, size)
