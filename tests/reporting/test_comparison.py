"""Two campaigns side by side, against scipy's tests."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from scipy import stats

from reporting import ReportError
from reporting.comparison import compare
from reporting.samples import read_samples
from tests.reporting.synthetic import c60_spec, c60_table


def compared(table: pa.Table, other: pa.Table, first_only: bool = False, **changes):
    """Return the comparison of FC-1, and both columns."""
    spec, theirs = c60_spec(len(table)), replace(c60_spec(len(other)), campaign="other", **changes)
    if first_only:
        spec, theirs = (replace(s, responses=s.responses[:1]) for s in (spec, theirs))
    found = compare(read_samples(table, spec), spec, read_samples(other, theirs), theirs, 0.95)
    columns = [t["FC-1"].drop_null().to_numpy() for t in (table, other)]
    return found, found.responses[0], *columns


def shifted(table: pa.Table, by: float, times: float = 1.0) -> pa.Table:
    """Return the table with FC-1 moved and stretched."""
    at = table.schema.get_field_index("FC-1")
    x = table["FC-1"].to_numpy()
    mean = np.nanmean(x)
    return table.set_column(at, "FC-1", pa.array(mean + times * (x - mean) + by, from_pandas=True))


@pytest.mark.parametrize(("by", "times"), [(0.0, 1.0), (0.05, 1.0), (0.0, 1.2), (-0.3, 0.7)])
def test_tests_and_intervals_are_scipys(by, times) -> None:
    """Welch, Brown-Forsythe, F and Mann-Whitney, with failures in both campaigns."""
    _, r, a, b = compared(c60_table(700, 6), shifted(c60_table(450, 3, seed=11), by, times))
    welch = stats.ttest_ind(a, b, equal_var=False)
    assert r.mean_difference == pytest.approx(a.mean() - b.mean())
    assert r.t_p == pytest.approx(welch.pvalue, rel=1e-9)
    assert r.mean_interval == pytest.approx(tuple(welch.confidence_interval(0.95)), rel=1e-9)
    assert r.levene_p == pytest.approx(stats.levene(a, b, center="median").pvalue, rel=1e-9)
    ratio = a.var(ddof=1) / b.var(ddof=1)
    tail = stats.f(a.size - 1, b.size - 1).cdf(ratio)
    assert r.std_ratio**2 == pytest.approx(ratio)
    assert r.f_p == pytest.approx(2 * min(tail, 1 - tail), rel=1e-6)
    ranks = stats.mannwhitneyu(a, b, method="asymptotic")
    assert r.superiority == pytest.approx(ranks.statistic / (a.size * b.size))
    assert r.mann_whitney_p == pytest.approx(ranks.pvalue, rel=1e-9)
    pooled = np.sqrt(((a.size - 1) * a.var(ddof=1) + (b.size - 1) * b.var(ddof=1)) / (a.size + b.size - 2))
    assert r.effect == pytest.approx((a.mean() - b.mean()) / pooled)


@pytest.mark.slow
def test_intervals_of_cpk_and_sigma_hold_as_often_as_they_say() -> None:
    """400 pairs of equal campaigns: 95 % intervals miss 0 and 1 in 20 of them, +-4 standard errors of that."""
    missed = np.zeros(2)
    for seed in range(400):
        _, r, _, _ = compared(c60_table(120, seed=2 * seed), c60_table(150, seed=2 * seed + 1), first_only=True)
        missed += not r.cpk_interval[0] <= 0 <= r.cpk_interval[1], not r.std_ratio_interval[0] <= 1
        missed[1] += r.std_ratio_interval[1] < 1
    assert np.all(np.abs(missed / 400 - 0.05) < 4 * np.sqrt(0.05 * 0.95 / 400))


def test_exchanged_campaigns_give_the_opposite() -> None:
    first, second = c60_table(200), c60_table(300, seed=2)
    _, there, _, _ = compared(first, second)
    _, back, _, _ = compared(second, first)
    assert back.mean_difference == pytest.approx(-there.mean_difference)
    assert back.std_ratio == pytest.approx(1 / there.std_ratio)
    assert back.superiority == pytest.approx(1 - there.superiority)
    assert back.cpk_difference == pytest.approx(-there.cpk_difference)


def test_other_limits_and_missing_responses_are_told() -> None:
    spec = c60_spec(1)
    limits = (replace(spec.responses[0], lsl=10.0), *spec.responses[1:4])
    found, r, _, _ = compared(c60_table(100), c60_table(100, seed=2), responses=limits)
    assert found.only_here == ("FC-5", "FC-6", "latch_overlap")
    assert "different limits" in r.notes[0]
    assert r.capability_other.lsl == 10.0


def test_what_cannot_be_compared_is_one_message_or_a_note() -> None:
    _, r, _, _ = compared(c60_table(100), c60_table(1))
    assert r.t_p is None
    assert "Fewer than two" in r.notes[0]
    _, r, _, _ = compared(c60_table(100), shifted(c60_table(50), 0.0, 0.0))
    assert r.levene_p is None
    assert "does not vary" in r.notes[0]
    spec = c60_spec(1)
    with pytest.raises(ReportError, match="no common response"):
        compared(c60_table(10), c60_table(10), responses=())
    with pytest.raises(ReportError, match=r"FC-1: .*\bN\b.*\bkN\b"):
        compared(c60_table(10), c60_table(10), responses=(replace(spec.responses[0], unit="kN"),))


def in_lots(n: int, seed: int) -> tuple[pa.Table, dict[str, object]]:
    """Return a table whose FC-1 has lots of 50 with equal sigma within and between, and its fields of the spec."""
    table, rng = c60_table(n, seed=seed), np.random.default_rng(seed)
    x = 13.0 + 0.4 * (rng.normal(size=n) + np.repeat(rng.normal(size=n // 50), 50))
    at = table.schema.get_field_index("FC-1")
    table = table.set_column(at, "FC-1", pa.array(x)).append_column("lot", pa.array(np.arange(n) // 50))
    return table, {"production_batch_column": "lot"}


def test_lots_widen_the_intervals_and_leave_no_test() -> None:
    """60 pairs of equal processes, 20 lots each: Welch's interval of independent values misses 0 in 7 of 10."""
    missed = dict.fromkeys(("mean_interval", "std_ratio_interval", "cpk_interval"), 0)
    for seed in range(60):
        (table, fields), (other, _) = in_lots(1000, 2 * seed), in_lots(1000, 2 * seed + 1)
        spec, theirs = (
            replace(c60_spec(1000), campaign=name, responses=c60_spec(1).responses[:1], **fields) for name in "ab"
        )
        r = compare(read_samples(table, spec), spec, read_samples(other, theirs), theirs, 0.95).responses[0]
        for name, truth in (("mean_interval", 0.0), ("std_ratio_interval", 1.0), ("cpk_interval", 0.0)):
            low, high = getattr(r, name)
            missed[name] += not low <= truth <= high
    assert max(missed.values()) <= 8  # of 60; 3 are expected, 8 or more have a probability of 1 %
    assert (r.t_p, r.f_p, r.levene_p, r.mann_whitney_p) == (None, None, None, None)
    assert "not independent" in r.notes[-1]


def test_too_few_lots_have_no_interval_of_a_difference() -> None:
    (table, fields), (other, _) = in_lots(100, 1), in_lots(1000, 2)
    spec, theirs = (replace(c60_spec(1000), campaign=name, **fields) for name in "ab")
    r = compare(read_samples(table, spec), spec, read_samples(other, theirs), theirs, 0.95).responses[0]
    assert r.mean_difference is not None
    assert r.mean_interval is r.cpk_interval is r.std_ratio_interval is None
