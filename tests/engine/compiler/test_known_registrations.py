"""While a kernel compiles, Numba fills its table of implementations only where something was added."""

import numpy as np
import pytest
from llvmlite import ir
from numba.core import types
from numba.core.base import BaseContext
from numba.core.imputils import lower_builtin
from numba.core.registry import cpu_target
from numba.core.typing import signature

from engine.compiler import known_registrations
from engine.compiler.known_registrations import registrations_known
from engine.jit import kernel

REFRESH = BaseContext.refresh


@pytest.fixture
def refreshed(monkeypatch):
    """Return the list of the contexts that are filled, in order."""
    contexts = []

    def refresh(context):
        contexts.append(context)
        REFRESH(context)

    monkeypatch.setattr(known_registrations, "_refresh", refresh)
    monkeypatch.setattr(BaseContext, "refresh", refresh)
    return contexts


def test_a_kernel_of_many_arrays_fills_the_table_a_few_times(refreshed):
    """Each array is looked up in vain, and Numba by itself fills the table for each of them."""

    def total(x):
        rows = x[0], x[1], x[2], x[3], x[0], x[1], x[2], x[3]
        return rows[0][0] + rows[1][0] + rows[2][0] + rows[3][0] + rows[4][1] + rows[5][1] + rows[6][1] + rows[7][1]

    x = np.arange(8.0).reshape(4, 2)
    kernel(total)(x)  # registers what no kernel of this process has used before
    refreshed.clear()
    assert kernel(total)(x) == total(x) == x.sum()
    assert 1 <= len(refreshed) <= 4


def test_what_is_added_in_the_block_is_found(refreshed):
    """An implementation that is registered while a kernel compiles can be used at once."""
    context, number = cpu_target.target_context, signature(types.int64)
    with registrations_known(), registrations_known():
        context.refresh()
        context.refresh()
        assert refreshed == [context]
        with pytest.raises(NotImplementedError):
            context.get_function("a function of this test", number)

        @lower_builtin("a function of this test")
        def _seven(context, builder, sig, args):
            return ir.Constant(ir.IntType(64), 7)

        assert callable(context.get_function("a function of this test", number))
        assert refreshed == [context] * 2


def test_what_any_registry_gains_is_found(refreshed):
    """Numba registers intrinsics with the first registry of a context, which is not the built-in one."""
    context, number = cpu_target.target_context, signature(types.int64)
    context.refresh()
    for position, registry in enumerate(list(context._registries)):
        name = f"a function of registry {position}"
        with registrations_known():
            context.refresh()
            refreshed.clear()
            registry.lower(name)(lambda context, builder, sig, args: ir.Constant(ir.IntType(64), 7))
            assert callable(context.get_function(name, number))
            context.refresh()
            assert refreshed == [context]


def test_numba_is_as_it_was_after_a_failure():
    """An error in the block leaves nothing behind."""
    with pytest.raises(LookupError), registrations_known():
        raise LookupError
    assert BaseContext.refresh is REFRESH
