"""Sobol' and Halton sequences, and Saltelli's design: every run is where it belongs; what breaks it is refused."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.stats import qmc

from campaign.inputs.sampling import draw, sampler_named
from campaign.inputs.sampling.quasi_random import DIGITS, MOST_VARIABLES, generators, halton, nearest_sizes, primes
from campaign.inputs.sampling.sampler import varied
from tests.campaign.inputs.sampling.campaigns import BOLT, INDEPENDENT, UNIT, seven, spec
from tests.campaign.statistics import check_rank_correlation, check_sample, strata

pytestmark = pytest.mark.bits

PINNED_DESIGN = {
    "J1": [0.3223122406622535, 0.9233285413272444, 0.9233285413272444, 0.3223122406622535],
    "J2": [0.5499591896583075, 0.03223851188652127, 0.5499591896583075, 0.03223851188652127],
}


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


def design(variables, rows, **keys):
    """Return a campaign of Saltelli's design with so many rows."""
    width = sum(table.get("distribution") != "constant" for table in variables.values()) + 2
    return spec(variables, samples=rows * width, sampler="saltelli", **keys)


def runs(campaign):
    """Return all of a design by run of a row: shape (k + 2, rows, k), constants left out."""
    drawn, names = draw(campaign, 0, campaign.samples), varied(campaign)
    return np.array([drawn[name] for name in names]).reshape(len(names), -1, len(names) + 2).transpose(2, 1, 0)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 383), st.integers(1, 100))
def test_any_slice_of_a_design_is_the_same_bits(first, count):
    """Wherever a batch cuts a row of runs, its samples are those of the whole."""
    campaign = design(INDEPENDENT, 64)
    whole = draw(campaign, 0, 384)
    count = min(count, 384 - first)
    for name, values in draw(campaign, first, count).items():
        assert values.tobytes() == whole[name][first : first + count].tobytes()


def test_a_longer_design_keeps_the_first_rows():
    """Twice the rows begin with the same bits: an extension computes the other half only."""
    few, many = (design(INDEPENDENT, rows) for rows in (64, 128))
    assert not sampler_named("saltelli").not_extendable
    longer = draw(many, 0, many.samples)
    assert all(x.tobytes() == longer[name][: few.samples].tobytes() for name, x in draw(few, 0, few.samples).items())


def test_every_run_of_a_design_follows_every_kind_of_distribution():
    """The shared harness over the samples of A, of B, and of A with each variable of B's: so over all rows together."""
    campaign = design(INDEPENDENT, 16_384)
    of_runs = runs(campaign)
    for j, name in enumerate(varied(campaign)):
        for run in range(of_runs.shape[0]):
            check_sample(of_runs[run, :, j], campaign.variables[name])


def test_a_design_changes_one_variable_at_a_time():
    """Run 2 + j has variable j of B's run and all others of A's, to the bit; A and B have no value in common."""
    of_runs = runs(design({f"v{j}": UNIT for j in range(5)}, 256))
    a, b = of_runs[:2]
    assert not np.any(a == b)
    for j, mixed in enumerate(of_runs[2:]):
        assert np.array_equal(mixed[:, j], b[:, j])
        assert np.array_equal(np.delete(mixed, j, axis=1), np.delete(a, j, axis=1))


def test_the_halves_of_a_design_are_independent():
    """No column of A goes with one of B, nor with another of its own; each half is as even as Sobol points."""
    variables = {f"v{j}": UNIT for j in range(7)}
    a, b, *_ = runs(design(variables, 4096))
    sobol = draw(spec(variables, 4096, sampler="sobol"), 0, 4096)
    assert np.array_equal(a, np.column_stack(list(sobol.values())))
    for x, y in itertools.combinations(np.hstack([a, b]).T, 2):
        check_rank_correlation(x, y, 0.0)
    for u in np.hstack([a, b]).T:
        assert (strata(u, 4096) == 1).all()
        assert (strata(u[:64], 64) == 1).all()


def test_a_design_never_changes():
    """The scrambles of B's dimensions are part of the format, too: a row's A, B and both mixed runs."""
    drawn = draw(design({"J1": UNIT, "J2": UNIT}, 4), 4, 4)
    assert {name: u.tolist() for name, u in drawn.items()} == PINNED_DESIGN


def test_which_samples_of_a_design_are_draws():
    """The first two of each row; of any other sampler all."""
    campaign, sample = design(INDEPENDENT, 4), np.arange(3, 15)
    assert sample[sampler_named("saltelli").independent(campaign, sample)].tolist() == [6, 7, 12, 13]
    assert sampler_named("random").independent(seven(), sample).all()


@given(st.integers(1, 20), st.integers(1, 10_000))
def test_the_remedy_of_a_size_works(variables, samples):
    """Both sizes named are designs, and none lies between them or nearer."""
    sizes, width = nearest_sizes(variables, samples), variables + 2
    assert all(size % width == 0 and (size // width).bit_count() == 1 for size in sizes)
    assert sizes == (samples,) or (len(sizes) == 1 and samples < width) or sizes[0] < samples < sizes[1] == 2 * sizes[0]
    design(dict.fromkeys(map(str, range(variables)), UNIT), sizes[0] // width)


def test_a_design_has_dimensions_for_its_variables():
    """Twice the most variables have direction numbers, one more would not."""
    assert 2 * MOST_VARIABLES <= qmc.Sobol.MAXDIM < 2 * (MOST_VARIABLES + 1)


def test_a_design_needs_variables_that_are_independent_and_vary():
    """A shift that samples share would break it; with constants alone there is nothing to exchange."""
    with pytest.raises(ValidationError, match=r"variables\.bolt\.batch.*saltelli"):
        spec({"a": UNIT, "bolt": BOLT}, samples=8, sampler="saltelli")
    with pytest.raises(ValidationError, match=r"variables: .*saltelli"):
        spec({"fixed": {"distribution": "constant", "value": 1.0}}, samples=8, sampler="saltelli")
