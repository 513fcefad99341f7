"""Capability against published vectors, scipy, and the properties every index must have."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from reporting import Capability, ReportError, capability


def standardised(n: int, mean: float, std: float) -> np.ndarray:
    """Return n values with exactly this mean and sigma: published vectors are given by moments."""
    x = stats.norm.ppf((np.arange(1, n + 1) - 0.5) / n)
    return mean + std * (x - x.mean()) / x.std(ddof=1)


def set_a() -> np.ndarray:
    return 10 + 0.5 * stats.norm.ppf((np.arange(1, 51) - 0.5) / 50)


def set_b() -> np.ndarray:
    return np.exp(1.9 + 0.25 * stats.norm.ppf((np.arange(1, 61) - 0.5) / 60))


def set_c() -> np.ndarray:
    return np.array(
        [20 + 0.1 * ((7 * i) % 11) + 0.05 * ((3 * i * j) % 7) + 0.02 * i for i in range(1, 13) for j in range(1, 6)]
    )


def test_set_a_gives_the_published_numbers() -> None:
    c = capability(set_a(), 8.2, 11.5)
    assert c.n == 50
    assert c.mean == pytest.approx(10, abs=1e-12)
    assert c.std == pytest.approx(0.4986999442045, rel=1e-12)
    assert c.cp == pytest.approx(1.102867578775, rel=1e-12)
    assert c.cp_interval == pytest.approx((0.8850317422565, 1.320271370688), rel=1e-11)
    assert c.cpk == pytest.approx(1.002606889795, rel=1e-12)
    assert c.cpk_interval == pytest.approx((0.7836553572833, 1.221558422307), rel=1e-11)
    assert c.ppm_expected_below == pytest.approx(153.4620171632, rel=1e-9)
    assert c.ppm_expected_above == pytest.approx(1315.641793142, rel=1e-9)
    assert c.cc == pytest.approx(0.0909090909, abs=1e-10)
    assert c.skewness == pytest.approx(0, abs=1e-12)


def test_set_b_gives_the_published_moments() -> None:
    c = capability(set_b(), 3, 12)
    assert c.mean == pytest.approx(6.893349607417, rel=1e-12)
    assert c.std == pytest.approx(1.738421763827, rel=1e-12)
    assert c.ppm_observed == 1e6 * np.count_nonzero(set_b() > 12) / 60


def test_set_c_uses_the_overall_sigma() -> None:
    """The subgroups drift: the within sigma of this set would give a Cpk 3.4 times as large."""
    c = capability(set_c(), 19.5, 21.7)
    assert c.mean == pytest.approx(20.80666666667, rel=1e-12)
    assert c.std == pytest.approx(0.3134102562147, rel=1e-12)
    assert c.cp == pytest.approx(2.2 / (6 * 0.3134102562147), rel=1e-12)


# Bissell's interval in print often has z rounded to 1.96; this is the confidence that belongs to it.
ROUNDED_Z = 2 * stats.norm.cdf(1.96) - 1


@pytest.mark.parametrize(
    ("moments", "limits", "confidence", "expected"),
    [
        ((20, 50, 1.75), (38, 62), 0.95, {"cp": 2.285714, "cp_interval": (1.564945, 3.005579)}),
        ((20, 0, 1), (-3.99, 100), ROUNDED_Z, {"cpk": 1.33, "cpk_interval": (0.882598, 1.777402)}),
        # The last digit of the upper end is 8: 25/24 sqrt(45.7223/29) = 1.3079578.
        ((30, 97, 1.6), (90, 100), 0.95, {"cp": 1.041667, "cp_interval": (0.774868, 1.307958)}),
        ((30, 97, 1.6), (90, 100), 0.95, {"cpk": 0.625, "cpk_interval": (0.424751, 0.825249)}),
        ((50, 16, 2), (8, 20), 0.95, {"cp": 1.0, "cp_interval": (0.802482, 1.197126)}),
        ((50, 16, 2), (8, 20), 0.95, {"cpk": 0.666667, "cpk_interval": (0.505551, 0.827782)}),
    ],
)
def test_textbook_vectors(moments, limits, confidence, expected) -> None:
    """Montgomery's examples and the NIST e-Handbook's, from their moments."""
    c = capability(standardised(*moments), *limits, confidence=confidence)
    for name, value in expected.items():
        assert getattr(c, name) == pytest.approx(value, abs=6e-7), name


def test_exact_lower_bound_of_one_side() -> None:
    """NIST's example: the 95 % one-sided bound is the lower end of the two-sided 90 % interval."""
    c = capability(standardised(50, 16, 2), 8, 20, confidence=0.90)
    assert c.cpu_interval is not None
    assert c.cpu_interval[0] == pytest.approx(0.529613, abs=6e-7)


@pytest.mark.parametrize(
    ("cp", "ppm"),
    [
        (0.5, 133614.403),
        (2 / 3, 45500.264),
        (1, 2699.796),
        (4 / 3, 63.3425),
        (1.5, 6.79535),
        (5 / 3, 0.573303),
        (2, 0.00197318),
    ],
)
def test_expected_ppm_of_a_centred_normal(cp: float, ppm: float) -> None:
    c = capability(standardised(100, 0, 1), -3 * cp, 3 * cp)
    assert c.ppm_expected == pytest.approx(ppm, rel=5e-6)


def test_paper_fc1_and_fc6_indices_follow_from_the_moments() -> None:
    """FC-1 of the paper: mean 13.6599 N, sigma 0.478255 N in 9 to 16 N gives Cpk 1.631, Cc 0.3314."""
    c = capability(standardised(400, 13.6599, 0.478255), 9, 16)
    assert c.cp == pytest.approx(2.43943, abs=1e-4)
    assert c.cpk == pytest.approx(1.631, abs=5e-4)
    assert c.cc == pytest.approx(0.3314, abs=5e-5)
    assert c.ppm_expected == pytest.approx(0.497, abs=2e-3)


@pytest.mark.parametrize(("n", "bound"), [(1000, 2991.25), (10_000, 299.528), (30_850, 97.1017), (50_000, 59.9129)])
def test_zero_rejects_still_allow_some_ppm(n: int, bound: float) -> None:
    c = capability(np.linspace(-1, 1, n), -2, 2)
    assert c.ppm_observed == 0
    assert c.ppm_upper == pytest.approx(bound, rel=2e-6)
    assert c.ppm_upper == pytest.approx(1e6 * (1 - 0.05 ** (1 / n)), rel=1e-9)


def test_cpm_has_divisor_n_around_the_target() -> None:
    c = capability([1.0, 2.0, 3.0], 0, 6, target=3.0)
    assert c.cpm == pytest.approx(6 / (6 * math.sqrt(5 / 3)))


def test_shape_is_that_of_scipy() -> None:
    x = np.random.default_rng(3).gamma(2.0, size=200)
    c = capability(x)
    assert c.skewness == pytest.approx(stats.skew(x, bias=False), rel=1e-10)
    assert c.kurtosis == pytest.approx(stats.kurtosis(x, bias=False), rel=1e-10)


values = st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=40).filter(lambda x: np.std(x) > 1e-2)
limits = st.tuples(st.floats(-1e3, 1e3), st.floats(1e-1, 1e3)).map(lambda p: (p[0], p[0] + p[1]))


@given(values, limits)
def test_cpk_is_cp_less_the_shift(x, fence) -> None:
    c = capability(x, *fence)
    assert c.cpk <= c.cp * (1 + 1e-12)
    assert c.cpk == pytest.approx(c.cp * (1 - abs(c.cc)), rel=1e-9, abs=1e-9)
    assert c.cpk == min(c.cpl, c.cpu)


@given(values, limits, st.sampled_from([1e-3, 0.5, 1e3]), st.floats(-100, 100))
def test_indices_do_not_depend_on_the_unit_or_the_origin(x, fence, scale, shift) -> None:
    c = capability(x, *fence)
    d = capability(scale * (np.array(x) + shift), *(scale * (limit + shift) for limit in fence))
    for name in ("cp", "cpk", "cpl", "cpu", "cc", "skewness", "cp_interval", "cpk_interval", "cpl_interval"):
        assert getattr(d, name) == pytest.approx(getattr(c, name), rel=1e-6, abs=1e-6), name
    assert d.std == pytest.approx(scale * c.std, rel=1e-6)


@given(values, limits)
def test_a_mirror_exchanges_the_sides(x, fence) -> None:
    c, m = capability(x, *fence), capability(-np.array(x), -fence[1], -fence[0])
    assert (m.below, m.above) == (c.above, c.below)
    assert (m.cpl, m.cpu) == pytest.approx((c.cpu, c.cpl), rel=1e-9, abs=1e-9)
    assert m.cc == pytest.approx(-c.cc, abs=1e-9)
    assert m.ppm_expected == pytest.approx(c.ppm_expected, rel=1e-6, abs=1e-9)


@given(values, limits)
def test_sides_add_up_and_bounds_are_above(x, fence) -> None:
    c = capability(x, *fence)
    assert c.ppm_observed == pytest.approx(c.ppm_observed_below + c.ppm_observed_above)
    assert c.ppm_expected == pytest.approx(c.ppm_expected_below + c.ppm_expected_above)
    for side in ("", "_below", "_above"):
        observed, upper = getattr(c, f"ppm_observed{side}"), getattr(c, f"ppm_upper{side}")
        assert observed < upper or observed == upper == 1e6
    for name in ("cp", "cpk", "cpl", "cpu"):
        low, high = getattr(c, f"{name}_interval")
        assert low < getattr(c, name) < high


@given(st.integers(4, 300), st.floats(0.2, 4))
def test_intervals_widen_when_n_falls(n: int, cpk: float) -> None:
    def widths(size: int) -> list[float]:
        c = capability(standardised(size, 0, 1), -3 * cpk, 3 * cpk)
        return [high - low for low, high in (c.cp_interval, c.cpk_interval, c.cpl_interval)]

    assert all(small > large for small, large in zip(widths(n), widths(2 * n), strict=True))


def test_one_sided_limits_leave_cp_undefined() -> None:
    lower = capability(set_a(), lsl=8.2)
    assert lower.cp is None
    assert lower.cc is None
    assert lower.cpu is None
    assert lower.ppm_observed_above is None
    assert lower.cpk == lower.cpl == pytest.approx((10 - 8.2) / (3 * 0.4986999442045))
    assert any("Lower limit only" in note for note in lower.notes)
    upper = capability(set_a(), usl=11.5)
    assert upper.cpk == upper.cpu
    assert any("Upper limit only" in note for note in upper.notes)


@pytest.mark.parametrize(
    ("x", "word"),
    [
        ([], "No values"),
        ([np.nan, np.nan], "No values"),
        ([1.0], "One value"),
        ([1.0, 1.0, 1.0], "the spread is zero"),
        ([0.1] * 1001, "the spread is zero"),
    ],
)
def test_no_spread_means_no_index_and_a_reason(x, word) -> None:
    c = capability(x, 0, 2)
    assert c.cp is None
    assert c.cpk is None
    assert c.cpk_interval is None
    assert c.ppm_expected is None
    assert any(word in note for note in c.notes)


def test_without_limits_only_the_statistics() -> None:
    c = capability(set_a())
    assert c.mean is not None
    assert c.cpk is None
    assert c.ppm_observed is None
    assert any("Without limits" in note for note in c.notes)


def test_values_that_are_not_finite_are_counted_and_left_out() -> None:
    c = capability([*set_a(), np.nan, np.inf], 8.2, 11.5)
    assert (c.n, c.dropped) == (50, 2)
    assert c.cpk == capability(set_a(), 8.2, 11.5).cpk
    assert any("2 of 52 values are not finite" in note for note in c.notes)


def test_a_value_on_a_limit_conforms() -> None:
    c = capability([9.0, 16.0, 12.0], 9, 16)
    assert c.ppm_observed == 0


@pytest.mark.parametrize(
    ("keywords", "said"),
    [
        ({"lsl": 16, "usl": 9}, "lsl = 16 is not below usl = 9"),
        ({"lsl": 9, "usl": 9}, "not below"),
        ({"lsl": math.nan}, "lsl = nan"),
        ({"usl": math.inf}, "use None"),
        ({"confidence": 1.0}, "confidence = 1.0"),
        ({"confidence": 95}, "between 0 and 1"),
    ],
)
def test_wrong_arguments_are_named(keywords, said) -> None:
    with pytest.raises(ReportError, match=said):
        capability([1.0, 2.0], **keywords)


def test_values_must_be_one_series_of_numbers() -> None:
    with pytest.raises(ReportError, match="shape"):
        capability([[1.0, 2.0]])
    with pytest.raises(ReportError, match="not numbers"):
        capability(["a", "b"])


def test_all_numbers_are_plain_python() -> None:
    """Frozen data must not carry numpy scalars into JSON."""
    c = capability(set_a(), 8.2, 11.5, 10.0)
    assert isinstance(c, Capability)
    assert c.order is not None
    for name, value in {**vars(c), **vars(c.order), "order": None}.items():
        for number in value if isinstance(value, tuple) else (value,):
            assert type(number) in (int, float, str, type(None)), name


def test_z_and_sigma_level_belong_to_the_ppm() -> None:
    """The 3.4 ppm of Six Sigma are 4.5 sigma, customarily called 6."""
    c = capability(standardised(100, 0, 1), usl=4.5)
    assert c.z_usl == pytest.approx(4.5, rel=1e-12)
    assert c.z_bench == c.z_usl
    assert c.sigma_level == pytest.approx(6.0, rel=1e-12)
    assert c.ppm_expected == pytest.approx(3.39767, rel=2e-6)
    both = capability(standardised(100, 0, 1), -2, 3)
    assert both.z_bench == pytest.approx(-stats.norm.ppf(both.ppm_expected * 1e-6), rel=1e-9)
    low, high = both.ppm_expected_interval
    assert low < both.ppm_expected < high


@pytest.mark.parametrize(
    ("x", "fence"),
    [
        ([1e308, -1e308], (0.0, 1.0)),
        ([1e200, 2e200, -1e200], (0.0, 1e201)),
        ([1.0, 2.0, 3.0], (-1e300, 1e300)),
        ([0.0, 1e-12, 3e-12], (-1e6, 2e6)),
        ([0.0, 1.0, 2.0, 3.0], (1e6, 1e6 + 1e-3)),
        ([1e9, 1e9 + 1e-3, 1e9 - 1e-3], (1e9 - 1, 1e9 + 1)),
    ],
)
def test_huge_and_tiny_numbers_are_finite_or_none(x, fence) -> None:
    c = capability(x, *fence, target=fence[0], batches=[1] * len(x))
    for name, value in vars(c).items():
        for number in value if isinstance(value, tuple) else (value,):
            assert not isinstance(number, float) or math.isfinite(number), name
