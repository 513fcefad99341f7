"""A stand-in for `engine.simulate`: same face, no physics, and the ways in which a run can go wrong.

Whatever drives campaigns takes it in the engine's place (``simulate=``), so that the way of a row can be proved at
thousands of rows a second, with runs that end their process, never end, or eat memory. A function that has more than
the engine's parameters is bound with `functools.partial`; workers find it by its module's name.
"""

import os
import signal
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

from engine import Certificate, Run
from engine.errors import NotAssemblable
from tests.until import until


def simulate(mechanism, values, *, step=None, horizon=None, cancel=None, status="ok", message=""):
    """Return responses that depend on every input, each in its own way."""
    inputs = {key: value for key, value in values.items() if not key.startswith("simulation.")}
    total = sum((i + 1) * value for i, (_, value) in enumerate(sorted(inputs.items())))
    responses = {name: 10.0 + total * (i + 1) for i, name in enumerate(mechanism.responses)}
    certificate = Certificate(
        steps=1000,
        time=3.0,
        wall_s=0.0,
        max_residual=1e-9,
        max_penetration=1e-9,
        max_violation=0.0,
        max_created_energy=2e-9,
        created_energy=3e-9,
        max_lost_energy=4e-9,
        lost_energy=5e-9,
        max_kinetic_energy=6e-6,
        max_turn=7e-3,
        settled=True,
        iterations=5000,
        repeated=0,
    )
    return Run(status, message, responses if status == "ok" else {}, _units(mechanism), certificate)


_KNOWN = {}


def _units(mechanism):
    """Return the units of a mechanism's responses, asked for once a mechanism."""
    known, units = _KNOWN.get(id(mechanism), (None, None))
    if known is not mechanism:
        units = mechanism.response_units()
        _KNOWN[id(mechanism)] = mechanism, units
    return units


def takes(seconds, mechanism, values, **settings):
    """Take a while."""
    time.sleep(seconds)
    return simulate(mechanism, values)


def lasts(quick, counter, mechanism, values, *, cancel=None, **settings):
    """Last until the campaign is cancelled or ``counter.end`` exists, after so many quick runs; a file counts."""
    if not happens(quick, counter):
        until(lambda: cancel.flag[0] or os.path.exists(f"{counter}.end"), "the run is not ended")
    return simulate(mechanism, values)


def raises_above(limit, mechanism, values, **settings):
    """Raise if J1 is above ``limit``."""
    if values["J1"] > limit:
        raise ArithmeticError("no solution")
    return simulate(mechanism, values)


def unfit_above(limit, mechanism, values, **settings):
    """Have parts that cannot be assembled if J1 is above ``limit``."""
    if values["J1"] > limit:
        raise NotAssemblable("c60: parts overlap at the start pose", "crank and base are in the way")
    return simulate(mechanism, values)


def kills_once(marker, mechanism, values, **settings):
    """Kill the process with signal 9 the first time any process comes here."""
    try:
        Path(marker).touch(exist_ok=False)
    except FileExistsError:
        return simulate(mechanism, values)
    os.kill(os.getpid(), signal.SIGKILL)


def happens(times, counter):
    """Return whether something that is to happen so many times happens once more; a file counts."""
    with open(counter, "ab") as file:
        file.write(b"x")
        return file.tell() <= times


def kills_at_first(times, counter, mechanism, values, **settings):
    """Kill the process with signal 9, as an operator may, the first ``times`` times any process comes here."""
    if happens(times, counter):
        os.kill(os.getpid(), signal.SIGKILL)
    return simulate(mechanism, values)


def stops_at_first(times, counter, mechanism, values, **settings):
    """Stop the process for good, as an operator may, the first ``times`` times any process comes here."""
    if happens(times, counter):
        os.kill(os.getpid(), signal.SIGSTOP)
    return simulate(mechanism, values)


def raises_at_first(error, counter, mechanism, values, **settings):
    """Raise an error the first time any process comes here."""
    if happens(1, counter):
        raise error
    return simulate(mechanism, values)


def raises(error, mechanism, values, **settings):
    """Raise an error."""
    raise error


class _Killer(str):
    """A text that kills the process that pickles it with signal 9, once; a file counts."""

    def __reduce__(self):
        if happens(1, self):
            os.kill(os.getpid(), signal.SIGKILL)
        return str, ("",)


def kills_the_answer(counter, mechanism, values, **settings):
    """Have the process killed while it sends the row of a run that is over, once."""
    return simulate(mechanism, values, message=_Killer(counter))


_REMNANTS = []


def leaves_a_thread(mechanism, values, **settings):
    """Leave a thread behind that ends the process while the next run is under way."""
    for begun, remnant in _REMNANTS:
        begun.set()
        remnant.join()  # for ever, but for the end
    begun = threading.Event()
    remnant = threading.Thread(target=lambda: begun.wait() and os._exit(3), daemon=True)
    remnant.start()
    _REMNANTS.append((begun, remnant))
    return simulate(mechanism, values)


def writes_everywhere(mechanism, values, **settings):
    """Write what nobody expects to every file that is open."""
    for descriptor in range(3, 64):
        with suppress(OSError):
            os.write(descriptor, b"no message")
    return simulate(mechanism, values)


def kills_above(limit, mechanism, values, **settings):
    """Kill the process with signal 9 if J1 is above ``limit``, each time."""
    if values["J1"] > limit:
        os.kill(os.getpid(), signal.SIGKILL)
    return simulate(mechanism, values)


def goes_wrong(limits, mechanism, values, **settings):
    """Go wrong as J1 says: segfault, never end, eat memory, exit, or return NaN above the limits of that name."""
    j1 = values["J1"]
    wrong = next((how for how, (low, high) in limits.items() if low < j1 <= high), None)
    match wrong:
        case "segfault":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "never ends":
            while True:  # and takes no notice of a limit
                time.sleep(1.0)
        case "eats memory":
            kept = []
            while True:
                kept.append(np.empty(1 << 26))
        case "exits":
            os._exit(7)
        case "exits in peace":
            os._exit(0)
        case "leaves":
            sys.exit("enough")
        case "not a number":
            return not_finite(mechanism, values)
    return simulate(mechanism, values)


def not_finite(mechanism, values, **settings):
    """Claim success with a response that is not a number."""
    run = simulate(mechanism, values)
    run.responses["FC-1"] = float("nan")
    return run


def needs_a_short_step(mechanism, values, *, step=None, **settings):
    """Converge with a step below 0.002 only, and not even then if J1 is above 0.09."""
    if step is None or step >= 0.002:
        return simulate(mechanism, values, status="not_converged", message="residual 1e-3")
    if values["J1"] > 0.09:
        return simulate(mechanism, values, status="diverged", message="speed 1e9")
    return simulate(mechanism, values)


def step_of(mechanism, values, step):
    """Return the step of a run: the fixed one, or the shortest."""
    return step or values.get("simulation.step", mechanism.simulation.step)


def depends_on_step(mechanism, values, *, step=None, horizon=None, cancel=None):
    """Return the first response less by a half in a run with half the step."""
    run = simulate(mechanism, values)
    name = next(iter(mechanism.responses))
    run.responses[name] += step_of(mechanism, values, step) / mechanism.simulation.step
    return run


def kills_below_its_step(mechanism, values, *, step=None, horizon=None, cancel=None):
    """Kill the process with signal 11 in a run with half the step if J1 is above 0.08."""
    if step_of(mechanism, values, step) < mechanism.simulation.step and values["J1"] > 0.08:
        os.kill(os.getpid(), signal.SIGSEGV)
    return depends_on_step(mechanism, values, step=step)


def counts(counter, mechanism, values, *, step=None, horizon=None, cancel=None):
    """Count the run in a file."""
    with open(counter, "ab") as file:
        file.write(b"x")
    return depends_on_step(mechanism, values, step=step)
