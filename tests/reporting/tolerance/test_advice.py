"""How far a spread may grow: against closed forms and fresh simulation, also of correlated and skewed variables."""

import math

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import brentq

from reporting import ReportError, capability
from reporting.emulation.emulated_tolerances import EmulatedTolerances
from reporting.tolerance.advice import (
    BY_BOUNDS,
    BY_SAMPLES,
    EMULATION,
    LEAST_FACTOR,
    REWEIGHTING,
    AdvisedSamples,
    DecidingIndex,
    advise,
    tolerance_advice,
)
from reporting.tolerance.reweighting import Change
from reporting.tolerance.whatif import what_if

RNG = np.random.default_rng(41)
N = 40_000
A = np.array([1.0, 0.5, 0.25])
Z = RNG.normal(size=(N, 3))
Y = Z @ A
SIGMA = math.sqrt(np.sum(A**2))
SHARES = {f"J{i + 1}": a**2 / SIGMA**2 for i, a in enumerate(A)}


def widening(z, scores=None):
    """Return the change of one normal variable's sigma; `scores` is the correlation matrix of all of them."""
    excess = np.linalg.inv(np.eye(z.shape[1]) if scores is None else scores)

    def widen(variable, factor, rows):
        old, i = z[rows], int(variable[1]) - 1
        new = old.copy()
        new[:, i] /= factor
        before, after = (np.einsum("ij,jk,ik->i", x, excess, x) for x in (old, new))
        return Change((before - after) / 2 - math.log(factor), spread=factor)

    return widen


FRESH = stats.norm.ppf(stats.qmc.Sobol(3, rng=8).random(8192))


def emulators(z, y, limits, mixed=None):
    """Return the emulator of a response by rows of normal variables; `mixed` makes them correlated."""

    def drawn(factors):
        fresh = FRESH if mixed is None else FRESH @ mixed
        return {f"J{i + 1}": fresh[:, i] * factors.get(f"J{i + 1}", 1.0) for i in range(3)}

    return EmulatedTolerances({f"J{i + 1}": z[:, i] for i in range(3)}, {"y": y}, {"y": limits}, drawn)


def ask(cpk_now, target, change=None, variables=("J1", "J2", "J3")):
    """Return the advice on a response with limits that give it an index now."""
    limit = 3 * cpk_now * SIGMA
    emulation = emulators(Z, Y, (-limit, limit))
    limits = {"y": (-limit, limit)}
    return advise({"y": Y}, limits, {"y": target}, variables, change or widening(Z), emulation=emulation)


def exact(variable, cpk_now, target):
    """Return sqrt(1 + ((now / target)^2 - 1) / S): the factor of sigma_i that brings Cpk to its target."""
    grown = 1 + ((cpk_now / target) ** 2 - 1) / SHARES[variable]
    return math.sqrt(grown) if grown > 0 else None


def test_a_weighted_sum_in_closed_form():
    """Each interval holds the exact factor, the factor lies in it, and Cpk there is on target."""
    for advice in ask(1.5, 1.33)[:2]:
        factor, (low, high) = exact(advice.variable, 1.5, 1.33), advice.interval
        assert low <= factor
        assert high is None or factor <= high
        assert low < advice.factor
        assert advice.factor == pytest.approx(factor, rel=0.05)
        assert advice.bounded
        assert advice.binding == "y"
    first = ask(1.5, 1.33)[0]
    assert first.method == REWEIGHTING
    assert first.effective > 1000
    assert first.cpk == pytest.approx(1.33, abs=2e-3)


def test_beyond_the_reach_of_weights_an_emulator_answers():
    """J1 to 1.6 with few values beyond those of the campaign; J2 to 2.5 would be extrapolation and is not answered."""
    (advice,) = ask(2.0, 1.33, variables=("J1",))
    assert (advice.method, advice.effective) == (EMULATION, None)
    assert advice.interval[0] <= exact("J1", 2.0, 1.33) <= advice.interval[1]
    (near,) = ask(1.75, 1.33, variables=("J1",))  # the weights end at this factor, its interval does not
    assert near.method == REWEIGHTING
    assert near.interval[0] <= exact("J1", 1.75, 1.33) < 1.005 * near.factor < near.interval[1]
    (far,) = ask(1.9, 1.33, variables=("J2",))
    assert not far.bounded
    assert far.ended_by == BY_SAMPLES
    assert far.interval == (far.factor, None)
    assert 1 < far.factor <= far.reach < exact("J2", 1.9, 1.33)


def test_what_no_emulator_explains_ends_where_the_samples_do():
    """A response of noise and jumps: no factor is made up beyond the weights, and nothing jumps there."""
    jumps = np.sign(Z[:, 0]) + (Z[:, 1] > 1) + RNG.normal(size=N) / 2
    limit = 3 * 1.6 * jumps.std()
    limits = {"y": (jumps.mean() - limit, jumps.mean() + limit)}
    emulation = emulators(Z, jumps, limits["y"])
    (advice,) = advise({"y": jumps}, limits, {"y": 1.33}, ["J2"], widening(Z), emulation=emulation)
    assert (advice.bounded, advice.ended_by, advice.method) == (False, BY_SAMPLES, REWEIGHTING)
    y = np.sign(Z[:, 0]) + (advice.factor * Z[:, 1] > 1) + RNG.normal(size=N) / 2
    assert capability(y, *limits["y"]).cpk > 1.33


def test_what_misses_its_target_must_shrink():
    """J1 shrinks to the closed form; J3 cannot help however small it is."""
    first, _, third = ask(1.25, 1.33)
    assert first.interval[0] <= exact("J1", 1.25, 1.33) <= first.interval[1]
    assert first.factor == pytest.approx(exact("J1", 1.25, 1.33), rel=0.02)
    assert first.factor < 1
    assert exact("J3", 1.1, 1.33) is None
    third = ask(1.1, 1.33)[2]
    assert (third.factor, third.interval, third.binding) == (None, (None, None), "y")
    assert third.cpk < 1.33
    assert LEAST_FACTOR <= third.reach < 0.1


@pytest.mark.parametrize("rho", [-0.9, 0.7])
def test_correlated_variables_change_together(rho):
    """Cpk of fresh samples at the ends of the interval lies on either side of the target: the copula was kept.

    The share of the variance that J1 explains says nothing here: with correlation -0.9 it would allow thrice its sigma.
    """
    scores = np.array([[1, rho, 0], [rho, 1, 0], [0, 0, 1.0]])
    mixed = np.linalg.cholesky(scores).T
    z = np.random.default_rng(5).normal(size=(5000, 3)) @ mixed
    weight = np.array([1, 1, 0.3])
    sigma = math.sqrt(weight @ scores @ weight)
    limits = {"y": (-3 * 1.5 * sigma, 3 * 1.5 * sigma)}
    emulation = emulators(z, z @ weight, limits["y"], mixed)
    (advice,) = advise({"y": z @ weight}, limits, {"y": 1.33}, ["J1"], widening(z, scores), emulation=emulation)

    def cpk(factor):
        scaled = weight * [factor, 1, 1]
        return 1.5 * sigma / math.sqrt(scaled @ scores @ scaled)

    assert advice.bounded
    assert cpk(advice.factor) == pytest.approx(1.33, abs=0.06)
    assert cpk(advice.interval[0]) > 1.33
    assert advice.interval[1] is None or cpk(advice.interval[1]) < 1.33


def test_an_idle_variable_may_grow_as_far_as_the_samples_say():
    """Not bounded: every response keeps its target at the largest factor that can be answered, and it is a bound."""
    (advice,) = ask(30.0, 1.33, variables=("J3",))
    assert (advice.bounded, advice.ended_by, advice.interval) == (False, BY_SAMPLES, (advice.reach, None))
    assert 1.2 < advice.factor < 4


def test_bounds_end_the_search():
    """A law that reaches 1.2 times its sigma at most: no larger factor is advised, and the bounds are named."""

    def shy(variable, factor, rows):
        return Change(widening(Z)(variable, min(factor, 1.2), rows).log_ratio, spread=min(factor, 1.2))

    (advice,) = ask(30.0, 1.33, shy, ("J1",))
    assert (advice.factor, advice.reach, advice.bounded, advice.ended_by) == (1.2, 1.2, False, BY_BOUNDS)


def test_the_tightest_response_binds():
    """Two responses, one with more to spare; one without spread and one without limits set no bound."""
    wide, narrow = 3 * 2.0 * SIGMA, 3 * 1.5 * SIGMA
    responses = {"wide": Y, "narrow": Y, "flat": np.ones(N), "free": Y, "holes": np.where(Y > 3, np.nan, Y)}
    limits = {"wide": (-wide, wide), "narrow": (-narrow, narrow), "flat": (0.0, 2.0), "free": (None, None),
              "holes": (-wide, None)}  # fmt: skip
    (advice,) = advise(responses, limits, dict.fromkeys(responses, 1.33), ["J1"], widening(Z))
    assert advice.binding == "narrow"
    assert advice.factor == pytest.approx(exact("J1", 1.5, 1.33), rel=0.03)
    with pytest.raises(ReportError, match="no response has limits"):
        advise({"free": Y}, limits, {"free": 1.33}, ["J1"], widening(Z))


def test_too_few_samples_give_no_advice():
    """Forty samples determine neither weights nor an emulator; the reason is given, and no factor."""
    emulation = emulators(Z[:40], Y[:40], (-9.0, 9.0))
    limits = {"y": (-9.0, 9.0)}
    (advice,) = advise({"y": Y[:40]}, limits, {"y": 1.33}, ["J1"], widening(Z[:40]), emulation=emulation)
    assert (advice.factor, advice.interval) == (None, (None, None))
    assert "worth 40" in advice.refusal


MODELS = {
    "linear": lambda z: z @ np.array([0.8, 0.5, 0.33]),
    "exponential": lambda z: np.exp(0.5 * z[:, 0]) + 0.3 * z[:, 1] + 0.2 * z[:, 2],
    "kink": lambda z: np.maximum(z[:, 0], -0.5) + 0.5 * z[:, 1] + 0.1 * z[:, 2],
    "correlated": lambda z: z @ np.array([1, 1, 0.3]),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "now", "n"),
    [
        ("linear", 1.45, 500),
        ("linear", 1.2, 500),
        ("exponential", 1.45, 1000),
        ("kink", 1.5, 1000),
        ("correlated", 1.5, 1000),
    ],
)
def test_intervals_hold_the_factor_of_fresh_simulation(name, now, n):
    """Nominal 95 %: at least 90 % within 2 standard errors; the true factor is that of a million fresh samples."""
    rng, runs = np.random.default_rng(13), 100
    rho = -0.9 if name == "correlated" else 0.0
    scores = np.array([[1, rho, 0], [rho, 1, 0], [0, 0, 1.0]])
    mixed = np.linalg.cholesky(scores).T
    fresh = rng.normal(size=(1_000_000, 3)) @ mixed
    model = MODELS[name]
    y = model(fresh)
    lsl, usl = y.mean() - 3 * now * y.std(), y.mean() + 3 * now * y.std()
    bracket = (1.0, 2.0) if now > 1.33 else (0.2, 1.0)
    true = brentq(lambda f: capability(model(fresh * [f, 1, 1]), lsl, usl).cpk - 1.33, *bracket, xtol=1e-3)
    held = 0
    for _ in range(runs):
        z = rng.normal(size=(n, 3)) @ mixed
        limits, emulation = {"y": (lsl, usl)}, emulators(z, model(z), (lsl, usl), mixed)
        (advice,) = advise({"y": model(z)}, limits, {"y": 1.33}, ["J1"], widening(z, scores), emulation=emulation)
        low, high = advice.interval
        held += advice.factor is not None and low <= true and (high is None or true <= high)
    assert held / runs >= 0.9 - 2 * math.sqrt(0.9 * 0.1 / runs)


def test_lots_widen_the_interval_and_few_give_none():
    """Of variables that shift from lot to lot, 40 lots determine less than 2,000 independent samples; four nothing."""
    rng = np.random.default_rng(6)
    lots = np.repeat(np.arange(40), 50)
    z = (rng.normal(size=(40, 3))[lots] + rng.normal(size=(2000, 3))) / math.sqrt(2)
    y, limit = z @ A, 3 * 1.6 * SIGMA

    def ask_with(lots):
        return advise({"y": y}, {"y": (-limit, limit)}, {"y": 1.33}, ["J1"], widening(z), lots=lots)[0]

    alone, together, few = ask_with(None), ask_with(lots), ask_with(lots // 10)
    assert together.interval[0] < alone.interval[0]
    assert "worth 4 production lots" in few.refusal
    assert few.factor is None


@pytest.mark.parametrize("usl", [1.0, 12.0, None])
def test_a_mean_beyond_a_limit_is_told_how_far_to_move(usl):
    """No tolerance helps; the shift to the middle, the Cpk there, and whether even that is too small."""
    z = np.random.default_rng(3).normal(size=(400, 1))
    y = 20.0 + z[:, 0]
    limits = {"y": (0.0, usl)} if usl else {"y": (24.0, None)}
    found = tolerance_advice(
        AdvisedSamples({"y": y}, limits, ["J1"]),
        {"y": DecidingIndex(-1.0, None, 1.33)},
        lambda factors, rows: widening(z)("J1", factors["J1"], rows),
    )
    text, std = found.shortfalls[0].text, y.std(ddof=1)
    assert "no smaller tolerance helps" in text
    if usl is None:
        assert f"Move the mean, by more than {24 - y.mean():.3g}." in text
        return
    assert f"Moving the mean by {usl / 2 - y.mean():+.3g}, to the middle of the limits" in text
    assert f"gives Cpk {usl / (6 * std):.4g} with" in text
    assert ("still below 1.33" in text) == (usl / (6 * std) < 1.33)


def test_the_index_that_decides_has_the_target():
    """Not Cpk: a response that is capable by its own shape needs nothing; one that is not needs more than Cpk 1.33."""
    for index, reached, target, by_shape in (
        (DecidingIndex(0.86, 2.7, 1.33), True, 1.33, True),  # bounded values, far from their limits
        (DecidingIndex(1.5, 2.7, 1.33), True, 1.33, False),
        (DecidingIndex(1.1, math.inf, 1.33), True, 1.33, True),  # no share lies beyond
        (DecidingIndex(1.25, 0.92, 1.33), False, 1.33 * 1.25 / 0.92, False),  # a heavy tail
        (DecidingIndex(1.5, 1.4, 1.33), True, 1.33 * 1.5 / 1.4, False),
        (DecidingIndex(1.5, 1.5, 1.67), False, 1.67, False),
        (DecidingIndex(1.4, None, 1.33), True, 1.33, False),
        (DecidingIndex(None, None, 1.33), False, 1.33, False),
        (DecidingIndex(-0.2, 0.1, 1.33), False, 1.33, False),
        (DecidingIndex(0.3, -0.1, 1.33), False, 1.33, False),
    ):
        assert (index.reached, index.by_shape, index.target) == (reached, by_shape, pytest.approx(target)), index
    z = Z[:4000]
    y = z @ A
    wide, narrow = ((-3 * now * SIGMA, 3 * now * SIGMA) for now in (1.6, 0.9))
    limits = {"kept": wide, "bounded": narrow, "heavy": narrow}
    indices = {"kept": DecidingIndex(1.6, 1.5, 1.33), "bounded": DecidingIndex(0.9, 2.7, 1.33)}
    indices |= {"heavy": DecidingIndex(0.9, 0.8, 1.33)}

    def rescale(factors, rows):
        ((name, factor),) = factors.items()
        return widening(z)(name, factor, rows)

    found = tolerance_advice(AdvisedSamples(dict.fromkeys(limits, y), limits, ["J1"]), indices, rescale)
    assert (found.kept, [short.response for short in found.shortfalls]) == (("kept",), ["heavy"])
    assert found.kept_at == f"Cpk {1.33 * 1.6 / 1.5:.2f} (index 1.33)"
    assert found.note.startswith("bounded: capable at a lower Cpk, by the shape of the values")
    (short,) = found.shortfalls
    assert (short.index, short.required, short.target) == (0.8, 1.33, pytest.approx(1.33 * 0.9 / 0.8))
    assert "heavy has index 0.8, below 1.33, at Cpk 0.9. Values of this shape need Cpk 1.496." in short.text
    (growth,) = found.growth
    assert (growth.binding, set(growth.below)) == ("kept", {"bounded", "heavy"})
    assert growth.factor == pytest.approx(exact("J1", 1.6, 1.33 * 1.6 / 1.5), rel=0.05)


def test_the_factor_is_the_first_at_which_a_what_if_reaches_the_target():
    """Where the weights end, the emulator's Cpk jumps: the factor is not one that the weights still deny."""
    z = np.random.default_rng(4).normal(size=(200, 3))
    y = z @ A
    y = (y - y.mean()) * (1.15 * SIGMA / y.std())  # these few samples scatter more than production does
    limits = (-3 * 0.9 * SIGMA, 3 * 0.9 * SIGMA)
    emulation = emulators(z, y, limits)
    change = widening(z)
    (advice,) = advise({"y": y}, {"y": limits}, {"y": 1.33}, ["J1"], change, emulation=emulation)
    rows = np.arange(200)
    assert advice.method == EMULATION
    inside = what_if(y, change("J1", advice.factor * 1.1, rows), *limits)
    assert inside.refusal or inside.cpk.value < 1.33
    assert what_if(y, change("J1", advice.factor, rows), *limits).refusal
    assert emulation.answers({"J1": advice.factor}, "")["y"].cpk.value == pytest.approx(1.33, rel=0.1)


def test_where_what_if_refuses_the_emulator_advice_does_not_ask_it():
    """Production varies another variable far beyond the rows: neither answers beyond the weights."""
    limits = (-3 * 2.0 * SIGMA, 3 * 2.0 * SIGMA)
    covered = emulators(Z, Y, limits)
    rows = {f"J{i + 1}": Z[:, i] for i in range(3)}
    far = EmulatedTolerances(
        rows, {"y": Y}, {"y": limits}, lambda factors: covered._drawn(factors) | {"J3": 9 * FRESH[:, 2]}
    )
    asked = ({"y": Y}, {"y": limits}, {"y": 1.33}, ["J1"], widening(Z))
    (answered,), (ended,) = (advise(*asked, emulation=each) for each in (covered, far))
    assert (answered.method, answered.bounded) == (EMULATION, True)
    assert (ended.method, ended.bounded, ended.ended_by) == (REWEIGHTING, False, BY_SAMPLES)
    with pytest.raises(ReportError, match="J3"):
        far.answers({"J1": 1.5}, "")
