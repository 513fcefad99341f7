"""The sensitivity of a campaign: what is critical, what is not, and odd data that must not stop it."""

import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from reporting import ReportError
from reporting.sensitivity.summary import sensitivity
from tests.reporting.models import ISHIGAMI_FIRST, ishigami, linear, named

RNG = np.random.default_rng(2026)


def test_a_linear_response():
    """J1 and J2 are critical, J5 to J7 (2 % and less) are not; nothing is left to interactions."""
    x, y = linear(2000, RNG)
    found = sensitivity(named(x), {"gap": 5 + 0.01 * y}, {"gap": (4.9, 5.1)})
    gap = found.responses[0]
    assert (gap.verdict, gap.independent, gap.n) == ("critical", True, 2000)
    assert [i.variable for i in gap.ranked[:2]] == ["J1", "J2"]
    assert gap.influences[0].verdict == "critical"
    assert set(found.never_critical()) >= {"J5", "J6", "J7"}
    assert gap.interaction == pytest.approx(0.0, abs=1e-6)
    assert [i.significant for i in gap.influences] == [True] * 6 + [False]
    first = gap.influences[0]
    # The 5th and 95th percentile of a normal variable are 1.645 from its mean, and J1 has weight 3.
    assert first.high - first.low == pytest.approx(0.01 * 3 * 2 * 1.6449, rel=0.06)
    assert first.swing_interval[0] < first.high - first.low < first.swing_interval[1]
    assert gap.rejects.differences[0].variable == "J1"
    assert len(gap.worst) == 10
    json.dumps(dataclasses.asdict(found), allow_nan=False)


@pytest.mark.slow
def test_each_response_says_which_variable_costs_its_rejects():
    """J1 the upper limit of the gap, J2 the width; a response without a reject, or without limits, says nothing."""
    x, y = linear(4000, np.random.default_rng(12))
    limits = {"gap": (-9.0, 9.0), "width": (None, 2.3), "wide": (-99.0, 99.0)}
    found = sensitivity(named(x), {"gap": y, "width": x[:, 1], "wide": y, "free": y}, limits)
    gap, width, wide, free = (response.attribution for response in found.responses)
    assert gap.rejects == np.count_nonzero(np.abs(y) > 9)
    assert [s.variable for s in gap.shares[:2]] == ["J1", "J2"]
    assert width.shares[0].variable == "J2"
    assert width.shares[0].share > 0.9
    assert (wide, free) == (None, None)


def test_no_variable_is_critical():
    """Twenty equal variables explain 5 % each: no joint is critical, and the report may say so."""
    x = RNG.normal(size=(5000, 20))
    response = sensitivity(named(x), {"y": x.sum(axis=1)}).responses[0]
    assert response.verdict == "not critical"
    assert all(i.significant for i in response.influences)
    assert all(i.contribution is None for i in response.influences)


def test_what_interactions_hide_is_found_in_products():
    """Ishigami's x3 explains nothing alone; of a product no variable does, and both of its factors are critical."""
    x, y = ishigami(3000, RNG)
    found = sensitivity(named(x), {"y": y, "product": x[:, 0] * x[:, 1]})
    one, product = found.responses
    assert one.interaction_interval[0] < 0.2436836641 < one.interaction_interval[1]
    assert [i.first_order for i in one.influences] == pytest.approx(ISHIGAMI_FIRST, abs=0.03)
    assert [i.verdict for i in product.influences] == ["critical", "critical", "not critical"]
    assert product.notes[0].startswith("By a regression with products of two")
    assert "sampler saltelli shows it" in product.notes[1]


def test_what_acts_through_interactions_is_not_called_uncritical():
    """Ishigami's x3 explains nothing alone, and with x1 a quarter of the variance."""
    x, y = ishigami(3000, RNG)
    found = sensitivity(named(x), {"y": y})
    assert [i.verdict for i in found.responses[0].influences] == ["critical"] * 3
    assert found.never_critical() == ()


def test_a_share_just_below_a_tenth_is_not_called_critical():
    """0.083 beside a product, 100 samples: critical in at most 4 of 60 (nominal 2.5 %)."""
    verdicts = []
    for seed in range(60):
        z = np.random.default_rng(seed).normal(size=(100, 3))
        response = sensitivity(named(z), {"y": z[:, 0] * z[:, 1] + 0.3 * z[:, 2]}).responses[0]
        verdicts.append(response.influences[2].verdict)
    assert verdicts.count("critical") <= 4


def test_noise_is_rarely_significant():
    """Of 60 responses of pure noise on 7 variables (family-wise 5 %), at most 9 name any variable (chance 2e-3)."""
    x = RNG.normal(size=(300, 7))
    found = sensitivity(named(x), {f"y{i}": RNG.normal(size=300) for i in range(60)})
    assert sum(any(i.significant for i in r.influences) for r in found.responses) <= 9


def test_correlated_variables_are_said_to_be():
    """Indices overlap; contributions still sum to R^2."""
    a = RNG.normal(size=3000)
    b = 0.7 * a + 0.714 * RNG.normal(size=3000)
    response = sensitivity({"a": a, "b": b}, {"y": a + b}).responses[0]
    assert response.independent is False
    assert "correlated" in response.notes[0]
    assert sum(i.first_order for i in response.influences) > 1.2
    assert sum(i.contribution for i in response.influences) == pytest.approx(1.0, abs=1e-3)
    assert response.influences[0].inflation == pytest.approx(1 / (1 - 0.49), rel=0.1)


@settings(max_examples=15, deadline=None)
@given(st.floats(1e-6, 1e6), st.floats(-1e6, 1e6), st.permutations(range(3)))
def test_units_origin_and_order_do_not_matter(scale, shift, order):
    """Of response and variables; the curve follows."""
    x, y = ishigami(300, np.random.default_rng(9))
    base = sensitivity(named(x), {"y": y}).responses[0]
    names = [f"J{i + 1}" for i in order]
    moved_x = {name: scale * (named(x)[name] + 5.0) for name in names}
    moved = sensitivity(moved_x, {"y": scale * y + shift * scale}).responses[0]
    for influence in base.influences:
        other = next(i for i in moved.influences if i.variable == influence.variable)
        for field in ("coefficient", "contribution", "spearman", "first_order"):
            assert getattr(other, field) == pytest.approx(getattr(influence, field), abs=1e-6)
        assert other.high - other.low == pytest.approx(scale * (influence.high - influence.low), rel=1e-4)


@pytest.mark.parametrize("n", [0, 1, 2, 39])
def test_too_few_rows_say_how_many(n):
    """No number, a note with the number needed, and the worst samples there are."""
    found = sensitivity({"a": np.arange(n)}, {"y": np.arange(n)}, {"y": (-1.0, None)})
    response = found.responses[0]
    assert response.influences[0].first_order is None
    assert "at least 40 are needed" in response.notes[-1]
    assert len(response.worst) == min(n, 5)
    assert response.verdict == "open"


def test_odd_data_never_stop_it():
    """Constant columns, holes, nothing but holes, huge offsets; what remains is computed."""
    x = RNG.normal(size=200)
    holes = x.copy()
    holes[::2] = math.nan
    responses = {"y": x, "flat": np.full(200, 3.3), "holes": holes, "none": np.full(200, np.nan), "far": 1e15 + x}
    found = sensitivity({"a": x, "fixed": np.full(200, 0.1), "b": RNG.normal(size=200)}, responses)
    notes = {r.response: " ".join(r.notes) for r in found.responses}
    numbers = {r.response: r.influences[0].first_order for r in found.responses}
    assert numbers["y"] == pytest.approx(1.0)
    assert numbers["holes"] == pytest.approx(1.0)
    assert (numbers["flat"], numbers["none"]) == (None, None)
    assert "All values are equal" in notes["flat"]
    assert "0 samples" in notes["none"]
    assert "fixed does not vary" in notes["y"]
    json.dumps(dataclasses.asdict(found), allow_nan=False)
    assert sensitivity({"fixed": np.zeros(99)}, {"y": x[:99]}).responses[0].notes[-1].startswith("No variable varies")


def test_columns_of_different_lengths_are_refused():
    """With their names."""
    with pytest.raises(ReportError, match=r"\by: .*length"):
        sensitivity({"a": np.zeros(5)}, {"y": np.zeros(6)})


def test_correlated_variables_are_not_sent_to_a_sampler_that_refuses_them():
    """Saltelli's design needs independent variables: the note recommends it for those alone."""
    z = RNG.normal(size=(2000, 2))
    for rho, recommended in ((0.0, True), (-0.9, False)):
        x = np.column_stack([z[:, 0], rho * z[:, 0] + math.sqrt(1 - rho**2) * z[:, 1]])
        notes = " ".join(sensitivity(named(x), {"y": x[:, 0] * x[:, 1] + RNG.normal(size=2000)}).responses[0].notes)
        assert "variables acting alone" in notes
        assert ("saltelli" in notes) == recommended


@pytest.mark.parametrize(("lots", "size", "said"), [(20, 15, "allow for this"), (10, 30, "allow for this")])
def test_the_intervals_of_shares_allow_for_production_lots(lots: int, size: int, said: str):
    """Lots that differ as much as the samples of one; taken for independent, half of the intervals miss the share."""
    held, truth = [], np.array([0.6, 0.4])
    for seed in range(50):
        rng = np.random.default_rng(seed)
        x = np.repeat(rng.normal(size=(lots, 2)), size, axis=0) + rng.normal(size=(lots * size, 2))
        lot = np.repeat(np.arange(lots), size)
        (found,) = sensitivity(named(x), {"y": x @ truth**0.5}, correlations=[], lots=lot).responses
        held += [
            i.first_order_interval[0] <= t <= i.first_order_interval[1]
            for i, t in zip(found.influences, truth, strict=True)
        ]
        assert said in found.notes[-1]
    assert np.mean(held) >= 0.86


def test_four_lots_say_too_little():
    """Fewer than five make no error that could be trusted: a note says that the intervals are too narrow."""
    x, lot = np.repeat(RNG.normal(size=(4, 2)), 25, axis=0) + RNG.normal(size=(100, 2)), np.repeat(np.arange(4), 25)
    (found,) = sensitivity(named(x), {"y": x.sum(axis=1)}, correlations=[], lots=lot).responses
    assert "too narrow" in found.notes[-1]
