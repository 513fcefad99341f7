"""End cleanly on SIGTERM and on the hangup of a terminal, releasing lease, workers and temporary files."""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from campaign.interrupts import in_unraisable_hook, send_again

ENDING = (signal.SIGTERM, signal.SIGHUP)
LOOK_EVERY = 0.5  # s between checks whether the parent still exists


@contextmanager
def terminated_in_order() -> Iterator[None]:
    """Raise SystemExit with status 128 + N in the block when signal N asks this process to end.

    An ignored signal stays ignored, as ``nohup`` requires. Further signals do not disturb the exit. Compiled code that
    calls Python may swallow the exception, which is then raised again, or turn it into an error of its own, in which
    case the block still ends with the status of the signal.
    """
    before = {number: signal.getsignal(number) for number in ENDING}
    handled = [number for number, handler in before.items() if handler == signal.SIG_DFL]
    came: list[int] = []

    def terminate(number: int, frame: FrameType | None) -> None:
        if in_unraisable_hook(frame):
            send_again(number)
            return
        came.append(number)
        for other in handled:
            signal.signal(other, signal.SIG_IGN)
        raise SystemExit(128 + number)

    def unraisable(swallowed: "sys.UnraisableHookArgs") -> None:
        if came and issubclass(swallowed.exc_type, SystemExit):
            signal.signal(came[-1], terminate)  # `terminate` has made this process ignore it
            send_again(came[-1])
        else:
            hook(swallowed)

    for number in handled:
        signal.signal(number, terminate)
    hook, sys.unraisablehook = sys.unraisablehook, unraisable
    try:
        yield
    except Exception:
        if came:
            raise SystemExit(128 + came[-1]) from None
        raise
    finally:
        sys.unraisablehook = hook
        for number in handled:
            signal.signal(number, before[number])


def terminate_with_parent(parent: int) -> None:
    """Send SIGTERM to this process once its parent has ended for any reason, even if it has ended before this call."""

    def watch() -> None:
        while os.getppid() == parent:  # an orphan gets another parent
            time.sleep(LOOK_EVERY)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, name="parent", daemon=True).start()
