"""The compiled time loop with a clock around each stage of a step, for `clearcap bench`.

The loop is the engine's own: its functions `run_to_end`, `_advance` and `step` are compiled a second time with the
names of the stages bound to timed versions. The kernels used by runs contain no clock. The copies are compiled again in
each process, because an address cannot be kept on disk.
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

from engine.jit import inner, uncached
from engine.kernels import step, time_loop

# loads: includes the free motion; contacts: the broad phase, velocities and the active set; projection: includes its
# solver; rest: responses, and the detection of rest
STAGES = ("solver", "contacts", "loads", "joints", "projection", "rest")
SOLVER, CONTACTS, LOADS, JOINTS, PROJECTION, REST = STAGES
STAGES_OF_STEP = {
    **dict.fromkeys(("save_start", "move", "apply_loads", "free_twist", "damp", "impulse_time"), LOADS),
    **dict.fromkeys(("row_targets", "find_redundant_rows", "hold_joints", "add_contact_part"), JOINTS),
    **dict.fromkeys(("finish_bushings",), JOINTS),
    **dict.fromkeys(("consume_budget", "body_speeds", "find_near_contacts", "free_relative_velocities"), CONTACTS),
    **dict.fromkeys(("first_active_set", "look_at_active_contacts", "gather_problem", "soften", "bend"), CONTACTS),
    **dict.fromkeys(("begin_rolling", "match_rolling"), CONTACTS),
    **dict.fromkeys(("compress", "apply_impulses", "grow_active_set", "fastest_body", "fastest_spin"), CONTACTS),
    **dict.fromkeys(("worst_contact", "work_of_contacts"), CONTACTS),
    **dict.fromkeys(("solve_friction",), SOLVER),
    **dict.fromkeys(("project_positions",), PROJECTION),
}
STAGES_OF_LOOP = dict.fromkeys(("read_motions", "_measure", "accumulate", "update_reported", "_track_rest"), REST)

_clock = ctypes.CDLL(None).clock_gettime
_clock.argtypes, _clock.restype = (ctypes.c_int, ctypes.c_size_t), ctypes.c_int
_MONOTONIC = time.CLOCK_MONOTONIC
_spent = np.zeros(len(STAGES), np.int64)  # [ns]; kernels write to it through its address
_instant = np.zeros(2, np.int64)  # seconds, nanoseconds


def _build_integers(typing_context: Any, address: Any) -> Any:
    """Return the integers at an address."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return numba.types.CPointer(numba.types.int64)(numba.types.intp), build  # type: ignore[no-untyped-call]


_integers: Any = intrinsic(_build_integers)


@cache
def timed_loop() -> tuple[Callable[..., None], np.ndarray]:
    """Return `kernels.time_loop.run_to_end` with clocks, and the array of times it adds to [ns], in order of STAGES."""
    timed_step = inner(_rebound(step.step, _timed(step, STAGES_OF_STEP)))
    advance = inner(_rebound(time_loop._advance, {"step": timed_step}))
    return uncached(_rebound(time_loop.run_to_end, {"_advance": advance, **_timed(time_loop, STAGES_OF_LOOP)})), _spent


def _rebound(kernel: Any, names: Mapping[str, Any]) -> FunctionType:
    """Return the function of a kernel with some of the functions it calls replaced, by name.

    Its own name differs: machine code that is read from the disk may have a function of the same name and number, which
    would then be called in its place.
    """
    function = kernel.py_func
    copy = FunctionType(function.__code__, {**function.__globals__, **names}, f"timed_{function.__name__}")
    copy.__qualname__ = copy.__name__
    return copy


def _timed(module: Any, stages: Mapping[str, str]) -> dict[str, Any]:
    return {name: _with_clock(getattr(module, name), STAGES.index(stage)) for name, stage in stages.items()}


def _with_clock(stage: Any, number: int) -> Any:
    """Return the kernel ``stage`` with a clock that adds its time to ``_spent[number]``."""
    spent_at, instant_at = _spent.ctypes.data, _instant.ctypes.data

    @inner
    def now() -> Any:
        _clock(_MONOTONIC, instant_at)
        instant = _integers(instant_at)
        return 1_000_000_000 * instant[0] + instant[1]

    @inner
    def timed(*arguments: Any) -> Any:
        start = now()
        result = stage(*arguments)
        spent = _integers(spent_at)
        spent[number] += now() - start
        return result

    return timed
