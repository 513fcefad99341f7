"""What the card says of the shape of responses: which tail, whose ppm, how often without reason; Holm's adjustment."""

from dataclasses import replace

import numpy as np
import pytest

from reporting.shape.normality import departs, normality
from reporting.trust.evidence import normal_shape
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


@pytest.fixture(scope="module")
def response():
    """Return a response with both limits and many values."""
    return analysis_of(c60_table(300), c60_spec(300)).responses[0]


def with_shape(response, *samples):
    """Return copies of a response with the shapes of samples."""
    return tuple(
        replace(response, normality=normality(x), spec=replace(response.spec, name=f"R{i}"))
        for i, x in enumerate(samples)
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("draw", "below", "above"),
    [
        (lambda rng: rng.standard_t(5, 5_000), "small", "small"),
        (lambda rng: rng.gamma(16.0, size=5_000), "large", "small"),
        (lambda rng: np.exp(0.5 * rng.normal(size=500)), "large", "small"),
        (lambda rng: rng.uniform(size=1_000), "large", "large"),
    ],
)
def test_the_direction_of_each_tail_and_of_the_ppm(response, draw, below: str, above: str) -> None:
    found = normal_shape(with_shape(response, draw(np.random.default_rng(0))))
    assert found.level == "attention"
    for side, size in (("below", below), ("above", above)):
        assert f"the ppm that a normal distribution predicts {side} the limit is too {size}" in found.text
    assert "Anderson-Darling p <" in found.text


@pytest.mark.parametrize("draw", [lambda r: r.standard_t(5, 500), lambda r: r.gamma(16.0, size=500)])
def test_a_proven_departure_is_never_called_unproven(response, draw) -> None:
    """Before, with p below 0.001 the card said "no departure is proven" in half of such samples."""
    proven = 0
    for seed in range(60):
        shaped = with_shape(response, draw(np.random.default_rng(seed)))
        if shaped[0].normality.anderson_darling_p < 1e-3:
            proven += 1
            found = normal_shape(shaped)
            assert found.level == "attention"
            assert "no departure" not in found.text
            assert shaped[0].normality.verdict == "not normal"
    assert proven > 20


def test_normal_responses_are_called_so_in_nineteen_of_twenty_campaigns(response) -> None:
    """Of 300 campaigns of six normal responses; three standard errors of 5 % are 3.8 %."""
    rng = np.random.default_rng(3)
    false = 0
    for _ in range(300):
        found = normal_shape(with_shape(response, *rng.normal(size=(6, 200))))
        false += found.value > 0
    assert false / 300 <= 0.05 + 0.038


def test_a_count_far_from_the_expectation_is_never_close_enough(response) -> None:
    """67 ppm counted (8 to 241) beside 2,405 expected: 30,000 values of a distribution that ends before the limits."""
    from reporting import capability
    from reporting.capability.shares import nonconforming

    x = np.clip(np.random.default_rng(1).normal(size=30_000), -2.9, 2.9)
    x[:2] = 3.1
    c = capability(x, -3.0, 3.0)
    assert c.ppm_expected > 2_000
    shaped = replace(
        response,
        spec=replace(response.spec, lsl=-3.0, usl=3.0),
        capability=c,
        nonconforming=nonconforming(x, -3.0, 3.0, 0.95),
        normality=normality(x),
    )
    found = normal_shape((shaped,))
    assert found.level == "attention"
    assert "66.7 ppm counted" in found.text


def test_a_close_response_is_good(response) -> None:
    from scipy.special import ndtri

    typical = ndtri((np.arange(30_000) + 0.5) / 30_000)
    found = normal_shape(with_shape(response, typical, typical + 5))
    assert found.level == "good"
    assert found.text.startswith("Every response with limits: close to normal")


@pytest.mark.parametrize(("n", "size"), [(50, 2.5), (400, 20), (4_000, 200)])
def test_values_in_lots_that_cannot_test_the_shape_are_never_close_to_normal(response, n: int, size: float) -> None:
    """Twenty lots are worth some 40 independent values, however many they have; before, the card was silent on them."""
    from reporting import capability

    rng, lots = np.random.default_rng(2), np.floor(np.arange(n) / size).astype(int)
    x = np.exp(0.35 * (rng.normal(size=20)[lots] + rng.normal(size=n)))
    numbers = capability(x, 0.05, 9.0, batches=lots)
    shaped = replace(response, capability=numbers, normality=normality(x, worth=numbers.lots.effective))
    found = normal_shape((shaped,))
    assert found.level != "good"
    assert "worth" in found.text
    assert "cumulative shares may be off by up to" in found.text


def test_a_p_value_counts_for_as_many_responses_as_are_tested() -> None:
    shape = normality(np.random.default_rng(0).normal(size=500))
    assert departs(replace(shape, p=0.009), 4)
    assert not departs(replace(shape, p=0.011), 4)
    assert departs(replace(shape, p=0.9, verdict="not normal"), 4)
