"""End in order on SIGTERM and on the hangup of a terminal: lease, workers and temporary files are given back."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

ENDING = (signal.SIGTERM, signal.SIGHUP)


@contextmanager
def terminated_in_order() -> Iterator[None]:
    """Raise SystemExit with status 128 + N where the block is, when signal N asks this process to end.

    A signal that is ignored stays ignored, as ``nohup`` wants it. Further signals do not disturb the end.
    """
    before = {number: signal.getsignal(number) for number in ENDING}
    handled = [number for number, handler in before.items() if handler == signal.SIG_DFL]
    for number in handled:
        signal.signal(number, _terminate)
    try:
        yield
    finally:
        for number in handled:
            signal.signal(number, before[number])


def _terminate(number: int, _: FrameType | None) -> None:
    """Unwind this process."""
    for other in ENDING:
        signal.signal(other, signal.SIG_IGN)
    raise SystemExit(128 + number)
