"""While a kernel compiles, Python does not look for garbage; afterwards it does as before."""

import gc

import pytest

from engine.jit import kernel
from engine.jit.numba_internals import collection_paused


@pytest.fixture(autouse=True)
def _collection_on():
    """Whatever a test does, the search for garbage is on before and after it."""
    gc.enable()
    yield
    gc.enable()


def test_no_collection_while_a_kernel_compiles():
    """Compiling makes enough objects for many collections; the only ones are those of before and after."""
    seen = []

    @kernel
    def total(x, y):
        return sum_of(x * y, x - y) + x**2

    @kernel
    def sum_of(a, b):
        return a / b + b

    def note(phase, _):
        seen.append((phase, gc.isenabled()))

    gc.callbacks.append(note)
    try:
        assert total(3.0, 2.0) == 16.0
    finally:
        gc.callbacks.remove(note)
    assert ("start", False) not in seen
    assert gc.isenabled()


def test_what_was_off_stays_off_and_an_error_turns_it_on_again():
    """The state before the block comes back, also where blocks lie in each other or end with an error."""
    with collection_paused():
        with collection_paused():
            assert not gc.isenabled()
        assert not gc.isenabled()
    assert gc.isenabled()
    with pytest.raises(LookupError), collection_paused():
        raise LookupError
    assert gc.isenabled()
    gc.disable()
    with collection_paused():
        pass
    assert not gc.isenabled()
