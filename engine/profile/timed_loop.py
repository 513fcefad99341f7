"""The compiled time loop with a clock around each stage of a step, for `clearcap bench`.

The loop is the engine's own: its functions `run`, `_advance` and `step` are compiled a second time with the names of
the stages bound to clocked ones. The kernels that runs use know of no clock. The copies are compiled anew in each
process, because an address cannot be kept on disk.
"""

import ctypes
import time
from collections.abc import Callable, Mapping
from functools import cache
from types import FunctionType
from typing import Any

import numba
import numpy as np
from numba.extending import intrinsic

from engine.jit import uncached
from engine.kernels import run, step

# loads: with the free motion; contacts: finding them, their velocities and the active set; projection: with its own
# solver; rest: responses and the look for rest
STAGES = ("solver", "contacts", "loads", "joints", "projection", "rest")
SOLVER, CONTACTS, LOADS, JOINTS, PROJECTION, REST = STAGES
IN_STEP = {
    "keep": LOADS,
    "move": LOADS,
    "apply_loads": LOADS,
    "free_twist": LOADS,
    "damp": LOADS,
    "tie_targets": JOINTS,
    "hold_joints": JOINTS,
    "spend": CONTACTS,
    "rates": CONTACTS,
    "look_around": CONTACTS,
    "free_relative_velocities": CONTACTS,
    "first_active_set": CONTACTS,
    "gather": CONTACTS,
    "scatter": CONTACTS,
    "grow_active_set": CONTACTS,
    "worst_contact": CONTACTS,
    "solve_friction": SOLVER,
    "project_positions": PROJECTION,
}
IN_RUN = {"_measure": REST, "note": REST, "_rest": REST}

_clock = ctypes.CDLL(None).clock_gettime
_clock.argtypes, _clock.restype = (ctypes.c_int, ctypes.c_size_t), ctypes.c_int
_MONOTONIC = time.CLOCK_MONOTONIC
_spent = np.zeros(len(STAGES), np.int64)  # [ns]; kernels write to it by its address
_instant = np.zeros(2, np.int64)  # seconds, nanoseconds


def _build_integers(typing_context: Any, address: Any) -> Any:
    """Return the integers at an address."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return numba.types.CPointer(numba.types.int64)(numba.types.intp), build  # type: ignore[no-untyped-call]


_integers: Any = intrinsic(_build_integers)


@cache
def clocked_run() -> tuple[Callable[..., None], np.ndarray]:
    """Return `engine.kernels.run.run` with clocks, and the times it adds to [ns], in the order of ``STAGES``."""
    clocked_step = _rebound(step.step, _clocked(step, IN_STEP))
    advance = _rebound(run._advance, {"step": clocked_step})
    return _rebound(run.run, {"_advance": advance, **_clocked(run, IN_RUN)}), _spent


def _rebound(dispatcher: Any, names: Mapping[str, Any]) -> Any:
    """Compile a kernel with other functions behind the names it calls."""
    function = dispatcher.py_func
    return uncached(FunctionType(function.__code__, {**function.__globals__, **names}, function.__name__))


def _clocked(module: Any, stages: Mapping[str, str]) -> dict[str, Any]:
    return {name: _with_clock(getattr(module, name), STAGES.index(stage)) for name, stage in stages.items()}


def _with_clock(stage: Any, number: int) -> Any:
    """Return the kernel ``stage`` with what it takes added to ``_spent[number]``."""
    spent_at, instant_at = _spent.ctypes.data, _instant.ctypes.data

    @uncached
    def now() -> Any:
        _clock(_MONOTONIC, instant_at)
        instant = _integers(instant_at)
        return 1_000_000_000 * instant[0] + instant[1]

    @uncached
    def clocked(*arguments: Any) -> Any:
        start = now()
        result = stage(*arguments)
        spent = _integers(spent_at)
        spent[number] += now() - start
        return result

    return clocked
