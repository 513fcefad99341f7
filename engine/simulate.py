"""Simulate one mechanism: from a description and a set of values to responses and a certificate.

Also compile the engine beforehand, and tell which of its kernels are not compiled yet.

The compiled kernels are imported inside the functions that need them, because loading Numba takes longer than loading
a description.
"""

import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.mechanism import Mechanism, load_mechanism, set_values
from engine.run import Run
from engine.trajectory import Recording

if TYPE_CHECKING:
    from engine.loop import Cancel


def simulate(
    mechanism: Mechanism,
    values: Mapping[str, float] | None = None,
    *,
    step: float | None = None,
    horizon: float | None = None,
    full_horizon: bool = False,
    cancel: "Cancel | None" = None,
    trajectory: str | Path | Recording | None = None,
    indeterminacy: bool = False,
) -> Run:
    """Simulate a mechanism until it is at rest and measure its responses (paper, sections 2 and 4.1).

    Parameters
    ----------
    mechanism : Mechanism
        The description, see `load_mechanism`.
    values : mapping, optional
        Numbers to set in it, such as ``{"J1": 0.05, "springs.A3.preload": 0.9}``.
    step : float, optional
        A fixed time step instead of the description's steps [its unit of time].
    horizon : float, optional
        Longest simulated time, instead of the description's [its unit of time].
    full_horizon : bool
        Do not stop at rest in the last phase.
    cancel : Cancel, optional
        A flag with which another thread can end the run.
    trajectory : str, Path or Recording, optional
        An HDF5 file for the whole motion, written whatever the status of the run; see `read_trajectory`. A `Recording`
        keeps only every N-th step.
    indeterminacy : bool
        Also compute the range that friction allows for each contact force at rest (`Run.ranges`).

    Returns
    -------
    Run

    Raises
    ------
    MechanismError
        If a value is not allowed.
    NotAssemblable
        If parts overlap at the start pose, or ideal joints are open, and no pose nearby puts that right.
    TrajectoryError
        If the recording settings are not allowed, or the file cannot be written.
    """
    from engine.assembly import lent_assembly
    from engine.execution import execute

    settings = {"simulation.step": step, "simulation.horizon": horizon}
    changes = {**(values or {}), **{key: value for key, value in settings.items() if value is not None}}
    mechanism = set_values(mechanism, changes) if changes else mechanism
    if step is not None:
        fixed = mechanism.simulation.model_copy(update={"adaptive": None})
        mechanism = mechanism.model_copy(update={"simulation": fixed})
    with lent_assembly(mechanism) as assembly:
        if trajectory is None:
            return execute(mechanism, assembly, full_horizon, cancel, indeterminacy)
        from engine.trajectory.write import trajectory_file

        recording = Recording.of(trajectory)
        with trajectory_file(recording, mechanism, assembly, full_horizon=full_horizon) as file:
            run = execute(mechanism, assembly, full_horizon, cancel, indeterminacy, file.append, recording.every)
            file.finish(run)
        return run


def check(mechanism: Mechanism, values: Mapping[str, float] | None = None) -> None:
    """Check that a mechanism can start with the given values.

    Raises
    ------
    MechanismError
        If a value is not allowed; NotAssemblable, if parts overlap at the start pose or ideal joints are open, and no
        pose nearby puts that right.
    """
    from engine.assembly import assemble

    assemble(set_values(mechanism, values) if values else mechanism)


def warm_up() -> float:
    """Compile the engine, or load it from the cache; return the time this took [s].

    The mechanism used here needs every kernel that a run can need: contacts, forces at rest and their ranges.
    """
    start = time.perf_counter()
    simulate(load_mechanism("c60"))
    return time.perf_counter() - start


def missing_kernels() -> tuple[str, ...]:
    """Return the index files of the kernels that are not in the cache yet; empty if the engine is compiled.

    There is one for each kernel that Python calls; its name stands for it if Numba does not say where it is.
    """
    from engine.friction.barrier import least
    from engine.jit import Kernel
    from engine.kernels.responses import measure
    from engine.kernels.time_loop import run_to_end

    # most of the work is the time loop; responses and ranges are compiled after it, in a run that needs them
    needed = [kernel for kernel in (run_to_end, measure, least) if isinstance(kernel, Kernel)]
    if all(kernel.ready or not _missing_file(kernel) for kernel in needed):
        return ()
    engine_modules = [module for name, module in list(sys.modules.items()) if name.partition(".")[0] == "engine"]
    values = {id(value): value for module in engine_modules for value in vars(module).values()}.values()
    files = [_missing_file(value) for value in values if isinstance(value, Kernel)]
    return tuple(file for file in files if file)


def _missing_file(kernel: Any) -> str:
    """Return the index file of a kernel; empty if it lists machine code, compiled from the current source."""
    from engine.jit.kept_code import index_file

    index = index_file(kernel.compiled)
    if index is None:
        return f"{kernel.__module__}.{kernel.__qualname__}"
    path, is_filled = index
    return "" if is_filled else path
