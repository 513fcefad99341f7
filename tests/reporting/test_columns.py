"""Columns at some rows, and rows that come table by table."""

import numpy as np
import pyarrow as pa

from reporting.arrays import (
    MOST_ROWS,
    Columns,
    GrowingColumn,
    extremes,
    random_rows,
    some_of,
    standard_deviation,
    sums,
    varies,
)
from reporting.samples import AMBIGUOUS, AT_IMPACT, LATER, read_samples
from tests.reporting.synthetic import c60_spec, c60_table


def test_columns_are_cut_where_they_are_asked_for():
    """At rows of rows, as arrays are; a row where one is not finite is known."""
    a, b = np.arange(10.0), np.where(np.arange(10) == 7, np.nan, 1.0)
    every = Columns({"a": a, "b": b})
    odd, big = np.arange(10) % 2 == 1, np.arange(10) > 4
    some = every.where(odd).where(big[odd])
    assert list(some) == ["a", "b"]
    assert some["a"].tolist() == [5.0, 7.0, 9.0]
    assert some.take("a", np.array([2, 0])).tolist() == [9.0, 5.0]
    assert some.finite.tolist() == [True, False, True]
    assert some.only(["a"]).finite is None
    assert (every.sizes, some.sizes, Columns({}).sizes) == ({10}, {3}, set())
    assert every.where(np.ones(10, bool))["a"] is a
    assert Columns({}).finite is None


def test_random_rows_of_many_are_different_ones():
    for n in (10, MOST_ROWS, MOST_ROWS + 1, 10 * MOST_ROWS):
        rows = random_rows(n)
        assert np.unique(rows).size == rows.size == min(n, MOST_ROWS)
        assert abs(rows[:1000].mean() / n - 0.5) < 0.5 * (n < 1000) + 0.05
        assert rows.max() < n


def test_rows_are_the_same_in_one_table_or_in_many():
    """Their columns, their remarks, and the largest certificates of the ok ones."""
    n = 700
    rng, table = np.random.default_rng(2), c60_table(n, 100)
    for name in LATER:
        table = table.append_column(name, pa.array(rng.random(n)))
    struck = ["", "FC-1", "FC-1,FC-2", None]
    table = table.append_column(AT_IMPACT, pa.array([struck[i % 4] for i in range(n)]))
    table = table.append_column(AMBIGUOUS, pa.array(rng.random(n) < 0.1))
    spec = c60_spec(n)
    pieces = [table.slice(first, 90) for first in range(0, n, 90)]
    one, many = read_samples(table, spec), read_samples(iter(pieces), spec)
    assert one.largest == many.largest
    assert one.largest["max_turn"].value == table["max_turn"].to_numpy()[:600].max()
    assert one.largest["max_turn"].stated == 600
    assert (one.statuses, one.messages.keys()) == (many.statuses, many.messages.keys())
    for name in ("sample", "status", "ok", "settled", "ambiguous"):
        assert np.array_equal(getattr(one, name), getattr(many, name))
    for of in ("values", "at_impact"):
        assert {*getattr(one, of)} == {*getattr(many, of)}
        assert all(np.array_equal(column, getattr(many, of)[name], True) for name, column in getattr(one, of).items())
    assert one.at_impact["FC-2"].sum() == n // 4
    assert set(read_samples(table.drop_columns(["max_turn"]), spec).largest) == {"max_residual", "max_penetration"}


def test_extremes_are_those_of_all_values():
    """Of few and of many values, of equal ones the first."""
    rng = np.random.default_rng(5)
    for x in (rng.normal(size=9), rng.normal(size=MOST_ROWS + 50_000), rng.integers(0, 4, 1000).astype(float)):
        order = np.argsort(x, kind="stable")
        assert extremes(x, 5, largest=False).tolist() == order[:5].tolist()
        order = np.argsort(-x, kind="stable")
        assert extremes(x, 5, largest=True).tolist() == order[:5].tolist()
    assert extremes(np.array([2.0, 1.0]), 5, largest=False).tolist() == [1, 0]
    assert extremes(np.zeros(0), 5, largest=True).size == 0


def test_a_growing_column_has_all_numbers():
    """Of fewer tables than expected, of as many, and of more."""
    for most in (1000, 700, 30, 0):
        column = GrowingColumn(np.int64, most)
        for first in range(0, 700, 70):
            column.add(np.arange(first, first + 70))
        assert np.array_equal(column.array, np.arange(700))
    assert GrowingColumn(np.bool_, 5).array.size == 0


def test_some_rows_are_those_of_their_numbers():
    """Of nearly all rows, whose numbers are not written down, as of others."""
    random = np.random.default_rng(5)
    for share in (0.0, 0.001, 0.5, 0.999, 1.0):
        rows = random.random(5000) < share
        found = np.flatnonzero(rows)
        assert np.array_equal(some_of(rows), found[random_rows(found.size)])


def test_sums_of_many_values_are_those_of_all():
    x = np.random.default_rng(6).normal(1e3, 1.0, MOST_ROWS + 12_345)
    total, square = sums(x, lambda piece: (piece, piece * piece))
    assert np.allclose((total, square), (x.sum(), x @ x), rtol=1e-14)
    for ddof in (0, 1):
        assert np.isclose(standard_deviation(x, ddof), np.std(x, ddof=ddof), rtol=1e-13)


def test_a_column_varies_wherever_it_does():
    """In its first rows, in its last one alone, or only by rounding."""
    x = np.full(5000, 3.0)
    assert not varies(x)
    assert not varies(x * (1 + 1e-15 * np.random.default_rng(7).random(5000)))
    x[-1] = 4.0
    assert varies(x)
    some = Columns({"last": x, "first": x[::-1], "never": np.full(5000, 3.0)}).where(np.arange(5000) % 2 == 1)
    assert list(some.varying) == ["last"]
