"""A stand-in for `engine.simulate`: same face, no physics, and the ways in which a run can go wrong."""

import os
import signal
from pathlib import Path

from engine import Certificate, Run


def simulate(mechanism, values, *, step=None, horizon=None):
    """Return responses that depend on every input, each in its own way."""
    total = sum((i + 1) * value for i, (_, value) in enumerate(sorted(values.items())))
    responses = {name: 10.0 + total * (i + 1) for i, name in enumerate(mechanism.responses)}
    certificate = Certificate(
        steps=1000,
        time=3.0,
        wall_s=0.0,
        max_residual=1e-9,
        max_penetration=1e-9,
        max_violation=0.0,
        settled=True,
        iterations=5000,
        repeated=0,
    )
    return Run("ok", "", responses, mechanism.response_units(), certificate)


def warm_up():
    """Have nothing to compile."""
    return 0.0


def raises_above(limit, mechanism, values, *, step=None, horizon=None):
    """Raise if J1 is above ``limit``."""
    if values["J1"] > limit:
        raise ArithmeticError("no solution")
    return simulate(mechanism, values)


def kills_once(marker, mechanism, values, *, step=None, horizon=None):
    """Kill the process with signal 9 the first time any process comes here."""
    try:
        Path(marker).touch(exist_ok=False)
    except FileExistsError:
        return simulate(mechanism, values)
    os.kill(os.getpid(), signal.SIGKILL)


def kills_above(limit, mechanism, values, *, step=None, horizon=None):
    """Kill the process with signal 9 if J1 is above ``limit``, each time."""
    if values["J1"] > limit:
        os.kill(os.getpid(), signal.SIGKILL)
    return simulate(mechanism, values)


def not_finite(mechanism, values, *, step=None, horizon=None):
    """Claim success with a response that is not a number."""
    run = simulate(mechanism, values)
    run.responses["FC-1"] = float("nan")
    return run
