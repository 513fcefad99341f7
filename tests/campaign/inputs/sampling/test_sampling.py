"""A sample is a function of (seed, sample number, variable name) alone, and samplers are as even as they claim."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.stats import chi2, qmc

from campaign.inputs.sampling import draw, sampler_named
from campaign.inputs.sampling.inverse_transform import uniforms
from tests.campaign.inputs.sampling.campaigns import CORRELATED, DRAWING, EVEN, MIXED, UNIT, J, spec
from tests.campaign.statistics import check_sample, strata
from tests.each import each

pytestmark = pytest.mark.bits


@pytest.mark.parametrize("sampler", DRAWING)
@settings(deadline=None, max_examples=40)
@given(st.integers(0, 399), st.integers(1, 100))
def test_any_slice_is_the_same_bits(sampler, first, count):
    """Whatever the batch, its samples are those of the whole: correlated, in production batches, of every sampler."""
    campaign = spec(MIXED, sampler=sampler, correlations=CORRELATED)
    whole = draw(campaign, 0, 400)
    count = min(count, 400 - first)
    for name, values in draw(campaign, first, count).items():
        assert values.shape == (count,)
        assert values.tobytes() == whole[name][first : first + count].tobytes()


@pytest.mark.parametrize("sampler", [*DRAWING, "list"])
def test_more_samples_keep_the_first(sampler):
    """What a sampler says of itself is so: more samples begin with the same bits, or there is a reason."""
    rows = {"table": {"columns": {"a": [0.1, 0.2, 0.3]}}} if sampler == "list" else {}
    few, many = (spec({"a": UNIT}, samples=n, sampler=sampler, **rows) for n in (2, 3))
    kept = draw(few, 0, 2)["a"].tobytes() == draw(many, 0, 3)["a"][:2].tobytes()
    assert kept == (not sampler_named(sampler).not_extendable) == (sampler != "lhs")


def test_why_samples_cannot_be_added():
    """The samplers with a fixed number say so in words."""
    for sampler, reason in (("lhs", "strata"), ("worst_case", "corners"), ("grid", "combinations")):
        assert reason in sampler_named(sampler).not_extendable


@pytest.mark.parametrize("sampler", ["random", "lhs"])
def test_other_variables_do_not_matter(sampler):
    """One more variable, or another order, leaves the others as they were."""
    tables = {f"J{i}": J for i in range(1, 8)}
    more = {"new": {"distribution": "normal", "mean": 0.0, "std": 1.0}, **dict(reversed(tables.items()))}
    drawn, before = (draw(spec(variables, sampler=sampler), 0, 400) for variables in (more, tables))
    assert all(np.array_equal(drawn[name], before[name]) for name in before)


PINNED = {  # samples 5 and 6 of J1, of J2, which is correlated with it, and of a variable with production batches
    "random": ([0.4971820613630954, 0.9422200340396226], [0.21936568719926908, 0.626976962358025], 0.490542038237569),
    "lhs": ([0.9000562569126487, 0.7981560016050935], [0.8634891732221217, 0.4374655913420366], 0.2125113226251645),
    "sobol": ([0.4537109496873838, 0.980794776688], [0.20472535334872755, 0.8426500337545364], 0.11727291673163177),
    "halton": ([0.3488263673156252, 0.5988263673156252], [0.354246606698561, 0.9651944585640979], 0.6555588370288503),
}


@pytest.mark.parametrize("sampler", DRAWING)
def test_drawn_values_never_change(sampler):
    """Keys of streams, scrambles, correlation and shifts are part of the format, too."""
    batched = {**UNIT, "batch": {"size": 2, "std": 0.01}}
    variables = {"J1": UNIT, "J2": UNIT, "bolt": batched}
    drawn = draw(spec(variables, samples=8, sampler=sampler, correlations=[["J1", "J2", 0.5]]), 5, 2)
    first, second, shifted = PINNED[sampler]
    assert drawn["J1"].tolist() == first
    assert drawn["J2"] == pytest.approx(second, rel=1e-13)
    assert drawn["bolt"][1] == pytest.approx(shifted, rel=1e-13)


def test_first_values_never_change():
    """A stored campaign can be extended by a later version: the stream itself is part of the format."""
    assert uniforms(2018, "J1", 0, 3).tolist() == [0.6137961892190279, 0.20385611599472842, 0.8281220665825978]


@pytest.mark.parametrize("sampler", DRAWING)
def test_every_sampler_follows_every_kind_of_distribution(sampler):
    """The shared harness over continuous, cut and discrete variables at once, with correlations."""
    variables = {name: table for name, table in MIXED.items() if name not in ("bolt", "fixed")}
    campaign = spec(variables, samples=16_384, sampler=sampler, correlations=CORRELATED)
    drawn = draw(campaign, 0, 16_384)
    for name, variable in campaign.variables.items():
        check_sample(drawn[name], variable)


@pytest.mark.parametrize("sampler", EVEN)
def test_even_samplers_beat_random_ones(sampler):
    """Centred discrepancy below a random sample's, and a smooth response's mean far nearer, at any of 5 seeds."""

    def points(kind, seed):
        return np.column_stack(
            list(draw(spec(dict.fromkeys("abcd", UNIT), 1024, sampler=kind, seed=seed), 0, 1024).values())
        )

    even, plain = ([points(kind, seed) for seed in range(5)] for kind in (sampler, "random"))
    assert max(map(qmc.discrepancy, even)) < 0.8 * min(map(qmc.discrepancy, plain))
    error = [np.mean([(np.exp(x).sum(axis=1).mean() - 4 * (np.e - 1)) ** 2 for x in xs]) ** 0.5 for xs in (even, plain)]
    assert error[0] < 0.1 * error[1]


@pytest.mark.slow
@pytest.mark.parametrize("sampler", ["sobol", "halton", "saltelli"])
def test_scrambles_are_unbiased(sampler):
    """Over seeds, the value of a fixed sample is uniform: the mean of any response is without bias."""
    for sample in (0, 5):
        u = np.array(
            [draw(spec({"a": UNIT, "b": UNIT}, 8, sampler=sampler, seed=s), sample, 1)["b"][0] for s in range(800)]
        )
        counts = strata(u, 8)
        assert chi2.sf(np.sum((counts - 100.0) ** 2 / 100.0), 7) > 1e-5


ONE = {"a": UNIT, "b": J}


REFUSED = [
    ({"correlations": [["a", "c", 0.5]]}, 'correlations, ."a", "c", 0.5.: no variable c; allowed: a, b'),
    ({"correlations": [["a", "a", 0.5]]}, "a variable cannot be correlated with itself"),
    ({"correlations": [["a", "k", 0.5]]}, "k is a constant"),
    ({"correlations": [["a", "b", 0.5], ["b", "a", 0.5]]}, "given more than once"),
    ({"correlations": [["a", "b", 1.0]]}, "less than 1"),
    ({"correlations": [["a", "b"]]}, "2"),
    (
        {"correlations": [["a", "b", 0.9], ["b", "c2", 0.9], ["a", "c2", -0.9]]},
        r"not positive definite \(smallest eigenvalue -0\.8\d*\); multiply all of them by at most 0\.5\d?",
    ),
    ({"sampler": "worst_case", "correlations": [["a", "b", 0.5]], "samples": 17}, "would ignore it"),
    ({"sampler": "worst_case", "samples": 18}, "4 variables have 16 corners and a middle; write samples = 17"),
    ({"sampler": "lhs", "samples": 10_000_001}, 'samples = 10000001: .* write sampler = "sobol"'),
    (
        {"sampler": "saltelli"},
        r"samples = 400: sampler saltelli needs n \(3 \+ 2\) samples .* write samples = 320 or 640",
    ),
    ({"sampler": "saltelli", "samples": 3}, "write samples = 5 "),
    (
        {"sampler": "saltelli", "samples": 320, "correlations": [["a", "b", 0.5]]},
        "correlations: sampler saltelli changes one variable .* must be independent; remove it",
    ),
    (
        {"sampler": "saltelli", "samples": 320, "stop": {"response": "y", "statistic": "mean", "half_width": 1.0}},
        "stop: samples of sampler saltelli repeat .* remove stop",
    ),
    ({"grid": {"a": 3}}, 'grid is only for sampler "grid"'),
    ({"table": {"columns": {"a": [1.0]}}}, 'table is only for sampler "list"'),
    ({"sampler": "grid"}, "grid.a: missing; give a number of levels"),
    ({"sampler": "grid", "grid": {"a": 3, "b": 2, "c2": 2, "d": 2}}, "grid.d: no variable has this name"),
    ({"sampler": "grid", "grid": {"a": 3, "b": [0.2], "c2": 2}}, "grid.b: value 0.2 .number 0. lies outside"),
    (
        {"sampler": "grid", "grid": {"a": 3, "b": 2, "c2": 2}},
        "samples = 400: the grid has 12 points; write samples = 12",
    ),
    ({"sampler": "grid", "grid": {"a": 1, "b": 2, "c2": 2}}, "greater than or equal to 2"),
    ({"sampler": "list"}, "table: missing"),
    ({"sampler": "list", "table": {"columns": {"a": [1.0]}}}, "table.columns.b: missing; add its column"),
    ({"sampler": "list", "table": {"columns": {"a": [1.0], "b": [0.05, 0.06]}}}, "different lengths .a 1, b 2."),
    ({"sampler": "list", "table": {"file": "x.csv", "columns": {"a": [1.0]}}}, "give file or columns, not both"),
    (
        {"sampler": "list", "table": {"columns": {"a": [1.0], "b": [0.05], "c2": [0.5], "k": [1.0]}}},
        "samples = 400: the table has 1 rows; write samples = 1 or fewer",
    ),
]


@each(("keys", "said"), REFUSED)
def test_what_cannot_be_drawn_is_refused(keys, said):
    """Correlations that cannot hold, and samplers that lack something or would pass over it: key, value, remedy."""
    variables = {**ONE, "c2": UNIT, "k": {"distribution": "constant", "value": 1.0}}
    with pytest.raises(ValidationError, match=said):
        spec(variables, **keys)
