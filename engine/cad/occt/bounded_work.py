"""Work of OCCT in bounded time: it cannot be interrupted, so forks of this process do it, each ended by a timer.

A crash of OCCT too ends only such a fork, and loses one piece of work.
"""

import os
import pickle
import signal
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from engine.cad.occt.occt_values import OCCT_ERRORS

_LEAST_SECONDS = 0.1  # for the last attempt at a piece of work when the budget is spent


@dataclass(frozen=True)
class Work:
    """A piece of work: attempts at it, each simpler than the one before, and the time for each [s of the processor]."""

    attempts: Sequence[Callable[[], Any]]  # their results must be picklable
    seconds: float


@dataclass
class Budget:
    """The processor time that is left for attempts that do not end in theirs [s]."""

    seconds: float


def done_in_time(pieces: Sequence[Work], budget: Budget) -> list[tuple[int, Any] | None]:
    """Return for each piece of work its first attempt that succeeded, from 0, and the result; None if none did.

    An attempt that raises an error of OCCT has failed; any other error is raised here.
    """
    found: dict[int, tuple[int, Any]] = {}
    attempt = dict.fromkeys(range(len(pieces)), 0)
    while left := [i for i, n in attempt.items() if i not in found and n < len(pieces[i].attempts)]:
        reached = -1  # place in `left`
        for reached, (succeeded, result) in enumerate(_forked(pieces, left, attempt, budget)):
            if succeeded:
                found[left[reached]] = attempt[left[reached]], result
            else:
                attempt[left[reached]] += 1
        if reached + 1 < len(left):  # the fork has ended before it was done
            work = left[reached + 1]
            budget.seconds -= _seconds(pieces[work], budget)
            last = len(pieces[work].attempts) - 1
            attempt[work] = attempt[work] + 1 if budget.seconds > 0 else max(attempt[work] + 1, last)
    return [found.get(i) for i in range(len(pieces))]


def _seconds(work: Work, budget: Budget) -> float:
    """Return the time for an attempt [s]."""
    return max(min(work.seconds, budget.seconds), _LEAST_SECONDS)


def _forked(
    pieces: Sequence[Work], left: list[int], attempt: dict[int, int], budget: Budget
) -> Iterator[tuple[bool, Any]]:
    """Yield whether each piece of work succeeded, and its result, up to the first that takes too long."""
    receiving, sending = os.pipe()
    with warnings.catch_warnings():
        # other threads of this process, if there are any, do not work with OCCT
        warnings.simplefilter("ignore", DeprecationWarning)
        process = os.fork()
    if not process:
        with suppress(BaseException), os.fdopen(sending, "wb") as file:
            os.close(receiving)
            signal.signal(signal.SIGVTALRM, signal.SIG_DFL)
            for i in left:
                signal.setitimer(signal.ITIMER_VIRTUAL, _seconds(pieces[i], budget))
                answer = _answer(pieces[i].attempts[attempt[i]])
                signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
                pickle.dump(answer, file)
                file.flush()
        os._exit(0)
    os.close(sending)
    try:
        with os.fdopen(receiving, "rb") as file, suppress(EOFError, pickle.UnpicklingError):
            while True:
                succeeded, result = pickle.load(file)
                if isinstance(result, BaseException):
                    raise result
                yield succeeded, result
    finally:
        os.waitpid(process, 0)


def _answer(function: Callable[[], Any]) -> tuple[bool, Any]:
    """Return whether a function succeeded, and its result, or the error to raise."""
    try:
        return True, function()
    except OCCT_ERRORS:
        return False, None
    except Exception as error:
        return False, error
