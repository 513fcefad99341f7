"""LLVM is asked once for the size of each type while a kernel compiles, and as before afterwards."""

import numpy as np
import pytest
from numba.core.base import BaseContext

from engine.compiler import remembered_sizes
from engine.compiler.remembered_sizes import sizes_remembered
from engine.jit import kernel

SIZE_OF = BaseContext.get_abi_sizeof


def test_each_type_is_measured_once(monkeypatch):
    """A kernel with many variables of few types asks LLVM once for each type, and computes what Python does."""
    asked = []

    def size_of(context, ty):
        asked.append((id(context), str(ty)))
        return SIZE_OF(context, ty)

    monkeypatch.setattr(remembered_sizes, "_size_of", size_of)
    monkeypatch.setattr(BaseContext, "get_abi_sizeof", size_of)

    def mixed(x, n):
        least, sum_of_squares, count, steps = x[0], 0.0, 0, n
        for i in range(x.shape[0]):  # variables that a loop changes have a place in memory, which has a size
            least, sum_of_squares = min(least, x[i]), sum_of_squares + x[i] ** 2
            count, steps = count + 1, steps - count
        return sum_of_squares + least + count + steps

    x = np.array([2.0, 3.0])
    assert kernel(mixed)(x, 4) == mixed(x, 4) == 20.0
    assert {"double", "i64"} <= {ty for _, ty in asked}
    assert len(asked) == len(set(asked))
    assert BaseContext.get_abi_sizeof is size_of


def test_sizes_are_those_of_llvm():
    """A remembered size is that which LLVM gives, the first time and again."""
    from llvmlite import ir
    from numba.core.registry import cpu_target

    context, double = cpu_target.target_context, ir.DoubleType()
    pair = ir.LiteralStructType([ir.IntType(8), double])
    with sizes_remembered(), sizes_remembered():
        found = [context.get_abi_sizeof(ty) for ty in (double, pair, ir.ArrayType(pair, 3)) for _ in range(2)]
    assert found == [8, 8, 16, 16, 48, 48]


def test_numba_is_as_it_was_after_a_failure():
    """An error in the block leaves nothing behind."""
    with pytest.raises(LookupError), sizes_remembered():
        raise LookupError
    assert BaseContext.get_abi_sizeof is SIZE_OF
