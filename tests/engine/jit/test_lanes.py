"""Eight numbers at a time: compiled, each operation gives the bits that NumPy gives for single numbers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from engine.jit import kernel
from engine.jit.lanes import LANES, choose, fused, larger, least, read, root, spread, total, write

pytestmark = pytest.mark.bits

numbers = arrays(np.float64, LANES, elements=st.floats(-1e100, 1e100, allow_subnormal=False))


@kernel
def arithmetic(a, b, x, out):
    """Write what eight numbers, eight others and one number give."""
    y, z = read(a, 0), read(b, 0)
    write(y + z, out[0], 0)
    write(y - x, out[1], 0)
    write(x * z, out[2], 0)
    write(y / z, out[3], 0)
    write(-y, out[4], 0)
    write(root(y * y), out[5], 0)
    write(larger(y, z), out[6], 0)
    write(choose((y < z) & (y >= x), y, 0.0), out[7], 0)
    write(choose((y <= x) & (z > 0.0), spread(1.0), z), out[8], 0)


@kernel
def folds(a):
    """Return sum and least of eight numbers."""
    return total(read(a, 0)), least(read(a, 0))


@kernel
def products(a, b, c, x, out):
    """Write a b + c and x b + c."""
    write(fused(read(a, 0), read(b, 0), read(c, 0)), out[0], 0)
    write(fused(x, read(b, 0), read(c, 0)), out[1], 0)


@kernel
def shift(a):
    """Move eight numbers on by three places."""
    write(read(a, 0), a, 3)


@settings(deadline=None)
@given(numbers, numbers, st.floats(-1e100, 1e100, allow_subnormal=False))
def test_operators_give_the_bits_of_numpy(a, b, x):
    """Sums, products, quotients, roots, choices: also of infinities and NaN."""
    out = np.zeros((9, LANES))
    arithmetic(a, b, x, out)
    with np.errstate(all="ignore"):
        expected = [a + b, a - x, x * b, a / b, -a, np.sqrt(a * a), np.where(a > b, a, b)]
        expected += [np.where((a < b) & (a >= x), a, 0.0), np.where((a <= x) & (b > 0), 1.0, b)]
    np.testing.assert_array_equal(out, expected)


@settings(deadline=None)
@given(numbers)
def test_folds_halve(a):
    """The sum is that of halves and their halves: one order, whatever the processor."""
    b = a[:4] + a[4:]
    expected = (b[0] + b[2]) + (b[1] + b[3])
    assert folds(a) == (expected, a.min())


@settings(deadline=None)
@given(arrays(np.int64, (3, LANES), elements=st.integers(-(2**26), 2**26)), st.integers(-(2**26), 2**26))
def test_fused_products_round_once(whole, x):
    """Of integers below 2^53 both ways are exact; a product of odd numbers of 53 bits keeps its last digits."""
    a, b, c = whole.astype(float)
    out = np.zeros((2, LANES))
    products(a, b, c, float(x), out)
    np.testing.assert_array_equal(out, [a * b + c, x * b + c])
    long = np.full(LANES, 2.0**52 + 1)
    products(long, long, -long * long, 0.0, out)
    assert out[0].tolist() == [1.0] * LANES  # (2^52 + 1)^2 less its rounded value


def test_numbers_may_begin_anywhere_in_an_array():
    """Reading and writing need no alignment."""
    a = np.arange(12.0)
    shift(a)
    assert a.tolist() == [0, 1, 2, 0, 1, 2, 3, 4, 5, 6, 7, 11]


def test_plain_python_does_the_same():
    """Without compilation the kernels run on arrays of NumPy."""
    a, b = np.linspace(-2, 5, LANES), np.linspace(3, -1, LANES)
    out, plain = np.zeros((2, 9, LANES))
    arithmetic(a, b, 0.7, out)
    arithmetic.py_func(a, b, 0.7, plain)
    np.testing.assert_array_equal(out, plain)
    assert folds(a) == folds.py_func(a)
