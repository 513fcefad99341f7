"""A sample is a function of (seed, sample number, variable name) alone, and samplers are as even as they claim."""

import itertools
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.stats import chi2, norm, qmc, spearmanr

from campaign.inputs.distributions import Continuous, ProductionBatch
from campaign.inputs.sampling import draw, production_batch, sampler_named
from campaign.inputs.sampling.correlation import correlated
from campaign.inputs.sampling.halton import halton, primes
from campaign.inputs.sampling.sobol import DIGITS, generators
from campaign.inputs.sampling.streams import uniforms
from campaign.spec.campaign_file import CampaignSpec
from tests.campaign.statistics import SURE, check_moments, check_rank_correlation, check_sample, strata

J = {"mean": 0.07, "std": 0.0175, "lower": 0.01, "upper": 0.13}
UNIT = {"distribution": "uniform", "lower": 0.0, "upper": 1.0}
BOLT = {"distribution": "normal", "mean": 8.0, "std": 0.1, "batch": {"size": 17, "std": 0.2}}
DRAWING = ("random", "lhs", "sobol", "halton")
EVEN = ("lhs", "sobol", "halton")
MIXED = {
    "J1": J,
    "J2": J,
    "count": {"distribution": "poisson", "rate": 4.0},
    "life": {"distribution": "weibull", "shape": 1.5, "scale": 2.0},
    "fixed": {"distribution": "constant", "value": 3.0},
    "bolt": BOLT,
}
INDEPENDENT = {name: table for name, table in MIXED.items() if name != "bolt"}
CORRELATED = [["J1", "J2", 0.6], ["J2", "count", -0.4], ["life", "J1", 0.3]]


def spec(variables, samples=400, **keys):
    """Return a campaign of these variables."""
    tables = {"name": "demo", "mechanism": "c60", "seed": 2018, "format": 1}
    return CampaignSpec.model_validate({**tables, "samples": samples, "variables": variables, **keys})


def seven(**keys):
    """Return a campaign of the C-60's seven clearances."""
    return spec({f"J{i}": J for i in range(1, 8)}, **keys)


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


def test_uncorrelated_variables_do_not_matter():
    """Correlating two variables leaves the first of them and all others as they were."""
    free, tied = seven(), seven(correlations=[["J4", "J2", 0.5]])
    drawn, before = draw(tied, 0, 400), draw(free, 0, 400)
    assert [name for name in before if not np.array_equal(drawn[name], before[name])] == ["J4"]


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
    assert uniforms(2018, "J1", 0, 3).tolist() == [
        0.6137961892190279,
        0.20385611599472842,
        0.8281220665825978,
    ]


def test_threads_do_not_mix():
    """Two threads that draw at the same time get what one gets alone."""
    alone, wrong = uniforms(1, "a", 0, 1000).tobytes(), []

    def many(name):
        for _ in range(300):
            if name == "a" and uniforms(1, name, 0, 1000).tobytes() != alone:
                wrong.append(name)
            uniforms(2, name, 5, 999)

    threads = [threading.Thread(target=many, args=(name,)) for name in "abab"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_seeds_and_names_give_unrelated_streams():
    """No two streams are correlated beyond chance (n = 20,000: 5 standard errors are 0.035)."""
    streams = [uniforms(seed, name, 0, 20_000) for seed in (0, 1, 2**63 - 1) for name in ("J1", "J2", "J10", "é")]
    correlation = np.corrcoef(streams) - np.eye(len(streams))
    assert np.abs(correlation).max() < 0.035


def test_strictly_inside_the_unit_interval():
    """The quantile of 0 or 1 may be infinite: neither is drawn, not even from extreme words."""
    u = uniforms(3, "x", 0, 200_000)
    assert 0.0 < u.min() < 1e-4
    assert 1.0 - 1e-4 < u.max() < 1.0
    assert ((np.uint64(2**64 - 1) >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52 < 1.0


@pytest.mark.parametrize("sampler", DRAWING)
def test_every_sampler_follows_every_kind_of_distribution(sampler):
    """The shared harness over continuous, cut and discrete variables at once, with correlations."""
    variables = {name: table for name, table in MIXED.items() if name not in ("bolt", "fixed")}
    campaign = spec(variables, samples=16_384, sampler=sampler, correlations=CORRELATED)
    drawn = draw(campaign, 0, 16_384)
    for name, variable in campaign.variables.items():
        check_sample(drawn[name], variable)


@pytest.mark.parametrize("sampler", DRAWING)
def test_rank_correlations_are_those_asked_for(sampler):
    """Spearman's correlation is the one given, of continuous variables of any shape; without an entry there is none."""
    variables = {name: {**J, "target": name} for name in ("a", "b")}
    variables["c"] = {"distribution": "lognormal", "log_mean": 0.0, "log_std": 1.0}
    wanted = {("a", "b"): 0.7, ("b", "c"): -0.5, ("a", "c"): -0.2}
    triples = [[*pair, rank] for pair, rank in wanted.items()]
    drawn = draw(spec(variables, samples=65_536, sampler=sampler, correlations=triples), 0, 65_536)
    for (a, b), rank in wanted.items():
        check_rank_correlation(drawn[a], drawn[b], rank)
    free = draw(spec(variables, samples=65_536, sampler=sampler), 0, 65_536)
    for a, b in wanted:
        check_rank_correlation(free[a], free[b], 0.0)


def test_extreme_correlations_stay_inside():
    """A mixed score that no double can tell from certainty is still inside (0, 1)."""
    largest = np.array([2.0**-53, 1.0 - 2.0**-53])
    mixed = correlated({"a": largest, "b": largest, "c": largest}, (("a", "c", 0.68), ("b", "c", 0.68)))
    assert 0.0 < mixed["c"].min() < mixed["c"].max() < 1.0


@pytest.mark.parametrize("samples", [1, 7, 400, 1000])
def test_lhs_has_one_sample_in_each_stratum(samples):
    """Every one-dimensional projection, whatever the number of samples."""
    drawn = draw(spec({"a": UNIT, "b": UNIT}, samples=samples, sampler="lhs"), 0, samples)
    for u in drawn.values():
        assert (strata(u, samples) == 1).all()
    assert samples < 7 or not np.array_equal(drawn["a"], drawn["b"])


@pytest.mark.parametrize("k", [0, 1, 5, 10])
def test_sobol_is_balanced(k):
    """The first 2^k samples have one in each of 2^k strata of each variable, and so has every later block of them."""
    drawn = draw(spec({f"v{i}": UNIT for i in range(12)}, samples=4096, sampler="sobol"), 0, 4096)
    for u in drawn.values():
        assert (strata(u[: 2**k], 2**k) == 1).all()
        assert (strata(u[3 * 2**k : 4 * 2**k], 2**k) == 1).all()


def test_sobol_pairs_are_nets():
    """The first two variables are a (0, m, 2)-net: one of 2^10 points in every elementary rectangle."""
    a, b = draw(spec({"a": UNIT, "b": UNIT}, samples=1024, sampler="sobol"), 0, 1024).values()
    for k in range(11):
        cell = (a * 2**k).astype(int) * 2 ** (10 - k) + (b * 2 ** (10 - k)).astype(int)
        assert np.unique(cell).size == 1024


def test_generators_are_scipys():
    """The unscrambled points are the set that scipy's engine gives."""
    columns, number = generators(9, 8), np.arange(256, dtype=np.uint64)
    points = np.zeros((256, 9), dtype=np.uint64)
    for k, column in enumerate(columns):
        points ^= column * (number >> np.uint64(k) & np.uint64(1))[:, None]
    theirs = qmc.Sobol(9, scramble=False).random(256)
    ours = points * 2.0**-DIGITS
    assert np.array_equal(np.sort(ours, axis=0), np.sort(theirs, axis=0))
    assert {tuple(row) for row in ours} == {tuple(row) for row in theirs}


def test_halton_is_balanced_in_every_base():
    """The first b^k samples have one in each of b^k strata of the variable with base b."""
    names = [f"v{i}" for i in range(6)]
    drawn = halton(7, names, 0, 2401)
    for name, base in zip(names, primes(6), strict=True):
        size = base ** int(np.log(2401.5) / np.log(base))
        assert (strata(drawn[name][:size], size) == 1).all()


def test_halton_permutes_every_digit():
    """Digit by digit the points are permuted radical inverses, in a different way for every digit, seed and name."""
    number, base = np.arange(625), 5
    u = halton(7, ["a", "b", "c"], 0, 625)["c"]
    digits = (u[:, None] * base ** np.arange(1, 5)).astype(int) % base
    maps = [[set(digits[number // base**k % base == d, k].tolist()) for d in range(base)] for k in range(4)]
    assert all(len(image) == 1 for images in maps for image in images)
    assert len({tuple(min(image) for image in images) for images in maps}) > 1
    assert not np.array_equal(u, halton(8, ["a", "b", "c"], 0, 625)["c"])


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


def test_parts_come_in_batches():
    """Samples of a batch share their shift; shifts are independent and of the deviation asked for."""
    size, batches = 50, 800
    bolt = {**BOLT, "batch": {"size": size, "std": 0.2}}
    campaign = spec({"bolt": bolt, "nut": bolt}, samples=size * batches)
    drawn = {name: x.reshape(batches, size) for name, x in draw(campaign, 0, size * batches).items()}
    means = drawn["bolt"].mean(axis=1)
    assert abs(drawn["bolt"].std(axis=1, ddof=1).mean() - 0.1) < 0.001
    expected = np.hypot(0.2, 0.1 / np.sqrt(size))
    assert abs(means.std() - expected) < SURE * expected / np.sqrt(2 * batches)
    assert abs(means.mean() - 8.0) < SURE * expected / np.sqrt(batches)
    for other in (drawn["nut"].mean(axis=1), np.roll(means, 1)):
        assert abs(spearmanr(means, other).statistic) < SURE / np.sqrt(batches)


def test_a_batch_of_one_is_the_mixture():
    """With a new shift for every part, parts are independent draws of what `cdf` and `moments` describe."""
    tables = {"size": 1, "std": 0.02}
    variables = {"cut": {**J, "batch": tables}, "free": {**BOLT, "batch": tables}}
    campaign = spec(variables, samples=20_000)
    for name, values in draw(campaign, 0, 20_000).items():
        check_sample(values, campaign.variables[name])
        check_moments(values, campaign.variables[name])
        assert isinstance(campaign.variables[name], Continuous)


def test_shifts_have_their_own_stream():
    """A variable's shift is not a function of its own values: batch 0 and sample 0 use different words."""
    batch = ProductionBatch(size=1, std=1.0)
    shift = [batch.shifts(uniforms(seed, "bolt", 0, 1, "batch\n"))[0] for seed in range(400)]
    value = [norm.ppf(uniforms(seed, "bolt", 0, 1))[0] for seed in range(400)]
    assert abs(spearmanr(shift, value).statistic) < SURE / 20.0


def test_production_batch_of_a_sample():
    """Numbers go up where any variable begins a new batch; without batches there are none."""
    sizes = [4, 6]
    variables = {f"v{n}": {**BOLT, "batch": {"size": n, "std": 0.1}} for n in sizes}
    sample = np.arange(30)
    number = production_batch(spec(variables), sample)
    assert number.tolist() == [sum(1 for k in range(1, i + 1) if k % 4 == 0 or k % 6 == 0) for i in range(30)]
    assert production_batch(spec(variables), sample[20:]).tolist() == number[20:].tolist()
    assert production_batch(spec({"bolt": BOLT}), np.array([0, 16, 17, 400])).tolist() == [0, 0, 1, 23]
    assert production_batch(seven(), sample) is None


def test_corners_are_every_combination_of_ends_and_the_middle():
    """Bit j of the sample number is the end of variable j; any piece of them is the same as in the whole."""
    ranges = {"a": (0.0, 1.0), "b": (2.0, 4.0), "c": (-1.0, 1.0)}
    variables = {name: {"distribution": "uniform", "lower": low, "upper": high} for name, (low, high) in ranges.items()}
    campaign = spec(variables, samples=9, sampler="worst_case")
    whole = draw(campaign, 0, 9)
    rows = list(zip(*whole.values(), strict=True))
    assert set(rows[:8]) == set(itertools.product(*ranges.values()))
    assert rows[5] == (1.0, 2.0, 1.0)
    assert rows[8] == (0.5, 3.0, 0.0)
    piece = draw(campaign, 3, 4)
    assert all((piece[name] == whole[name][3:7]).all() for name in variables)


def test_grid_is_every_combination_of_levels():
    """Levels by number from end to end, or as given; a constant needs none; any piece is that of the whole."""
    variables = {"a": UNIT, "k": {"distribution": "constant", "value": 9.0}, "b": J}
    campaign = spec(variables, samples=6, sampler="grid", grid={"b": [0.03, 0.05], "a": 3})
    whole = draw(campaign, 0, 6)
    rows = list(zip(*whole.values(), strict=True))
    assert sorted(rows) == sorted(itertools.product([0.0, 0.5, 1.0], [9.0], [0.03, 0.05]))
    piece = draw(campaign, 2, 3)
    assert all((piece[name] == whole[name][2:5]).all() for name in variables)


def test_list_is_the_users_table():
    """Row i is sample i; columns that are no variable were left out when it was read."""
    columns = {"b": [0.03, 0.05, 0.04], "a": [0.0, 0.5, 1.0]}
    campaign = spec({"a": UNIT, "b": J}, samples=2, sampler="list", table={"columns": columns})
    assert {name: x.tolist() for name, x in draw(campaign, 1, 1).items()} == {"a": [0.5], "b": [0.05]}
    assert list(draw(campaign, 0, 2)) == ["a", "b"]


ONE = {"a": UNIT, "b": J}
REFUSED = [
    ({"correlations": [["a", "c", 0.5]]}, 'correlations, ."a", "c", 0.5.: no variable c; allowed: a, b'),
    ({"correlations": [["a", "a", 0.5]]}, "a variable with itself"),
    ({"correlations": [["a", "k", 0.5]]}, "k is a constant"),
    ({"correlations": [["a", "b", 0.5], ["b", "a", 0.5]]}, "given more than once"),
    ({"correlations": [["a", "b", 1.0]]}, "less than 1"),
    ({"correlations": [["a", "b"]]}, "2"),
    (
        {"correlations": [["a", "b", 0.9], ["b", "c2", 0.9], ["a", "c2", -0.9]]},
        r"not positive definite \(smallest eigenvalue -0\.8\d*\); all of them multiplied by 0\.5\d? can",
    ),
    ({"sampler": "worst_case", "correlations": [["a", "b", 0.5]], "samples": 17}, "would pass it over"),
    ({"sampler": "worst_case", "samples": 18}, "4 variables have 16 corners and a middle; write samples = 17"),
    ({"sampler": "lhs", "samples": 10_000_001}, 'samples = 10000001: .* write sampler = "sobol"'),
    (
        {"sampler": "saltelli"},
        r"samples = 400: sampler saltelli has n \(3 \+ 2\) samples .* write samples = 320 or 640",
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
    ({"grid": {"a": 3}}, 'grid is only read by sampler "grid"'),
    ({"table": {"columns": {"a": [1.0]}}}, 'table is only read by sampler "list"'),
    ({"sampler": "grid"}, "grid.a: missing; give a number of levels"),
    ({"sampler": "grid", "grid": {"a": 3, "b": 2, "c2": 2, "d": 2}}, "grid.d: no variable of that name"),
    ({"sampler": "grid", "grid": {"a": 3, "b": [0.2], "c2": 2}}, "grid.b: value 0.2 .number 0. lies outside"),
    (
        {"sampler": "grid", "grid": {"a": 3, "b": 2, "c2": 2}},
        "samples = 400: the grid has 12 points; write samples = 12",
    ),
    ({"sampler": "grid", "grid": {"a": 1, "b": 2, "c2": 2}}, "greater than or equal to 2"),
    ({"sampler": "list"}, "table: missing"),
    ({"sampler": "list", "table": {"columns": {"a": [1.0]}}}, "table.columns.b: missing; add its column"),
    ({"sampler": "list", "table": {"columns": {"a": [1.0], "b": [0.05, 0.06]}}}, "different lengths .a 1, b 2."),
    ({"sampler": "list", "table": {"file": "x.csv", "columns": {"a": [1.0]}}}, "either file or columns"),
    (
        {"sampler": "list", "table": {"columns": {"a": [1.0], "b": [0.05], "c2": [0.5], "k": [1.0]}}},
        "samples = 400: the table has 1 rows; write samples = 1 or fewer",
    ),
]


@pytest.mark.parametrize(("keys", "said"), REFUSED)
def test_what_cannot_be_drawn_is_refused(keys, said):
    """Correlations that cannot hold, and samplers that lack something or would pass over it: key, value, remedy."""
    variables = {**ONE, "c2": UNIT, "k": {"distribution": "constant", "value": 1.0}}
    with pytest.raises(ValidationError, match=said):
        spec(variables, **keys)


def test_the_remedy_of_impossible_correlations_works():
    """Scaled as the message says, they can hold; a little more, and they cannot."""
    triples = [["a", "b", 0.9], ["b", "c", 0.9], ["a", "c", -0.9]]
    variables = dict.fromkeys("abc", UNIT)
    with pytest.raises(ValidationError) as caught:
        spec(variables, correlations=triples)
    scale = float(str(caught.value).split("multiplied by ")[1].split()[0])
    spec(variables, correlations=[[a, b, scale * r] for a, b, r in triples])
    with pytest.raises(ValidationError, match="not positive definite"):
        spec(variables, correlations=[[a, b, (scale + 0.01) * r] for a, b, r in triples])


@pytest.mark.parametrize("sampler", ["worst_case", "grid", "list"])
def test_batches_are_not_passed_over(sampler):
    """A sampler that draws nothing refuses variables that vary by production batch."""
    more = {"grid": {"grid": {"a": 2}}, "list": {"table": {"columns": {"a": [0.5]}}}}.get(sampler, {})
    with pytest.raises(ValidationError, match=r"variables\.a\.batch: sampler .* would pass it over"):
        spec({"a": {**UNIT, "batch": {"size": 2, "std": 0.01}}}, samples=1, sampler=sampler, **more)
