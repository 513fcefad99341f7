"""Allocation against Lagrange's closed form, an interior point method, the KKT conditions and fresh samples."""

import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize, stats

from reporting import ReportError
from reporting.tolerance.allocation import CostedVariable, Requirement, allocate
from reporting.tolerance.cost_laws import PowerLaw
from reporting.tolerance.cost_optimum import cheapest
from reporting.tolerance.reweighting import Change

B = np.array([1.0, 3.0, 0.5, 2.0])
SENSITIVITY = np.array([1.0, -0.5, 2.0, 1.5])
NOW = np.array([0.02, 0.03, 0.01, 0.02])


def joints(**changes):
    """Return four joints; a change is a tuple of one value a joint."""
    made = [CostedVariable(f"J{i + 1}", float(NOW[i]), PowerLaw(0.1, float(B[i])), 1e-4, 1.0) for i in range(4)]
    for name, values in changes.items():
        made = [dataclasses.replace(j, **{name: value}) for j, value in zip(made, values, strict=True)]
    return made


def requirement(target=1.33, mean=10.0, rest=0.0, name="gap", lsl=9.85, usl=10.15, sensitivity=SENSITIVITY):
    """Return a linear response: sigma_i is a third of the tolerance."""
    variances = (sensitivity * NOW / 3) ** 2
    std = math.sqrt(variances.sum() + rest)
    return Requirement(name, mean, std, lsl, usl, target, {f"J{i + 1}": v / std**2 for i, v in enumerate(variances)})


def test_one_response_without_bounds_is_lagranges():
    """t_i = (b_i / (2 lambda c_i))^(1/3), the multiplier from the constraint; the price is the derivative of cost."""
    found = allocate(joints(), [requirement()])
    c = (SENSITIVITY / 3) ** 2
    shape = (B / c) ** (1 / 3)
    allowed = (0.15 / (3 * 1.33)) ** 2
    expected = shape * math.sqrt(allowed / np.sum(c * shape**2))
    assert np.array(list(found.tolerances.values())) == pytest.approx(expected, rel=1e-6)
    assert found.cost == pytest.approx(0.4 + np.sum(B / expected), rel=1e-7)
    assert found.cost_now == pytest.approx(0.4 + np.sum(B / NOW))
    response = found.responses[0]
    assert response.binding
    assert response.cpk == pytest.approx(1.33, rel=1e-7)
    dearer, cheaper = (allocate(joints(), [requirement(1.33 + d)]).cost for d in (0.005, -0.005))
    assert response.price == pytest.approx(dearer - cheaper, rel=1e-3)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_bounds_and_several_responses_are_optimal(seed):
    """Random programmes: as cheap as an interior point method finds, feasible, and the KKT conditions hold."""
    rng = np.random.default_rng(seed)
    k, r = rng.integers(1, 7), rng.integers(1, 5)
    cost, rate = rng.uniform(0.1, 3, k), rng.uniform(0, 1, (r, k)) * (rng.random((r, k)) < 0.8)
    lower = rng.uniform(0.05, 0.3, k)
    upper = lower * rng.uniform(1.0, 8, k)
    room = rate @ (lower + rng.uniform(0.1, 0.9) * (upper - lower)) ** 2 * rng.uniform(0.9, 1.5, r)
    feasible = np.all(rate @ lower**2 < room)
    found = cheapest([PowerLaw(0.0, float(b)) for b in cost], rate, room, lower, upper)
    assert (found is not None) == (feasible or np.all(rate @ lower**2 <= room))
    if found is None:
        return
    t = found.tolerance
    assert np.all(t >= lower * (1 - 1e-12))
    assert np.all(t <= upper * (1 + 1e-12))
    slack = room - rate @ t**2
    assert np.all(slack >= -1e-12)
    interior = optimize.minimize(
        lambda u: np.sum(cost / u),
        lower + 1e-3 * (upper - lower),
        jac=lambda u: -cost / u**2,
        hess=lambda u: np.diag(2 * cost / u**3),
        bounds=list(zip(lower, upper, strict=True)),
        constraints=optimize.NonlinearConstraint(
            lambda u: rate @ u**2, -np.inf, room, lambda u: 2 * rate * u, lambda _, v: np.diag(2 * rate.T @ v)
        ),
        method="trust-constr",
        options={"gtol": 1e-10, "maxiter": 300},
    )
    total = np.sum(cost / t)
    if np.all(room - rate @ interior.x**2 > -1e-9):
        assert total <= np.sum(cost / interior.x) * (1 + 1e-7)
    # Stationarity: what the prices do not balance pushes against a bound.
    push = -cost / t**2 + 2 * t * (rate.T @ found.price)
    inner = (t > lower * (1 + 1e-5)) & (t < upper * (1 - 1e-5))
    size = cost / t**2
    assert np.all(np.abs(push[inner]) < 1e-5 * size[inner])
    assert np.all(push[t >= upper * (1 - 1e-5)] < 1e-5 * size[t >= upper * (1 - 1e-5)])
    assert np.all(found.price * slack <= 1e-8 * total)


def test_locks_and_bounds_hold():
    """A locked joint stays, the others make room for it."""
    found = allocate(joints(locked=(False, True, False, False), upper=(0.012, 1.0, 1.0, 1.0)), [requirement()])
    assert found.factors["J2"] == 1.0
    assert found.tolerances["J1"] == pytest.approx(0.012, rel=1e-6)
    assert found.responses[0].cpk == pytest.approx(1.33, rel=1e-6)
    everything = allocate(joints(locked=(True,) * 4), [requirement(target=0.5)])
    assert list(everything.factors.values()) == [1.0] * 4
    assert everything.cost == everything.cost_now
    assert not everything.responses[0].binding


def test_the_loosest_response_costs_nothing():
    """Two responses: one binds, the other has no price."""
    loose = requirement(name="loose", lsl=0.0, usl=None)
    found = allocate(joints(), [requirement(), loose])
    assert [r.binding for r in found.responses] == [True, False]
    assert found.responses[1].price < 1e-6 * found.responses[0].price


@pytest.mark.parametrize(
    ("wanted", "why"),
    [
        (requirement(mean=10.2), "gap: its mean 10.2 is out of limits"),
        (requirement(rest=1.0), "gap: with every tolerance at its lower bound Cpk is 0.050; the target is 1.33"),
    ],
)
def test_what_cannot_be_kept_is_refused(wanted, why):
    """With the response, the number and the remedy."""
    found = allocate(joints(), [wanted])
    assert found.refusal.startswith(why)
    assert (found.tolerances, found.cost) == ({}, None)
    json.dumps(dataclasses.asdict(found), allow_nan=False)


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        (([], [requirement()]), "at least one variable"),
        ((joints(law=[PowerLaw(0.1, b) for b in (1.0, 0.0, 1.0, 1.0)]), [requirement()]), "J2: .* above 0"),
        ((joints(lower=(1.0, 2.0, 1.0, 1.0)), [requirement()]), "J2: .* lower bound"),
        ((joints(), [requirement(target=-1.0)]), "target"),
        ((joints(), [requirement(), requirement()]), "'gap' is given twice"),
        ((joints(), [requirement(lsl=None, usl=None)]), "no limits"),
    ],
)
def test_impossible_questions_raise(bad, why):
    """They name joint or response."""
    with pytest.raises(ReportError, match=why):
        allocate(*bad)


def curved(z):
    """Return a response that is not linear in its two clearances."""
    return 10 + 0.04 * z[:, 0] + 0.02 * z[:, 1] + 0.012 * z[:, 0] ** 2 + 0.01 * z[:, 0] * z[:, 1]


def curved_cpk(factors):
    """Return the Cpk of the curved response within 9.75 and 10.25, in closed form."""
    one, two = factors["J1"], factors["J2"]
    mean = 10 + 0.012 * one**2
    variance = (0.04 * one) ** 2 + (0.02 * two) ** 2 + 2 * (0.012 * one**2) ** 2 + (0.01 * one * two) ** 2
    return min(mean - 9.75, 10.25 - mean) / (3 * math.sqrt(variance))


def test_the_interval_of_a_proposal_contains_its_cpk():
    """40 campaigns of 500 samples: about half of the proposals miss the target, and the interval says by how much."""
    inside, missed, told = 0, 0, 0
    for seed in range(40):
        z = np.random.default_rng(seed).normal(size=(500, 2))
        y = curved(z)
        wanted = Requirement("y", y.mean(), y.std(), 9.75, 10.25, 1.5, {"J1": 0.7, "J2": 0.18})
        costs = [CostedVariable(f"J{i + 1}", 1.0, PowerLaw(0.0, 1 / 4**i), 0.8, 1.2) for i in range(2)]

        def rescale(factors, rows, z=z):
            scale = np.array([factors["J1"], factors["J2"]])
            return Change(stats.norm.logpdf(z[rows], scale=scale) - stats.norm.logpdf(z[rows]))

        found = allocate(costs, [wanted], {"y": y}, rescale)
        if found.refusal or found.method != "reweighting":
            continue
        (response,) = found.responses
        low, high = response.cpk_interval
        true = curved_cpk(found.factors)
        inside, missed = inside + (low <= true <= high), missed + (true < 1.5)
        told += any("below the target" in note for note in found.notes)
    assert inside >= 40 * 0.95 - 3 * (40 * 0.95 * 0.05) ** 0.5
    assert missed >= 10
    assert told >= 25


def test_reweighting_corrects_what_is_not_linear():
    """A fresh campaign with the proposed sigmas has the wanted Cpk; without the correction it has not."""
    rng = np.random.default_rng(1)
    z = rng.normal(size=(40_000, 2))
    y = curved(z)
    mean, std = float(y.mean()), float(y.std())
    wanted = Requirement("y", mean, std, 9.75, 10.25, 1.5, {"J1": 0.0016 / std**2, "J2": 0.0004 / std**2})
    costs = [
        CostedVariable("J1", 1.0, PowerLaw(0.0, 1.0), 0.2, 5.0),
        CostedVariable("J2", 1.0, PowerLaw(0.0, 0.25), 0.2, 5.0),
    ]

    def rescale(factors, rows):
        scale = np.array([factors["J1"], factors["J2"]])
        return Change(stats.norm.logpdf(z[rows], scale=scale) - stats.norm.logpdf(z[rows]))

    def fresh(found):
        scale = np.array([found.factors["J1"], found.factors["J2"]])
        y = curved(np.random.default_rng(2).normal(size=(400_000, 2)) * scale)
        return min(y.mean() - 9.75, 10.25 - y.mean()) / (3 * y.std())

    plain, corrected = allocate(costs, [wanted]), allocate(costs, [wanted], {"y": y}, rescale)
    assert (plain.method, corrected.method) == ("variance contributions", "reweighting")
    assert [note.startswith("y: the 95 % interval of Cpk begins at 1.4") for note in corrected.notes] == [True]
    assert "no interval of Cpk" in plain.notes[-1]
    assert fresh(corrected) == pytest.approx(1.5, rel=0.012)  # Cpk of 40,000 samples, reweighted: 0.5 % and some
    assert abs(fresh(plain) - 1.5) > 2 * abs(fresh(corrected) - 1.5)
    assert corrected.responses[0].cpk == pytest.approx(1.5, rel=2e-3)


def test_degenerate_weights_leave_the_linear_model():
    """And the note says that the numbers are not corrected."""
    found = allocate(joints(), [requirement()], {"gap": np.zeros(50)}, lambda factors, rows: Change(np.zeros(50)))
    assert found.method == "variance contributions"
    assert "worth 50" in found.notes[0]
    assert found.responses[0].cpk_interval is None
    assert found.responses[0].cpk == pytest.approx(1.33, rel=1e-6)


@pytest.mark.parametrize("rho", [-0.3, 0.6])
def test_correlated_tolerances_keep_the_target_together_or_are_refused(rho):
    """Fresh correlated samples of the proposal have the target Cpk; where the weights do not reach, none is made."""
    scores = np.array([[1.0, rho], [rho, 1.0]])
    mixed, inverse = np.linalg.cholesky(scores).T, np.linalg.inv(scores)
    z = np.random.default_rng(3).normal(size=(40_000, 2)) @ mixed
    weight = np.array([1.0, 0.6])
    sigma = math.sqrt(weight @ scores @ weight)
    shares = {f"J{i + 1}": weight[i] ** 2 / sum(weight**2) for i in range(2)}

    def rescale(factors, rows):
        scaled = z[rows] / list(factors.values())
        old, new = (np.einsum("ij,jk,ik->i", x, inverse, x) for x in (z[rows], scaled))
        return Change((old - new) / 2)

    def ask(now, rescale):
        limit = 3 * now * sigma
        wanted = Requirement("y", 0.0, sigma, -limit, limit, 1.33, shares)
        costs = [CostedVariable(f"J{i + 1}", 1.0, PowerLaw(0.0, 1.0), 0.2, 5.0) for i in range(2)]
        return allocate(costs, [wanted], {"y": z @ weight}, rescale, correlated=True)

    found = ask(1.36, rescale)
    scaled = weight * list(found.factors.values())
    assert found.method == "reweighting"
    assert 1.36 * sigma / math.sqrt(scaled @ scores @ scaled) == pytest.approx(1.33, rel=0.012)
    assert "correlated" in found.notes[-1]
    far = ask(6.0, rescale)
    assert (far.tolerances, far.cost) == ({}, None)
    assert "variables are correlated" in far.refusal
    assert "variables are correlated" in ask(1.36, None).refusal
